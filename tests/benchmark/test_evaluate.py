# SPDX-License-Identifier: Apache-2.0
"""Evaluations: the same episodes for everybody, and answers that are checked."""

from __future__ import annotations

import json
from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.benchmark.evaluate import Evaluator, goal_in_base
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.planners import make_planner
from pm01_nav.robot import full_circle
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.worlds import world_pool

FEW_BEAMS = {"robot_changes": {"lidar": full_circle(36)}}


class Constant:
    """Answer always the same."""

    def __init__(self, v: float, w: float) -> None:
        self.command = (v, w)
        self.scans: list[NDArray[np.float32]] = []
        self.goals: list[NDArray[np.float64]] = []

    def reset(self) -> None:
        """Forget nothing."""

    def keep(self, robots) -> None:
        """Answer for fewer robots."""

    def act(self, scan, goal, velocity) -> NDArray[np.float64]:
        self.scans.append(np.array(scan))
        self.goals.append(np.array(goal))
        return np.tile(self.command, (len(goal), 1))


class Answering(Constant):
    """Answer with a given array."""

    def __init__(self, answer) -> None:
        super().__init__(0.0, 0.0)
        self.answer = answer

    def act(self, scan, goal, velocity):
        return self.answer


def task(name: str = "static", **changes) -> TaskConfig:
    return resolve_task(name, FEW_BEAMS | changes)


def first_sight(config: TaskConfig, episodes: int, seed: int) -> Constant:
    """Return a policy that has seen the beginning of each episode."""
    policy = Constant(0.0, 0.0)
    Evaluator(config, episodes, seed).run(policy)
    return policy


def test_same_seed_same_episodes_other_seed_others() -> None:
    config = task(time_limit_s=0.2)
    one, two, other = (first_sight(config, 6, seed) for seed in (0, 0, 1))
    assert (one.scans[0] == two.scans[0]).all()
    assert (one.goals[0] == two.goals[0]).all()
    assert (one.goals[0] != other.goals[0]).any()


def test_episode_is_the_same_whatever_their_number() -> None:
    config = task(time_limit_s=0.1)
    few, more = (first_sight(config, count, 3) for count in (4, 9))
    assert (few.scans[0] == more.scans[0][:4]).all()
    assert (few.goals[0] == more.goals[0][:4]).all()


def test_episode_is_the_same_whatever_their_number_even_if_it_is_large() -> None:
    config = task(time_limit_s=0.1)
    few, more = (first_sight(config, count, 3) for count in (2, 300))
    assert (few.goals[0] == more.goals[0][:2]).all()


def test_each_policy_meets_the_same_episodes() -> None:
    evaluator = Evaluator(task(time_limit_s=0.5), 4, 0)
    one, two = Constant(0.5, 0.0), Constant(-0.2, 1.0)
    evaluator.run(one)
    evaluator.run(two)
    assert (one.goals[0] == two.goals[0]).all()


@pytest.mark.parametrize("answer", [np.zeros((4, 3)), np.zeros((3, 2)), np.zeros(2), 0.0])
def test_an_answer_of_the_wrong_shape_loses_every_episode(answer) -> None:
    results, _ = Evaluator(task("empty", time_limit_s=0.3), 4, 0).run(Answering(answer))
    assert not (results.success | results.collision).any()
    for reason in results.failure:
        assert "answered with shape" in reason
        assert "instead of (1, 2)" in reason


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_row_that_is_not_finite_loses_its_episode_only(bad: float) -> None:
    answer = np.array([[0.0, 0.0]] * 3 + [[0.0, bad]])
    results, _ = Evaluator(task("empty", time_limit_s=0.3), 4, 0).run(Answering(answer))
    assert results.failure.tolist() == [""] * 3 + ["answered with NaN or infinity"]
    # It lost before its first step; the others stand until their time is up.
    assert results.steps.tolist() == [3, 3, 3, 0]


class AfraidOf(Constant):
    """Drive on, but raise an error at the sight of some goals."""

    def __init__(self, goals) -> None:
        super().__init__(0.2, 0.0)
        self.feared = goals

    def act(self, scan, goal, velocity) -> NDArray[np.float64]:
        if (np.abs(np.asarray(goal)[:, None] - self.feared) < 1e-9).all(axis=2).any():
            raise RuntimeError("not that one")
        return super().act(scan, goal, velocity)


def test_a_policy_that_raises_loses_that_episode_only() -> None:
    evaluator = Evaluator(task("empty", time_limit_s=0.4), 9, 0)
    evaluator.run(seen := Constant(0.0, 0.0))
    results, _ = evaluator.run(AfraidOf(seen.goals[0][[2, 7]]))
    reasons = ["RuntimeError: not that one" if k in (2, 7) else "" for k in range(9)]
    assert results.failure.tolist() == reasons
    undisturbed, _ = evaluator.run(Constant(0.2, 0.0))
    others = [k for k in range(9) if k not in (2, 7)]
    assert (results.steps[others] == undisturbed.steps[others]).all()
    assert results.path_length[others] == pytest.approx(undisturbed.path_length[others])


def test_failures_are_neither_collisions_nor_timeouts() -> None:
    answer = np.array([[0.0, 0.0]] * 3 + [[0.0, np.nan]])
    evaluator = Evaluator(task("empty", time_limit_s=0.3), 4, 0)
    summary = evaluator.summary(Answering(answer))
    assert (summary["timeout_rate"], summary["failure_rate"]) == (0.75, 0.25)
    assert summary["failures"] == {"answered with NaN or infinity": 1}


def test_later_episodes_alone() -> None:
    config = task(time_limit_s=0.1)
    whole, later = Constant(0.0, 0.0), Constant(0.0, 0.0)
    Evaluator(config, 6, 3).run(whole)
    results, _ = Evaluator(config, 2, 3, first=4).run(later)
    assert (later.scans[0] == whole.scans[0][4:]).all()
    assert (later.goals[0] == whole.goals[0][4:]).all()
    assert results.world.tolist() == [4, 5]


def test_goal_seeking_solves_the_empty_room() -> None:
    config = task("empty")
    summary = Evaluator(config, 32, 0).summary(
        make_planner("goal_seeking", config.robot_spec(), config.control_dt)
    )
    assert summary["success_rate"] >= 0.95
    assert summary["episodes"] == 32
    assert summary["success_rate"] + summary["collision_rate"] + summary["timeout_rate"] == 1.0
    low, high = summary["success_rate_ci95"]
    assert low <= summary["success_rate"] <= high
    # Nearly straight ways: turning at the start costs a little.
    assert 0.8 < summary["spl"] <= 1.0


def test_scripted_drive_by_hand() -> None:
    # The article's robot starts at (0, 0, 0), at rest. Straight on at 0.5 m/s it comes, if nothing
    # stops it, 0.05 m further a step, less what it takes to get up to speed.
    config = task("article", robot_changes={"lidar": full_circle(20)}, time_limit_s=1.0)
    results, seconds = Evaluator(config, 8, 0).run(Constant(0.5, 0.0))
    free = ~(results.success | results.collision)
    assert free.sum() >= 4
    assert seconds > 0.0
    assert (results.steps[free] == 10).all()
    # At 2 m/s^2 and with a lag of 0.05 s the start costs 0.5 x (0.125 + 0.05) = 0.0875 m at most.
    assert (results.path_length[free] <= 0.5).all()
    assert (results.path_length[free] >= 0.5 - 0.0875).all()
    # The first 0.1 m take 0.3 to 0.4 s, to the full step; the clock starts after it.
    assert results.moving_time[free] == pytest.approx(0.65, abs=0.0501)


def test_standing_still_is_a_timeout() -> None:
    results, _ = Evaluator(task(time_limit_s=0.7), 5, 0).run(Constant(0.0, 0.0))
    assert not results.success.any()
    assert not results.collision.any()
    assert (results.steps == 7).all()
    for name in ("path_length", "moving_time", "jerk"):
        assert (getattr(results, name) == 0.0).all()
    assert {len(getattr(results, f.name)) for f in fields(results)} == {5}


def test_driving_blindly_collides() -> None:
    results, _ = Evaluator(task("empty"), 8, 0).run(Constant(0.5, 0.0))
    # Straight on in a closed room: a wall or, by luck, the goal.
    assert (results.collision ^ results.success).all()
    assert results.collision.sum() >= 6
    assert (results.min_clearance[results.collision] <= 0.05 + 1e-9).all()


def test_shortest_path_ends_at_the_goal_radius() -> None:
    results, _ = Evaluator(task("empty", time_limit_s=0.1), 6, 0).run(seen := Constant(0, 0))
    straight = np.linalg.norm(seen.goals[0], axis=1)
    assert results.shortest_path == pytest.approx(straight - 0.3, abs=1e-9)


def test_episodes_end_alike_alone_and_beside_others() -> None:
    # Those that are done are left out of the batch; it must change nothing for the others.
    config = task("mixed", time_limit_s=30.0)
    planner = make_planner("goal_seeking", config.robot_spec(), config.control_dt)
    together, _ = Evaluator(config, 24, 0).run(planner)
    assert len(set(together.steps.tolist())) > 12
    pool = world_pool(config, "held_out", 24)
    for k in range(24):
        batch = NavigationBatch(config, pool, 1, autoreset=False)
        batch.reset([k], np.array([k]))
        state, length, over = batch.simulator.state, 0.0, False
        start, nearest = state.pose[0, :2].copy(), float(state.clearance[0])
        while not over:
            command = planner.act(batch.simulator.scan, goal_in_base(batch), np.zeros((1, 2)))
            step = batch.advance(command)
            length += float(np.hypot(*(step.pose[0, :2] - start)))
            start, nearest = step.pose[0, :2].copy(), min(nearest, float(step.clearance[0]))
            over = bool(step.reached[0] | step.collided[0]) or int(step.count[0]) == 300
        assert together.steps[k] == step.count[0]
        assert together.success[k] == step.reached[0]
        assert together.collision[k] == step.collided[0]
        assert together.path_length[k] == pytest.approx(length)
        assert together.min_clearance[k] == pytest.approx(nearest)


@pytest.fixture
def dynabarn(tmp_path):
    """Return the task of one DynaBARN world whose only disc moves far from the straight way."""
    file = {
        "radius": 0.3,
        "walls_cx_cy_sx_sy": [[0.0, 6.0, 24.0, 0.2], [0.0, -6.0, 24.0, 0.2]],
        "start": [11.0, 0.0, 3.141592653589793],
        "goal": [-9.0, 0.0],
        "worlds": [{"id": 300, "obstacles": ["far"]}],
        "trajectories": {"far": [[0, -5, 4], [5, 5, 4], [10, -5, 4]]},
    }
    path = tmp_path / "dynabarn.json"
    path.write_text(json.dumps(file), encoding="utf-8")
    return resolve_task("dynabarn", {"worlds": str(path)})


def test_dynabarn_scores_with_the_true_length_and_as_published(dynabarn: TaskConfig) -> None:
    planner = make_planner("goal_seeking", dynabarn.robot_spec(), dynabarn.control_dt)
    summary = Evaluator(dynabarn, 2, 0).summary(planner)
    assert summary["success_rate"] == 1.0
    # 19 m to the goal's radius of 1 m at 2 m/s: about 9.5 s and what the start takes, less than
    # twice the 10 s that 20 m take. 10 / 20, and 10 / 40 by the rule of 2022.
    assert 9.4 <= summary["time_to_goal_s"] <= 10.5
    assert summary["barn_score_2024"] == pytest.approx(0.5)
    assert summary["barn_score_2022"] == pytest.approx(0.25)
    assert summary["dynabarn_score_as_published"] == pytest.approx(0.125)
    assert summary["barn_worlds"] == 1


def test_worlds_from_files_are_visited_in_turn(dynabarn: TaskConfig) -> None:
    evaluator = Evaluator(dynabarn.model_copy(update={"time_limit_s": 0.1}), 1, 0)
    results, _ = evaluator.run(Constant(0.0, 0.0), np.arange(7, 10))
    assert results.world.tolist() == [0, 0, 0]
    assert results.reference_path == pytest.approx([20.0] * 3)
