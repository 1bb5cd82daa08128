# SPDX-License-Identifier: Apache-2.0
"""Obstacles that move, in the simulator: seen, touched, started, reproducible and saved."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from pm01_nav.robot import full_circle
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.world import World
from tests.sim.reference import reference_clearance, reference_scan

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
CIRCLE = {"shape": "circle", "radius": 0.2, "vertices": ()}
BOX = {
    "shape": "polygon",
    "radius": 0.0,
    "vertices": ((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)),
}
AHEAD = {"num_beams": 1, "angle_min": 0.0, "angle_max": 0.0}
STANDING = World("standing", BOUNDS, discs=np.array([[3.0, 3.0, 0.5]]))


def flyer(x: float, y: float, heading: float, speed: float = 1.0, radius: float = 0.3) -> Mover:
    return Mover("bounce", radius, np.array([[x, y]]), speed=speed, heading=heading)


def stand(simulator: PlanarSimulator) -> None:
    simulator.step(np.zeros((simulator.num_envs, 2)))


def test_lidar_sees_a_mover_where_it_is(make_robot, simulate) -> None:
    world = World("flyer", BOUNDS, movers=(flyer(2.0, 0.0, np.pi),))
    sim = simulate(make_robot(lidar=AHEAD), world, [[0.0, 0.0, 0.0]])
    # Its surface is 1.7 m ahead and comes 0.1 m nearer each step.
    assert sim.scan[0, 0] == pytest.approx(1.7)
    stand(sim)
    assert sim.scan[0, 0] == pytest.approx(1.6)
    stand(sim)
    assert sim.scan[0, 0] == pytest.approx(1.5)


def test_a_mover_hides_what_is_behind_it_only(make_robot, simulate) -> None:
    wall = np.array([[3.0, -1.0, 3.0, 1.0]])
    world = World("both", BOUNDS, segments=wall, movers=(flyer(2.0, 0.0, np.pi / 2),))
    sim = simulate(make_robot(lidar=AHEAD), world, [[0.0, 0.0, 0.0]])
    assert sim.scan[0, 0] == pytest.approx(1.7)
    for _ in range(4):
        stand(sim)
    # After 0.4 m the disc of 0.3 m is past the beam.
    assert sim.scan[0, 0] == pytest.approx(3.0)


@pytest.mark.parametrize(("footprint", "front"), [(CIRCLE, 0.2), (BOX, 0.3)], ids=["circle", "box"])
def test_clearance_by_hand(make_robot, simulate, footprint, front: float) -> None:
    world = World("flyer", BOUNDS, movers=(flyer(2.0, 0.0, np.pi),))
    sim = simulate(make_robot(footprint=footprint), world, [[0.0, 0.0, 0.0]])
    assert sim.state.clearance[0] == pytest.approx(2.0 - 0.3 - front)
    stand(sim)
    assert sim.state.clearance[0] == pytest.approx(1.9 - 0.3 - front)


@pytest.mark.parametrize("footprint", [CIRCLE, BOX], ids=["circle", "box"])
def test_movers_are_seen_and_felt_like_discs(make_robot, simulate, footprint) -> None:
    rng = np.random.default_rng(0)
    discs = np.column_stack([rng.uniform(-4, 4, (9, 2)), rng.uniform(0.1, 0.6, 9)])
    movers = tuple(flyer(x, y, rng.uniform(-3, 3), radius=r) for x, y, r in discs[4:])
    world = World("mixed", BOUNDS, discs=discs[:4], movers=movers)
    robot = make_robot(footprint=footprint, lidar=full_circle(360) | {"x": 0.1, "yaw": 0.3})
    poses = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (40, 3))
    sim = simulate(robot, world, poses)
    for i, pose in enumerate(poses):
        still = World("still", BOUNDS, discs=np.concatenate([discs[:4], sim.movers(i)]))
        near = reference_clearance(still, robot, pose)
        assert max(sim.state.clearance[i], -0.01) == pytest.approx(max(near, -0.01), abs=1e-9)
        seen = reference_scan(still, robot, pose)
        # A beam along the very edge of a disc may fall on either side of it.
        wrong = ~np.isclose(sim.scan[i], seen, atol=1e-5, rtol=0)
        assert wrong.sum() <= 1


@pytest.mark.parametrize(("footprint", "front"), [(CIRCLE, 0.2), (BOX, 0.3)], ids=["circle", "box"])
def test_driven_at_by_a_mover_a_resting_robot_is_hit(
    make_robot, simulate, footprint, front: float
) -> None:
    # The gap of 0.47 m closes during the fifth step of 0.1 s.
    world = World("flyer", BOUNDS, movers=(flyer(0.77 + front, 0.0, np.pi),))
    sim = simulate(make_robot(footprint=footprint), world, [[0.0, 0.0, 0.0]])
    hit = []
    for _ in range(5):
        stand(sim)
        hit.append(bool(sim.state.contact[0]))
    assert hit == [False] * 4 + [True]
    assert sim.state.pose[0].tolist() == [0.0, 0.0, 0.0]


def test_a_touch_within_a_step_is_not_missed(make_robot, simulate) -> None:
    # A disc at 2 m/s passes so that it touches only in the middle of a step: at x = -0.1 and 0.1 it
    # is sqrt(0.1^2 + 0.495^2) = 0.505 m away, at x = 0 it is 0.495 m away and both radii are 0.5 m.
    world = World("flyer", BOUNDS, movers=(flyer(-0.7, 0.495, 0.0, speed=2.0),))
    sim = simulate(make_robot(footprint=CIRCLE), world, [[0.0, 0.0, 0.0]])
    hit = []
    for _ in range(6):
        stand(sim)
        hit.append(bool(sim.state.contact[0]))
    assert hit == [False] * 3 + [True] + [False] * 2


def test_driving_beside_a_mover_of_the_same_speed_touches_nothing(make_robot, simulate) -> None:
    robot = make_robot(footprint=CIRCLE, limits={"linear_acceleration": 1e9}, actuator={"lag_s": 0})
    world = World("flyer", BOUNDS, movers=(flyer(-3.4, 0.0, 0.0, speed=0.5),))
    sim = simulate(robot, world, [[-4.0, 0.0, 0.0]])
    for _ in range(60):
        sim.step(np.array([[0.5, 0.0]]))
        assert not sim.state.contact[0]
    # 0.1 m apart at first; the robot's first half step is at half speed.
    assert sim.state.clearance[0] == pytest.approx(0.1 + 0.5 * 0.05 * 0.5, abs=1e-9)


def spline(*keys: tuple[float, float, float]) -> Mover:
    rows = np.array(keys)
    return Mover("spline", 0.2, rows[:, 1:], times=rows[:, 0])


def track_simulator(make_robot, mover: Mover, pose, *, random_phase: bool = False, num_envs=1):
    pool = build_pool([World("track", BOUNDS, movers=(mover,))], 0.01, random_phase=random_phase)
    sim = PlanarSimulator(make_robot(footprint=CIRCLE), pool, num_envs)
    sim.seed(np.arange(num_envs))
    sim.reset()
    sim.place(np.arange(num_envs), np.tile(pose, (num_envs, 1)), np.zeros((num_envs, 2)))
    return sim


def test_spline_and_its_jump(make_robot) -> None:
    # Between two keys the tangents are the way itself halved, so that the middle is the middle.
    sim = track_simulator(make_robot, spline((0, 2, 0), (1, 0, 0)), [4.0, 4.0, 0.0])
    place = sim.state.mover_position[0, 0]
    assert place.tolist() == [2.0, 0.0]
    for _ in range(5):
        stand(sim)
    assert place == pytest.approx([1.0, 0.0])
    sim.place(np.array([0]), [[2.0, 0.0, 0.0]], [[0.0, 0.0]])
    for _ in range(4):
        stand(sim)
        assert not sim.state.contact[0]
    # At 1 s it jumps back to the first key, onto the robot that stands there now.
    for _ in range(2):
        stand(sim)
    assert place[0] > 1.8
    assert sim.state.contact[0]
    assert sim.state.clearance[0] < 0.0


def test_a_jump_sweeps_nothing_on_its_way(make_robot) -> None:
    sim = track_simulator(make_robot, spline((0, 4, 0), (1, -4, 0)), [0.0, 0.0, 0.0])
    stand(sim)
    sim.place(np.array([0]), [[0.0, 1.0, 0.0]], [[0.0, 0.0]])
    for _ in range(8):
        stand(sim)
    sim.place(np.array([0]), [[0.0, 0.0, 0.0]], [[0.0, 0.0]])
    for _ in range(3):
        stand(sim)
        assert not sim.state.contact[0]
    # 0.2 s after the jump: 4 - 8 (3 - 0.4) 0.04 for the way, and the tangents' -4 times
    # 0.2 (0.8)^2 - 0.8 (0.2)^2 = 0.096.
    assert sim.state.mover_position[0, 0, 0] == pytest.approx(4.0 - 0.832 - 0.384)


def test_loop_after_many_rounds(make_robot) -> None:
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    mover = Mover("loop", 0.2, corners, speed=0.5)
    sim = track_simulator(make_robot, mover, [4.0, 4.0, 0.0])
    for _ in range(830):
        stand(sim)
    # 83 s are ten rounds of 8 s and 3 s, in which it drives 1.5 m.
    assert sim.state.mover_position[0, 0] == pytest.approx([1.0, 0.5], abs=1e-9)
    assert sim.state.mover_velocity[0, 0] == pytest.approx([0.0, 0.5])


def test_random_phase_is_uniform(make_robot) -> None:
    mover = spline((0, -4, 0), (2, 4, 0))
    sim = track_simulator(make_robot, mover, [4, 4, 0], random_phase=True, num_envs=2000)
    clock = sim.state.mover_clock[:, 0] / 2.0
    # 2000 draws of U(0, 1): mean 0.5 +- 4 x 0.2887 / sqrt(2000). Starts keep away from the mover,
    # which makes the ends, where it is near fewer starts, a little likelier; not the mean.
    assert clock.mean() == pytest.approx(0.5, abs=0.026)
    assert clock.std() == pytest.approx(0.2887, abs=0.02)


def test_starts_are_out_of_reach_and_goals_need_not_be(make_robot) -> None:
    movers = tuple(flyer(x, y, 0.3, speed=0.5) for x in (-3.0, 0.0, 3.0) for y in (-3.0, 0.0, 3.0))
    pool = build_pool([World("flyers", BOUNDS, movers=movers)], 0.2)
    sim = PlanarSimulator(make_robot(footprint=CIRCLE), pool, 500)
    sim.seed(np.arange(500))
    sim.reset()
    # 0.2 m to spare and the 0.5 m that a mover flies in a second.
    assert sim.state.clearance.min() >= 0.2 + 0.5
    goals = np.linalg.norm(sim.state.goal[:, None] - sim.state.mover_position, axis=-1).min(axis=1)
    assert (goals < 0.3).any()


def test_pedestrians_make_way_for_a_fixed_start(make_robot) -> None:
    walkers = [Mover("pedestrian", 0.25, np.array([[x, 0.0]]), speed=1.0) for x in (0.1, 0.6, 3.0)]
    world = World("start", BOUNDS, start=(0.0, 0.0, 0.0), movers=tuple(walkers))
    sim = PlanarSimulator(make_robot(footprint=CIRCLE), build_pool([world], 0.2), 50)
    sim.seed(np.arange(50))
    sim.reset()
    # The first is on the robot; the second 0.6 - 0.25 - 0.2 = 0.15 m from it; both have to go.
    assert sim.state.clearance.min() >= 0.2
    assert (np.abs(sim.state.mover_position[:, :2, 1]) > 0.0).all()
    assert (sim.state.mover_position[:, 2] == [3.0, 0.0]).all()
    distance = np.linalg.norm(
        sim.state.mover_position[:, 0] - sim.state.mover_position[:, 1], axis=1
    )
    assert distance.min() >= 0.5


def all_kinds(rng: np.random.Generator) -> World:
    """Draw a world with something standing and movers of all kinds, well apart."""
    centres = 1.8 * np.array([[x, y] for x in (-2, -1, 0, 1, 2) for y in (-2, -1, 0, 1, 2)])
    places = rng.permutation(centres) + rng.uniform(-0.3, 0.3, (25, 2))
    walkers = [Mover("pedestrian", 0.25, p[None], speed=rng.uniform(0.8, 1.4)) for p in places[:6]]
    flyers = [flyer(*p, rng.uniform(-3, 3), speed=0.8, radius=0.2) for p in places[6:8]]
    track = Mover("spline", 0.3, places[8:11], times=np.array([0.0, 4.0, 7.0]))
    loop = Mover("loop", 0.3, places[11:14], speed=0.7)
    walls = np.array([[-5, -5, 5, -5], [5, -5, 5, 5], [5, 5, -5, 5], [-5, 5, -5, -5]], dtype=float)
    discs = np.column_stack([places[14:16], [0.3, 0.4]])
    movers = (*walkers, *flyers, track, loop)
    return World("all", BOUNDS, discs=discs, segments=walls, movers=movers)


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    """Return worlds with ten movers, one, and none."""
    worlds = [all_kinds(np.random.default_rng(seed)) for seed in range(3)]
    return build_pool([*worlds, World("one", BOUNDS, movers=(flyer(1, 1, 0.5),)), STANDING], 0.27)


@pytest.fixture
def threads() -> Iterator[None]:
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


def config(pedestrians: str = "orca") -> TaskConfig:
    task = task_config("static").model_dump() | {"time_limit_s": 4.0, "pedestrians": pedestrians}
    return TaskConfig.model_validate(task | {"robot_changes": {"lidar": full_circle(36)}})


def rollout(batch: NavigationBatch, first: int = 0, steps: int = 100) -> dict[str, NDArray]:
    """Drive by the actions of the environments ``first`` and on; return all of every step."""
    actions = np.random.default_rng(5).uniform(-1, 1, (steps, 64, 2))
    rows: dict[str, list[NDArray]] = {}
    for action in actions[:, first : first + batch.num_envs]:
        batch.step(action)
        for name, value in batch.simulator.state._asdict().items():
            rows.setdefault(name, []).append(value.copy())
    return {name: np.array(values) for name, values in rows.items()}


def begun(pool: WorldPool, num_envs: int, first: int = 0, **arguments) -> NavigationBatch:
    batch = NavigationBatch(config(**arguments), pool, num_envs)
    batch.reset(100 + first + np.arange(num_envs))
    return batch


def assert_bit_equal(one: dict[str, NDArray], two: dict[str, NDArray]) -> None:
    for name in one:
        assert one[name].tobytes() == two[name].tobytes(), name


@pytest.mark.parametrize("model", ["orca", "social_force"])
def test_environment_of_a_batch_equals_a_batch_of_one(pool: WorldPool, model: str) -> None:
    together = rollout(begun(pool, 40, pedestrians=model))
    # The worlds differ in their number of movers, and environments are stepped in chunks.
    assert set(np.unique(together["mover_count"])) == {0, 1, 10}
    for i in (0, 17, 39):
        alone = rollout(begun(pool, 1, first=i, pedestrians=model), first=i)
        assert_bit_equal({n: v[:, [i]].copy() for n, v in together.items()}, alone)


def test_number_of_threads_does_not_matter(pool: WorldPool, threads: None) -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("numba has one thread only")
    numba.set_num_threads(1)
    one = rollout(begun(pool, 40))
    numba.set_num_threads(2)
    assert_bit_equal(one, rollout(begun(pool, 40)))


def test_other_seeds_and_other_models_differ(pool: WorldPool) -> None:
    one, other = rollout(begun(pool, 8)), rollout(begun(pool, 8, first=50))
    assert not np.array_equal(one["mover_position"], other["mover_position"])
    forces = rollout(begun(pool, 8, pedestrians="social_force"))
    assert not np.array_equal(one["mover_position"], forces["mover_position"])


def test_saved_state_goes_on_as_if_it_had_never_stopped(pool: WorldPool) -> None:
    one, two = begun(pool, 16), begun(pool, 16, first=30)
    rollout(one, steps=50)
    # As a checkpoint keeps it: tensors of signed numbers.
    saved = {
        name: torch.from_numpy(v.view(np.int64) if v.dtype == np.uint64 else v)
        for name, v in one.state_dict().items()
    }
    two.load_state_dict({name: tensor.numpy() for name, tensor in saved.items()})
    assert_bit_equal(rollout(one), rollout(two))


def test_worlds_without_movers_are_as_if_there_were_no_others() -> None:
    alone = build_pool([STANDING], 0.27)
    beside = build_pool([STANDING, all_kinds(np.random.default_rng(0))], 0.27)
    found = []
    for pool in (alone, beside):
        batch = NavigationBatch(config(), pool, 8)
        batch.reset(np.arange(8), np.zeros(8, dtype=np.int64))
        found.append(rollout(batch, steps=30))
    names = [name for name in found[0] if not name.startswith("mover_")]
    assert found[0]["mover_position"].shape == (30, 8, 0, 2)
    assert found[1]["mover_position"].shape == (30, 8, 10, 2)
    assert (found[0]["world"] == 0).all()
    assert_bit_equal({n: found[0][n] for n in names}, found[1])
