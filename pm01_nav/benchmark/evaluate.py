# SPDX-License-Identifier: Apache-2.0
"""Run a policy on a task's held-out worlds and measure how well it drives."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.metrics import barn_score, spl, wilson_interval
from pm01_nav.benchmark.recorder import EpisodeResults, Recorder
from pm01_nav.errors import InputError
from pm01_nav.planners.plan_follower import PlanFollower
from pm01_nav.policy.protocol import Policy
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.barn import load_barn
from pm01_nav.worlds.free_space import shortest_path_length
from pm01_nav.worlds.global_plan import inflate
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.world import World

CHUNK = 1024
"""Episodes simulated side by side."""
DYNABARN_SUCCESS = 0.125
"""What the challenge's script gives for any success on DynaBARN."""
SIMULATOR = "pm01 planar simulator, not the official BARN evaluation"

FloatArray = NDArray[np.float64]


def goal_in_base(batch: NavigationBatch) -> FloatArray:
    """Return every goal as the robot has it: x forward, y left [m], shape (num_envs, 2)."""
    distance, bearing = batch.simulator.measured_goal.T
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=-1)


class GoalSource:
    """What a policy is told to drive to: the goal, or a point of a global plan to it."""

    def __init__(self, batch: NavigationBatch, pool: WorldPool, look_ahead: float | None) -> None:
        """Plan from where the robots stand, if ``look_ahead`` [m] is given.

        Plans see the static world only.
        """
        self._batch = batch
        self._follower: PlanFollower | None = None
        if look_ahead is not None:
            state = batch.simulator.state
            costmaps = {
                int(w): inflate(pool.free_space(int(w)), pool.radius)
                for w in np.unique(state.world)
            }
            own = [costmaps[int(w)] for w in state.world]
            self._follower = PlanFollower(own, state.goal, look_ahead)

    def goals(self) -> FloatArray:
        """Return x forward and y left of each robot's goal now [m], shape (num_envs, 2)."""
        if self._follower is None:
            return goal_in_base(self._batch)
        return self._follower.goals_in_base(self._batch.simulator.measured_pose)

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        if self._follower is not None:
            self._follower.keep(robots)


class Evaluator:
    """The same held-out episodes for every policy that it runs.

    Episode k is the same for the same seed, whatever the number of episodes. Worlds from files
    are visited in turn.
    """

    def __init__(
        self, config: TaskConfig, episodes: int, seed: int, *, look_ahead: float | None = None
    ) -> None:
        """Make or read the worlds.

        With ``look_ahead`` [m] the policies are given points of a global plan instead of the goal;
        success is judged at the goal all the same.

        Raises:
            InputError: the worlds cannot be had.
        """
        self.config, self.episodes, self.seed = config, episodes, seed
        self.look_ahead = look_ahead
        self.pool = world_pool(config, "held_out", episodes, seed)
        self._shortest: dict[int, FloatArray] = {}

    def run(self, policy: Policy) -> tuple[EpisodeResults, float]:
        """Run every episode; return the results and the wall time of driving [s].

        Raises:
            InputError: the policy answers with something unusable.
        """
        chunks, seconds = [], 0.0
        for first in range(0, self.episodes, CHUNK):
            count = min(CHUNK, self.episodes - first)
            batch = NavigationBatch(self.config, self.pool, count, autoreset=False)
            numbers = np.arange(first, first + count)
            batch.reset((self.seed << 32) + numbers, numbers % len(self.pool))
            if first not in self._shortest:
                self._shortest[first] = _shortest_paths(batch, self.pool)
            world = batch.simulator.state.world
            source = GoalSource(batch, self.pool, self.look_ahead)
            began = time.perf_counter()
            recorder = _drive(policy, batch, source)
            seconds += time.perf_counter() - began
            chunks.append(recorder.results(world, self._shortest[first]))
        return _join(chunks), seconds

    def summary(self, policy: Policy) -> dict[str, Any]:
        """Run every episode; return the figures of merit as plain data."""
        results, seconds = self.run(policy)
        summary = {"seed": self.seed} | summarize(results, self.config, seconds)
        if self.look_ahead is not None:
            summary["global_plan_look_ahead_m"] = self.look_ahead
        if self.config.suite == "barn" and self.config.worlds is not None:
            summary |= summarize_barn(results, load_barn(self.config.worlds).path_lengths)
        if self.config.suite == "dynabarn":
            summary |= summarize_dynabarn(results, self.pool.worlds)
        return summary


def _drive(policy: Policy, batch: NavigationBatch, source: GoalSource) -> Recorder:
    """Drive every robot of a fresh batch until its episode ends.

    Episodes take a few hundred steps, the longest thousands: whenever half of the robots are done
    they are left out, else most of the time would go into robots that nobody looks at.
    """
    policy.reset()
    recorder = Recorder.begin(batch)
    while len(driving := recorder.driving):
        if 2 * len(driving) <= batch.num_envs:
            for part in (batch, policy, source):
                part.keep(driving)
            recorder.episode = recorder.episode[driving]
        simulator = batch.simulator
        command = policy.act(simulator.scan, source.goals(), simulator.measured_twist)
        recorder.record(batch, _checked(command, batch.num_envs))
    return recorder


def summarize(results: EpisodeResults, config: TaskConfig, seconds: float) -> dict[str, Any]:
    """Return the figures of merit as plain data."""
    n = len(results.success)
    timeout = ~(results.success | results.collision)
    won = results.success
    known = np.isfinite(results.shortest_path)
    summary: dict[str, Any] = {"task": config.name, "robot": config.robot, "episodes": n}
    for name, outcome in (
        ("success_rate", won),
        ("collision_rate", results.collision),
        ("timeout_rate", timeout),
    ):
        summary[name] = float(outcome.mean())
        summary[f"{name}_ci95"] = list(wilson_interval(int(outcome.sum()), n))
    steps = int(results.steps.sum())
    summary |= {
        "spl": spl(won[known], results.shortest_path[known], results.path_length[known])
        if known.any()
        else None,
        "time_to_goal_s": _mean(results.steps[won] * config.control_dt),
        "path_length_m": _mean(results.path_length[won]),
        "min_clearance_m": _mean(results.min_clearance),
        "mean_clearance_m": _mean(results.mean_clearance),
        "mean_jerk": _mean(results.jerk),
        "turn_reversals_per_min": _mean(results.turn_reversals),
        "personal_space_intrusion": _mean(
            results.intrusion[np.isfinite(results.intrusion)],
        ),
        "steps_per_second": round(steps / seconds, 1) if seconds > 0 else None,
    }
    return summary


def summarize_barn(results: EpisodeResults, path_lengths: FloatArray) -> dict[str, Any]:
    """Return the BARN challenge's scores, labelled as ours; ``path_lengths`` (num_worlds,) [m]."""
    length = path_lengths[results.world]
    worlds = np.unique(results.world)

    def mean_over_worlds(values: FloatArray) -> float:
        return float(np.mean([values[results.world == w].mean() for w in worlds]))

    scores = {
        "barn_score_2024": barn_score(results.success, length, results.moving_time, (2, 8)),
        "barn_score_2022": barn_score(results.success, length, results.moving_time, (4, 8)),
    }
    won = results.success & (results.moving_time > 0)
    ratio = length[won] / 2.0 / results.moving_time[won]
    return {name: mean_over_worlds(s) for name, s in scores.items()} | {
        "barn_optimal_over_actual_time": _mean(ratio),
        "barn_worlds": len(worlds),
        "barn_evaluated_in": SIMULATOR,
    }


def summarize_dynabarn(results: EpisodeResults, worlds: Sequence[World]) -> dict[str, Any]:
    """Return DynaBARN's scores, labelled as ours: with the way's true length, and as published.

    The challenge's script takes the way from start to goal for -31 m long, so that each success
    scores 0.125, however long it took.
    """
    lengths = []
    for world in worlds:
        assert world.start is not None
        assert world.goal_area is not None
        ends = np.array(world.start[:2]) - np.array(world.goal_area[:2])
        lengths.append(float(np.linalg.norm(ends)))
    scores = summarize_barn(results, np.array(lengths))
    return scores | {
        "dynabarn_score_as_published": DYNABARN_SUCCESS * float(results.success.mean())
    }


def _shortest_paths(batch: NavigationBatch, pool: WorldPool) -> FloatArray:
    """Return the shortest length from each start to its goal's radius [m]."""
    state = batch.simulator.state
    spaces = {int(w): pool.free_space(int(w)) for w in np.unique(state.world)}
    lengths = np.zeros(batch.num_envs)
    for i in range(batch.num_envs):
        start = (float(state.pose[i, 0]), float(state.pose[i, 1]))
        goal = (float(state.goal[i, 0]), float(state.goal[i, 1]))
        lengths[i] = shortest_path_length(spaces[int(state.world[i])], start, goal)
    return np.maximum(lengths - batch.config.goal_radius, 0.0)


def _checked(command: FloatArray, count: int) -> FloatArray:
    command = np.asarray(command, dtype=np.float64)
    if command.shape != (count, 2) or not np.isfinite(command).all():
        raise InputError(f"the policy's commands must be finite and of shape ({count}, 2)")
    return command


def _mean(values: NDArray[Any]) -> float | None:
    return None if len(values) == 0 or math.isnan(values.mean()) else float(values.mean())


def _join(chunks: list[EpisodeResults]) -> EpisodeResults:
    names = EpisodeResults.__dataclass_fields__
    return EpisodeResults(**{n: np.concatenate([getattr(c, n) for c in chunks]) for n in names})
