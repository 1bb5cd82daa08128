# SPDX-License-Identifier: Apache-2.0
"""What holds for every planner: limits, batches, memory, and getting there."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.benchmark.evaluate import Evaluator, goal_in_base
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError
from pm01_nav.planners import PLANNERS, make_planner
from pm01_nav.planners.guided import _not_too_near
from pm01_nav.planners.scan_planner import clean_ranges
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import load_robot
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.scans import scan_geometry
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.global_plan import GlobalPlan, inflate
from pm01_nav.worlds.suites import SOURCES, suite
from pm01_nav.worlds.world import World

AVOIDING = sorted(set(PLANNERS) - {"goal_seeking"})
WITH_A_MAP = sorted(set(AVOIDING) - {"gap_following"})


@pytest.fixture(params=sorted(PLANNERS))
def planner(request) -> Policy:
    return make_planner(request.param, load_robot("pm01"), 0.1)


def drive(planners: list[Policy], steps: int, robots: int) -> list[NDArray[np.float64]]:
    """Let planners command robots in rooms; the last but one drives one robot each."""
    config = resolve_task("rooms", {})
    pool = world_pool(config, "held_out", robots)
    batch = NavigationBatch(config, pool, robots, autoreset=False)
    batch.reset(np.arange(robots), np.arange(robots))
    commands = []
    for planner in planners:
        planner.reset()
    for _ in range(steps):
        sim = batch.simulator
        seen = sim.scan, goal_in_base(batch), sim.measured_twist
        if len(planners) == 1:
            command = planners[0].act(*seen)
        else:
            rows = [p.act(*(part[i] for part in seen)) for i, p in enumerate(planners)]
            command = np.stack(rows)
        batch.advance(command)
        commands.append(command)
    return commands


@pytest.mark.parametrize("name", sorted(PLANNERS))
def test_a_robot_of_a_batch_is_driven_like_one_alone(name: str) -> None:
    robot = load_robot("pm01")
    together = drive([make_planner(name, robot, 0.1)], 25, 3)
    alone = drive([make_planner(name, robot, 0.1) for _ in range(3)], 25, 3)
    assert np.array(together) == pytest.approx(np.array(alone), abs=1e-9)


def test_commands_keep_to_the_limits(planner: Policy) -> None:
    robot = load_robot("pm01")
    rng = np.random.default_rng(0)
    for _ in range(20):
        scan = rng.choice([0.2, 0.5, 1.5, 3.0, 9.0, np.inf, -np.inf, np.nan], (50, 360))
        goal, velocity = rng.uniform(-5, 5, (50, 2)), rng.uniform(-0.2, 0.5, (50, 2))
        command = planner.act(scan.astype(np.float32), goal, velocity)
        assert command.shape == (50, 2)
        assert np.isfinite(command).all()
        assert (command[:, 0] >= robot.limits.linear_min - 1e-9).all()
        assert (command[:, 0] <= robot.limits.linear_max + 1e-9).all()
        assert (np.abs(command[:, 1]) <= robot.limits.angular_max + 1e-9).all()


@pytest.mark.parametrize("name", AVOIDING)
@pytest.mark.parametrize(
    ("scan", "goal", "velocity", "message"),
    [
        (np.ones(359), (1.0, 0.0), (0.0, 0.0), "360 ranges"),
        (np.full(360, np.nan), (1.0, 0.0), (0.0, 0.0), "every range is NaN"),
        (np.full(360, -1.0), (1.0, 0.0), (0.0, 0.0), "must not be negative"),
        (np.ones(360), (np.nan, 0.0), (0.0, 0.0), "goal"),
        (np.ones(360), (1.0, 0.0), (np.inf, 0.0), "velocity"),
    ],
)
def test_what_no_sensor_says_is_refused(name, scan, goal, velocity, message: str) -> None:
    planner = make_planner(name, load_robot("pm01"), 0.1)
    with pytest.raises(InputError, match=message):
        planner.act(scan, goal, velocity)


def test_a_clean_scan_by_rep_117() -> None:
    geometry = scan_geometry(load_robot("pm01").lidar)  # 0.12 to 3.5 m
    raw = np.array([0.5, np.inf, -np.inf, np.nan, 0.05, 3.6, 3.5], dtype=np.float32)
    expected = [0.5, np.inf, 0.12, np.inf, np.inf, np.inf, 3.5]
    assert clean_ranges(raw, geometry) == pytest.approx(expected)


def settled(planner: Policy, goal) -> NDArray[np.float64]:
    """Return a planner's answer to a sight that stays; some improve an answer step by step."""
    for _ in range(15):
        command = planner.act(np.full(360, np.inf), goal, [0.0, 0.0])
    return command


def test_nothing_in_the_way_it_drives_straight_to_the_goal(planner: Policy) -> None:
    command = settled(planner, [3.0, 0.0])
    assert command[0] > 0.1
    assert abs(command[1]) < 0.3


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_turns_to_a_goal_beside_it(planner: Policy, side: float) -> None:
    command = settled(planner, [0.0, 3.0 * side])
    assert command[1] * side > 0.3


@pytest.mark.parametrize("name", sorted(PLANNERS))
def test_kept_robots_are_driven_on(name: str) -> None:
    whole, part = (make_planner(name, load_robot("pm01"), 0.1) for _ in range(2))
    rng = np.random.default_rng(1)
    some = np.array([3, 1])
    for step in range(30):
        scan = rng.uniform(0.5, 4.0, (4, 360))
        goal, velocity = np.tile([[2.0, 1.0]], (4, 1)), np.full((4, 2), 0.1)
        expected = whole.act(scan, goal, velocity)
        if step < 15:
            part.act(scan, goal, velocity)
            continue
        if step == 15:
            part.keep(some)
        command = part.act(scan[some], goal[some], velocity[some])
        assert command == pytest.approx(expected[some], abs=1e-9)


@pytest.mark.parametrize("name", ["regulated_pure_pursuit", "dwa", "mppi"])
def test_it_does_not_creep_into_a_wall(name: str) -> None:
    # A post 3.5 cm before the footprint (0.17 m), in a half circle of posts; the goal lies behind.
    planner = make_planner(name, load_robot("pm01"), 0.1)
    scan = np.full(360, np.inf)
    for distance in np.arange(0.205, 0.171, -0.001):
        planner.reset()
        scan[120:241] = distance
        velocity = [0.0, 0.0]
        for _ in range(3):
            command = planner.act(scan, [3.0, 0.0], velocity)
            assert command[0] <= 1e-9


def test_a_jackal_does_not_turn_its_corner_into_a_wall() -> None:
    # The footprint reaches 0.208 m to the side and 0.309 m to its corners; the wall is at 0.30 m.
    robot = load_robot("jackal")
    planner = make_planner("regulated_pure_pursuit", robot, 0.1)
    side = np.sin(robot.lidar.angles)
    scan = np.where(side > 0.02, 0.3 / np.maximum(side, 0.02), np.inf)
    command = planner.act(np.where(scan < 4.0, scan, np.inf), [-3.0, 0.1], [0.0, 0.0])
    assert abs(command[1]) < 0.5


def test_a_point_at_the_robots_own_place_is_not_aimed_at() -> None:
    # The look-ahead point is the robot's place when nothing further is seen.
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    space = FreeSpace(np.ones((20, 20), dtype=np.bool_), 0.1, (-0.5, -0.5))
    costmap = inflate(space, 0.17)
    plan = GlobalPlan(costmap, path)
    plan.progress = 0.9
    assert _not_too_near(plan, np.array([0.9, 0.0])) == pytest.approx([1.0, 0.2])
    assert _not_too_near(plan, np.array([1.0, 0.5])) == pytest.approx([1.0, 0.5])


def test_mppi_drives_on_at_nearly_full_speed() -> None:
    # The goal stays 3 m ahead, and the robot does as it is told: 0.5 m/s is its greatest speed.
    # Noise that is the same at each step added up to commands that differ from step to step.
    planner = make_planner("mppi", load_robot("pm01"), 0.1)
    velocity, commands = np.zeros(2), []
    for _ in range(40):
        velocity = planner.act(np.full(360, np.inf), [3.0, 0.0], velocity)
        commands.append(velocity)
    late = np.array(commands[20:])
    assert late[:, 0].mean() > 0.4
    assert np.abs(np.diff(late[:, 1])).mean() < 0.1


@pytest.fixture
def wall(monkeypatch):
    """Return the task of driving around a wall that stands between start and goal."""
    walls = np.array([[4.0, 2.5, 4.0, 5.5]])
    border = np.array([[0, 0, 8, 0], [8, 0, 8, 8], [8, 8, 0, 8], [0, 8, 0, 0]], dtype=float)
    world = World(
        "wall",
        (0.0, 0.0, 8.0, 8.0),
        segments=np.concatenate([border, walls]),
        start_area=(2.0, 3.5, 2.5, 4.5),
        goal_area=(5.5, 3.5, 6.0, 4.5),
    )

    def wall(_: np.random.Generator) -> World:
        return world

    monkeypatch.setitem(SOURCES, "wall", None)  # to be taken out again
    suite()(wall)
    return resolve_task("static", {"suite": "wall", "goal_distance": (0, None)})


@pytest.mark.parametrize("name", AVOIDING)
def test_it_drives_around_a_wall(name: str, wall) -> None:
    planner = make_planner(name, wall.robot_spec(), wall.control_dt)
    results, _ = Evaluator(wall, 8, 0).run(planner)
    assert not results.collision.any()
    assert results.success.sum() >= (7 if name in WITH_A_MAP else 4)
