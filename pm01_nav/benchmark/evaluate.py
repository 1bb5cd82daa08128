# SPDX-License-Identifier: Apache-2.0
"""Run a policy on a task's held-out worlds and measure how well it drives."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends import BACKENDS
from pm01_nav.benchmark.recorder import EpisodeResults, Recorder
from pm01_nav.benchmark.summary import summarize
from pm01_nav.policy.protocol import Policy
from pm01_nav.provenance import shown
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.free_space import shortest_path_length
from pm01_nav.worlds.global_plan import inflate
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.suites import world_source_of

if TYPE_CHECKING:
    from pm01_nav.planners.plan_follower import PlanFollower

CHUNK = 1024
"""Episodes simulated side by side."""

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
            from pm01_nav.planners.plan_follower import PlanFollower  # loads all planners

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


class PolicyFailureError(Exception):
    """A policy raised an error or answered with something unusable."""


class Evaluator:
    """The same held-out episodes for every policy that it runs.

    Episode k is the same for the same seed, whatever the number of episodes. Worlds from files
    are visited in turn.
    """

    def __init__(
        self,
        config: TaskConfig,
        episodes: int,
        seed: int,
        *,
        first: int = 0,
        look_ahead: float | None = None,
    ) -> None:
        """Make or read the worlds of the episodes ``first`` to ``first + episodes``.

        With ``look_ahead`` [m] the policies are given points of a global plan instead of the goal;
        success is judged at the goal all the same.

        Raises:
            InputError: the worlds cannot be had.
        """
        self.config, self.episodes, self.seed = config, episodes, seed
        self.first, self.look_ahead = first, look_ahead
        self._held_out = world_source_of(config.suite).held_out
        self.pool = world_pool(config, "held_out", episodes, seed, first=first)
        self._reference = np.array([world.reference_length for world in self.pool.worlds])
        self._shortest: dict[int, float] = {}

    def run(self, policy: Policy, numbers: IntArray | None = None) -> tuple[EpisodeResults, float]:
        """Run every episode; return the results and the wall time of driving [s].

        ``numbers`` are those of the episodes, if not all; in worlds from files they may lie outside
        the evaluator's own. A policy that raises an error or answers with something unusable loses
        that episode.
        """
        if numbers is None:
            numbers = np.arange(self.first, self.first + self.episodes)
        chunks, seconds = [], 0.0
        at_once = min(CHUNK, BACKENDS[self.config.backend].most_robots or CHUNK)
        for begin in range(0, len(numbers), at_once):
            parts, took = self._run(policy, numbers[begin : begin + at_once])
            chunks += parts
            seconds += took
        return _join(chunks), seconds

    def _run(self, policy: Policy, numbers: IntArray) -> tuple[list[EpisodeResults], float]:
        """Run some episodes; if the policy fails, halves of them, until it is clear in which."""
        batch = self.begin(numbers)
        shortest = self._shortest_paths(batch, numbers)
        source = GoalSource(batch, self.pool, self.look_ahead)
        began = time.perf_counter()
        try:
            recorder = _drive(policy, batch, source)
        except PolicyFailureError:
            runs = [self._run(policy, half) for half in np.array_split(numbers, 2)]
            return [part for parts, _ in runs for part in parts], sum(took for _, took in runs)
        seconds = time.perf_counter() - began
        world = self._world(numbers)
        return [recorder.results(world, shortest, self._reference[self._place(numbers)])], seconds

    def begin(self, numbers: IntArray) -> NavigationBatch:
        """Return a batch at the beginning of these episodes, one a robot."""
        batch = NavigationBatch(self.config, self.pool, len(numbers), autoreset=False)
        batch.reset((self.seed << 32) + numbers, self._place(numbers))
        return batch

    def _place(self, numbers: IntArray) -> IntArray:
        """Return where in the pool the worlds of these episodes are."""
        return (numbers - self.first * self._held_out) % len(self.pool)

    def _world(self, numbers: IntArray) -> IntArray:
        """Return a number for the world of each episode, the same in all evaluations."""
        return numbers if self._held_out else numbers % len(self.pool)

    def _shortest_paths(self, batch: NavigationBatch, numbers: IntArray) -> FloatArray:
        """Return the shortest length from each start to its goal's radius [m]."""
        state = batch.simulator.state
        for i, number in enumerate(numbers.tolist()):
            if number not in self._shortest:
                space = self.pool.free_space(int(state.world[i]))
                start = (float(state.pose[i, 0]), float(state.pose[i, 1]))
                goal = (float(state.goal[i, 0]), float(state.goal[i, 1]))
                length = shortest_path_length(space, start, goal) - self.config.goal_radius
                self._shortest[number] = max(length, 0.0)
        return np.array([self._shortest[number] for number in numbers.tolist()])

    def summary(self, policy: Policy) -> dict[str, Any]:
        """Run every episode; return the figures of merit as plain data."""
        results, seconds = self.run(policy)
        summary = {"seed": self.seed} | summarize(results, self.config)
        steps = int(results.steps.sum())
        summary["steps_per_second"] = round(steps / seconds, 1) if seconds > 0 else None
        if self.look_ahead is not None:
            summary["global_plan_look_ahead_m"] = self.look_ahead
        return summary


def _drive(policy: Policy, batch: NavigationBatch, source: GoalSource) -> Recorder:
    """Drive every robot of a fresh batch until its episode ends.

    Episodes take a few hundred steps, the longest thousands: whenever half of the robots are done
    they are left out, else most of the time would go into robots that nobody looks at.

    Raises:
        PolicyFailureError: the policy failed, and it cannot be told with which robot.
    """
    policy.reset()
    recorder = Recorder.begin(batch)
    while len(driving := recorder.driving):
        if fewer := 2 * len(driving) <= batch.num_envs:
            batch.keep(driving)
            source.keep(driving)
            recorder.episode = recorder.episode[driving]
        try:
            command = answer(policy, batch, source, driving if fewer else None)
        except PolicyFailureError as failure:
            if batch.num_envs > 1:
                raise
            recorder.lose(np.array([0]), str(failure))
            break
        usable = np.all(np.isfinite(command), axis=1)
        recorder.lose(np.flatnonzero(~usable), "answered with NaN or infinity")
        recorder.record(batch, np.where(usable[:, None], command, 0.0))
    return recorder


def answer(
    policy: Policy,
    batch: NavigationBatch,
    source: GoalSource,
    left: IntArray | None = None,
) -> FloatArray:
    """Return the policy's commands; a row that is not finite is the policy's failure there.

    ``left`` are those of the robots of its last answer that go on, if not all.

    Raises:
        PolicyFailureError: the policy raised an error, or its answer has the wrong shape.
    """
    simulator = batch.simulator
    scan, goal, twist = simulator.scan, source.goals(), simulator.measured_twist
    try:
        if left is not None:
            policy.keep(left)
        command = np.asarray(policy.act(scan, goal, twist), dtype=np.float64)
    except Exception as error:  # whatever a policy may raise must not end the evaluation
        raise PolicyFailureError(shown(f"{type(error).__name__}: {error}")) from error
    wanted = (batch.num_envs, batch.layout.drive.size)
    if command.shape != wanted:
        raise PolicyFailureError(f"answered with shape {command.shape} instead of {wanted}")
    return command


def _join(chunks: list[EpisodeResults]) -> EpisodeResults:
    names = EpisodeResults.__dataclass_fields__
    return EpisodeResults(**{n: np.concatenate([getattr(c, n) for c in chunks]) for n in names})
