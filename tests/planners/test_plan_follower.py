# SPDX-License-Identifier: Apache-2.0
"""A blind planner alone and led by a global plan, in worlds made to catch it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError
from pm01_nav.planners import make_planner
from pm01_nav.planners.plan_follower import PATIENCE, PlanFollower
from pm01_nav.robot import full_circle
from pm01_nav.task.config import TaskConfig
from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.global_plan import inflate
from pm01_nav.worlds.suites import SOURCES, suite
from pm01_nav.worlds.world import World

RADIUS = 0.27


def walls(*corners: tuple[float, float]) -> list[tuple[float, float, float, float]]:
    """Return the segments of an open line through some corners."""
    return [(*a, *b) for a, b in pairwise(corners)]


def world(name: str, size: float, lines, start, goal_area) -> World:
    """Return a square room with some walls."""
    room = walls((0, 0), (size, 0), (size, size), (0, size), (0, 0))
    segments = np.array([*room, *lines], dtype=np.float64)
    bounds = (0.0, 0.0, size, size)
    return World(name, bounds, segments=segments, start=start, goal_area=goal_area)


TRAPS = {
    # A wall across the room with a gap of 1 m at its upper end.
    "gap": world("gap", 8.0, walls((4, 0), (4, 7)), (2.0, 2.0, 0.0), (6.0, 1.0, 7.0, 4.0)),
    # The robot stands in a pocket that opens away from the goal.
    "u_trap": world(
        "u_trap",
        8.0,
        walls((2.5, 3), (5, 3), (5, 5), (2.5, 5)),
        (4.3, 4.0, 0.0),
        (6.5, 3.5, 7.5, 4.5),
    ),
    # Two and a half turns of a corridor of 1.2 m from the middle outwards.
    "spiral": world(
        "spiral",
        9.0,
        walls((4, 4), (5.2, 4), (5.2, 5.2), (2.8, 5.2), (2.8, 2.8), (6.4, 2.8), (6.4, 6.4)),
        (4.5, 4.6, 0.0),
        (7.2, 7.2, 8.2, 8.2),
    ),
}


@pytest.fixture
def trap(request, monkeypatch) -> TaskConfig:
    """Return the task of driving in one of the worlds."""

    def trap(_: np.random.Generator) -> World:
        return TRAPS[request.param]

    monkeypatch.setitem(SOURCES, "trap", None)  # to be taken out again
    suite()(trap)
    changes = {"suite": "trap", "robot_changes": {"lidar": full_circle(36)}}
    return resolve_task("static", changes | {"time_limit_s": 80.0, "goal_distance": (0, None)})


@pytest.mark.parametrize("trap", TRAPS, indirect=True)
def test_blind_planner_fails_alone_and_succeeds_with_a_plan(trap: TaskConfig) -> None:
    policy = make_planner("goal_seeking", trap.robot_spec(), trap.control_dt)
    alone = Evaluator(trap, 40, 0).summary(policy)
    led = Evaluator(trap, 40, 0, look_ahead=2.0).summary(policy)
    assert alone["success_rate"] == 0.0
    assert led["success_rate"] >= 0.95
    assert led["global_plan_look_ahead_m"] == 2.0
    assert "global_plan_look_ahead_m" not in alone


def test_static_worlds_are_crossed_blindly_with_a_plan() -> None:
    config = resolve_task("static", {"robot_changes": {"lidar": full_circle(36)}})
    policy = make_planner("goal_seeking", config.robot_spec(), config.control_dt)
    alone = Evaluator(config, 100, 0).summary(policy)["success_rate"]
    led = Evaluator(config, 100, 0, look_ahead=2.0).summary(policy)["success_rate"]
    # Many of these worlds are harmless: the goal lies in plain sight.
    assert alone < 0.8
    assert led >= 0.95


def follower(poses, goals, trap: str = "gap", **arguments) -> PlanFollower:
    costmap = inflate(free_space(TRAPS[trap], RADIUS), RADIUS)
    return PlanFollower([costmap] * len(poses), np.array(goals, dtype=np.float64), **arguments)


def test_goal_in_sight_is_the_goal_in_the_robots_frame() -> None:
    poses = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, np.pi / 2], [2.0, 4.0, np.pi]])
    goals = [(3.0, 3.0), (3.0, 3.0), (2.0, 5.0)]
    # Ahead is x, left is y.
    expected = [(1.0, 1.0), (1.0, -1.0), (0.0, -1.0)]
    led = follower(poses, goals, look_ahead=5.0).goals_in_base(poses)
    assert led == pytest.approx(np.array(expected), abs=1e-9)


def test_goals_of_robots_in_a_batch_are_those_of_each_alone() -> None:
    poses = np.array([[2.0, 2.0, 0.3], [1.0, 5.0, -1.0], [6.0, 1.0, 2.0]])
    goals = [(7.0, 2.0), (6.0, 4.0), (1.0, 1.0)]
    together = follower(poses, goals).goals_in_base(poses)
    for pose, goal, point in zip(poses, goals, together, strict=True):
        alone = follower([pose], [goal]).goals_in_base(pose[None])
        assert (alone[0] == point).all()


def test_kept_robots_keep_their_plans() -> None:
    poses = np.array([[2.0, 2.0, 0.3], [1.0, 5.0, -1.0], [6.0, 1.0, 2.0]])
    guide = follower(poses, [(7.0, 2.0), (6.0, 4.0), (1.0, 1.0)])
    together, plans = guide.goals_in_base(poses), guide.plans
    some = np.array([2, 0])
    guide.keep(some)
    assert (guide.goals_in_base(poses[some]) == together[some]).all()
    assert [guide.plans[0], guide.plans[1]] == [plans[2], plans[0]]


def test_strayed_robot_gets_a_new_plan_but_not_at_every_step() -> None:
    pose = np.array([[2.0, 2.0, 0.0]])
    guide = follower(pose, [(6.5, 2.0)])
    guide.goals_in_base(pose)
    first = guide.plans[0]
    # Carried to the other side of the wall, over which the old plan leads.
    carried = np.array([[5.5, 1.0, 0.0]])
    led = guide.goals_in_base(carried)
    second = guide.plans[0]
    assert second is not first
    assert second.path[0].tolist() == [5.5, 1.0]
    assert led[0] == pytest.approx(np.array([1.0, 1.0]))
    guide.goals_in_base(pose)
    assert guide.plans[0] is second
    for _ in range(PATIENCE):
        guide.goals_in_base(pose)
    assert guide.plans[0] is not second


def test_robot_off_the_map_keeps_its_plan() -> None:
    pose = np.array([[2.0, 2.0, 0.0]])
    guide = follower(pose, [(6.5, 2.0)])
    guide.goals_in_base(pose)
    plan = guide.plans[0]
    assert np.isfinite(guide.goals_in_base(np.array([[-3.0, 2.0, 0.0]]))).all()
    assert guide.plans[0] is plan


def test_unreachable_goal_and_impossible_distance_are_refused() -> None:
    pose = np.array([[2.0, 2.0, 0.0]])
    with pytest.raises(InputError, match=r"goal = \(20\.00, 2\.00\)"):
        follower(pose, [(20.0, 2.0)]).goals_in_base(pose)
    for distance in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="look_ahead"):
            follower(pose, [(3.0, 2.0)], look_ahead=distance)
