# SPDX-License-Identifier: Apache-2.0
"""Pedestrians: where they go, that they pass each other, and the slow twins of both models."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.geometry import polygon_edges, rectangle
from pm01_nav.robot import full_circle
from pm01_nav.sim.pedestrians import COURTESY
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.sim.social_force import decay, repulsion, turn_of
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference_movers import (
    nearest_points,
    plan_by_forces,
    plan_by_orca,
    reference_crowd_step,
    reference_repulsion,
)

BOUNDS = (0.0, 0.0, 10.0, 10.0)
MODELS = ("orca", "social_force")
RADIUS = 0.25
Start = Callable[..., PlanarSimulator]


@pytest.fixture
def start(make_robot) -> Start:
    """Return a simulator with episodes begun; its robots stand still."""

    def make(*worlds: World, num_envs: int = 1, **arguments) -> PlanarSimulator:
        pool = build_pool(worlds, 0.2)
        robot = make_robot(lidar=full_circle(4))
        simulator = PlanarSimulator(robot, pool, num_envs, **arguments)
        simulator.seed(np.arange(num_envs))
        simulator.reset(worlds=np.arange(num_envs) % len(worlds))
        return simulator

    return make


def walker(*points, speed: float = 1.3) -> Mover:
    return Mover("pedestrian", RADIUS, np.array(points, dtype=np.float64), speed=speed)


def room(*movers: Mover, **obstacles) -> World:
    walls = polygon_edges(rectangle(5, 5, 10, 10))
    return World("room", BOUNDS, segments=walls, movers=movers, **obstacles)


def crowd(rng: np.random.Generator, count: int, **obstacles) -> World:
    """Draw pedestrians, at least 0.1 m from each other and from all that stands there."""
    world = room(**obstacles)
    places: list[NDArray[np.float64]] = []
    while len(places) < count:
        place = rng.uniform(0.5, 9.5, 2)
        gaps = [np.linalg.norm(place - p) for p in places]
        gaps += [np.linalg.norm(place - p) + RADIUS for p in nearest_points(world, place)]
        if min(gaps, default=1.0) > 2 * RADIUS + 0.1:
            places.append(place)
    return room(*(walker(p, speed=rng.uniform(0.8, 1.4)) for p in places), **obstacles)


def stand(simulator: PlanarSimulator) -> None:
    simulator.step(np.zeros((simulator.num_envs, 2)))


def least_gap(simulator: PlanarSimulator) -> float:
    """Return the least distance between two movers of one environment [m]."""
    least = np.inf
    for i in range(simulator.num_envs):
        rows = simulator.movers(i)
        gaps = np.linalg.norm(rows[:, None, :2] - rows[None, :, :2], axis=-1)
        gaps -= rows[:, None, 2] + rows[None, :, 2]
        least = min(least, gaps[np.triu_indices(len(rows), 1)].min(initial=np.inf))
    return float(least)


def test_alone_it_walks_straight_and_round_again(start) -> None:
    sim = start(room(walker((2.0, 2.0), (4.0, 2.0), (4.0, 5.0), speed=1.0)))
    place = sim.state.mover_position[0, 0]
    for _ in range(10):
        stand(sim)
    # 1 m/s for 1 s.
    assert place == pytest.approx([3.0, 2.0])
    assert sim.state.mover_velocity[0, 0] == pytest.approx([1.0, 0.0])
    seen = []
    for _ in range(120):
        stand(sim)
        seen.append(int(sim.state.mover_leg[0, 0]))
    # 2 + 3 + sqrt(13) = 8.6 m in all, at 1 m/s: within 13 s it has been everywhere.
    assert set(seen) == {0, 1, 2}


def test_with_one_point_it_walks_to_places_of_its_world(start) -> None:
    sim = start(room(walker((2.0, 2.0))), num_envs=40)
    places = sim.pool.arrays.mover_places
    targets = sim.state.mover_target[:, 0]
    assert all((np.abs(places - target).sum(axis=1) == 0.0).any() for target in targets)
    # Episodes differ: of 256 places, 40 draws hardly ever hit fewer than 25 different ones.
    assert len(np.unique(targets, axis=0)) > 25


def test_it_gives_up_what_it_cannot_reach(start) -> None:
    # A target inside a box: 2 m away, so patience ends after 5 s + 2 x 2 s.
    box = rectangle(4.0, 2.0, 1.0, 1.0)
    world = World("box", BOUNDS, polygons=(box,), movers=(walker((2, 2), (4, 2), (2, 8), speed=1),))
    sim = start(world)
    for _ in range(89):
        stand(sim)
    assert sim.state.mover_leg[0, 0] == 1
    for _ in range(2):
        stand(sim)
    assert sim.state.mover_leg[0, 0] == 2


@pytest.mark.parametrize("model", MODELS)
def test_two_pass_each_other_head_on(start, model: str) -> None:
    one, two = walker((1.0, 5.0), (9.0, 5.0)), walker((9.0, 5.0), (1.0, 5.0))
    sim = start(room(one, two), pedestrians=model, pedestrians_avoid_robot=False)
    arrived = np.zeros(2, dtype=bool)
    for _ in range(120):
        stand(sim)
        assert least_gap(sim) > 0.0
        arrived |= np.abs(sim.state.mover_position[0, :, 0] - [9.0, 1.0]) < 0.31
    # 8 m take 6.2 s alone and at most twice as long together.
    assert arrived.all()


PILLARS = np.array([[3.0, 3.0, 0.5], [7.0, 4.0, 0.3], [5.0, 7.0, 0.6]])
CELLS = np.zeros((40, 40), dtype=np.uint8)
CELLS[10:14, 18:22] = 1
CELLS[28:30, 5:20] = 1
BLOCKS = OccupancyGrid(CELLS, 0.25, (0.0, 0.0))
TURNED = OccupancyGrid(CELLS, 0.25, (2.0, -1.0), 0.4)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    "obstacles",
    [{}, {"discs": PILLARS, "grid": BLOCKS}, {"discs": PILLARS, "grid": TURNED}],
    ids=["room", "more", "turned"],
)
def test_twenty_in_a_room_never_touch(start, model: str, obstacles: dict) -> None:
    worlds = [crowd(np.random.default_rng(seed), 20, **obstacles) for seed in range(2)]
    sim = start(*worlds, num_envs=2, pedestrians=model)
    walked = 0.0
    for step in range(1000):
        stand(sim)
        # Half-planes forbid every overlap; what is left is rounding.
        assert least_gap(sim) > -1e-9
        walked += float(np.linalg.norm(sim.state.mover_velocity, axis=-1).mean()) * 0.1
        if step % 10 == 0:
            for i in range(2):
                for place in sim.state.mover_position[i]:
                    points = nearest_points(worlds[i], place)
                    assert min(np.linalg.norm(place - p) for p in points) > RADIUS - 1e-9
    # In 100 s a pedestrian alone walks 110 m; a crowd that blocks itself walks hardly at all.
    assert walked > 30.0


@pytest.mark.parametrize("model", MODELS)
def test_the_robot_is_avoided_if_asked_for(start, model: str) -> None:
    touched = []
    for avoid in (True, False):
        world = room(walker((1.0, 5.0), (9.0, 5.0)))
        sim = start(world, pedestrians=model, pedestrians_avoid_robot=avoid)
        sim.place(np.array([0]), [[5.0, 5.02, 0.0]], [[9.0, 9.0]])
        contact = False
        for _ in range(80):
            stand(sim)
            contact |= bool(sim.state.contact[0])
        touched.append(contact)
    assert touched == [False, True]


@pytest.mark.parametrize("model", MODELS)
def test_a_crowd_leaves_room_for_a_robot_that_stands(start, model: str) -> None:
    worlds = [crowd(np.random.default_rng(seed), 20) for seed in range(4)]
    sim = start(*worlds, num_envs=4, pedestrians=model)
    # Where nobody stands yet.
    middle = np.array([5.0, 5.0])
    nearest = [np.linalg.norm(sim.movers(i)[:, :2] - middle, axis=1).min() for i in range(4)]
    clear = np.flatnonzero(np.array(nearest) > 0.7)
    assert len(clear) > 0
    sim.place(clear, [[*middle, 0.0]] * len(clear), [[9.0, 9.0]] * len(clear))
    least = np.inf
    for _ in range(600):
        stand(sim)
        for i in clear:
            gaps = np.linalg.norm(sim.movers(i)[:, :2] - middle, axis=1) - sim.movers(i)[:, 2]
            least = min(least, float(gaps.min()) - sim.robot.footprint.circumscribed_radius)
    assert least > COURTESY - 1e-9
    assert least < COURTESY + 0.05


def random_crowds(rng: np.random.Generator, half: float):
    """Draw rooms with 12 walking pedestrians within ``half`` [m] of the middle, none touching."""
    for _ in range(12):
        places: list[NDArray[np.float64]] = []
        while len(places) < 12:
            place = rng.uniform(5 - half, 5 + half, 2)
            if min((np.linalg.norm(place - p) for p in places), default=1.0) > 2 * RADIUS + 0.05:
                places.append(place)
        speeds = rng.uniform(0.8, 1.4, 12)
        yield room(*(walker(p, speed=s) for p, s in zip(places, speeds, strict=True)))


@pytest.mark.parametrize(
    ("model", "plan", "half", "tolerance"),
    [
        ("orca", plan_by_orca, 4.6, 1e-4),
        # Far from walls, whose force the twin leaves out. The kernel's angles have errors of 2e-5.
        ("social_force", plan_by_forces, 3.5, 1e-3),
    ],
)
def test_a_step_equals_the_slow_twin(start, model, plan, half, tolerance) -> None:
    rng = np.random.default_rng(3)
    permitted = 0
    for world in random_crowds(rng, half):
        sim = start(world, pedestrians=model, pedestrians_avoid_robot=False)
        state = sim.state
        state.mover_velocity[:] = rng.uniform(-1.0, 1.0, (1, 12, 2))
        speeds = np.array([m.speed for m in world.movers])
        bodies = np.column_stack(
            [state.mover_position[0], state.mover_velocity[0], state.mover_radius[0], speeds]
        )
        targets = state.mover_target[0].copy()
        far = np.linalg.norm(targets - bodies[:, :2], axis=1) > 0.3
        stand(sim)
        expected, violations = reference_crowd_step(world, bodies, targets, 0.1, plan)
        # Where something had to be given up several velocities may be as good.
        alike = far & (violations == 0.0)
        assert state.mover_velocity[0][alike] == pytest.approx(expected[alike], abs=tolerance)
        permitted += int(alike.sum())
    assert permitted > 90


def test_force_by_hand() -> None:
    # Side by side 1 m apart, surfaces 0.5 m, at the same velocity: D = e, B = 0.35 m, and the angle
    # is the bias alone, 0.005 x 0.35 = 0.00175: 4.5 exp(-0.5 / 0.35) = 1.0785 back, and as much
    # aside, to the right; both decays, of (3 x 0.35 x 0.00175)^2, are 1 - 3e-6.
    ax, ay = repulsion(1.0, 0.0, 0.0, 0.0, 0.5)
    assert (ax, ay) == pytest.approx((-1.0785, -1.0785), abs=1e-4)


def test_forces_equal_the_formula() -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        way, velocity = rng.uniform(-3, 3, 2), rng.uniform(-2.5, 2.5, 2)
        expected = reference_repulsion(way, velocity, 0.5)
        assert repulsion(*way, *velocity, 0.5) == pytest.approx(expected, abs=2e-3)


def test_turn_and_decay_are_as_exact_as_declared() -> None:
    for angle in np.linspace(-np.pi + 1e-3, np.pi - 1e-3, 500):
        assert turn_of(3.0 * np.cos(angle), 3.0 * np.sin(angle)) == pytest.approx(angle, abs=2e-5)
    for x in np.linspace(0.0, 8.0, 300):
        assert decay(x) == pytest.approx(np.exp(-x), rel=1e-6)
    assert 0.0 <= decay(1000.0) < 1e-20
