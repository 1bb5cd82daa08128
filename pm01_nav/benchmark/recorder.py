# SPDX-License-Identifier: Apache-2.0
"""Sum up running episodes: what a figure of merit is made of, step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.people import mover_gaps
from pm01_nav.task.terminations import out_of_time
from pm01_nav.worlds.mover_arrays import PEDESTRIAN

START_RADIUS = 0.1
"""BARN's clock starts when the robot has moved this far [m]."""
TURNING = 0.2
"""A robot turns to a side if it does so faster than this [rad/s]."""
PERSONAL_SPACE = 0.5
"""No pedestrian should come nearer to the circle around the footprint than this [m]."""

MAX_REASON = 200
"""Characters kept of why a policy failed."""

FloatArray = NDArray[np.float64]


@dataclass
class EpisodeResults:
    """What happened in each of n episodes; arrays (n,)."""

    world: NDArray[np.int64]
    success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    steps: NDArray[np.int64]
    moving_time: FloatArray
    """From the first 0.1 m to the end [s]."""
    path_length: FloatArray
    """[m]"""
    shortest_path: FloatArray
    """From start to goal radius [m]; infinity if the planner found no way."""
    reference_path: FloatArray
    """Length by which BARN judges the time [m]; NaN in other worlds."""
    min_clearance: FloatArray
    """Least distance from the footprint to an obstacle, the start included [m]."""
    mean_clearance: FloatArray
    """Mean of that distance over the steps [m]."""
    jerk: FloatArray
    """Mean over the steps of |v(t) - 2 v(t - dt) + v(t - 2 dt)| / dt^2 [m/s^3]."""
    turn_reversals: FloatArray
    """How often the robot turns to the other side: from w > 0.2 rad/s to w < -0.2 rad/s or back,
    whatever lies between, per minute of driving [1/min]."""
    intrusion: FloatArray
    """Share of the steps with a pedestrian within 0.5 m of the circle around the footprint.

    It is 1 minus the personal space compliance of Francis et al. 2023 (arXiv:2306.16740);
    NaN without pedestrians.
    """
    failure: NDArray[np.str_]
    """Why an episode broke off: the policy's error or unusable answer, or the simulator's; mostly
    empty."""


@dataclass
class Recorder:
    """Sums up episodes that a batch drives; arrays (num_episodes,)."""

    dt: float
    episode: NDArray[np.int64]
    """Which episode each robot of the batch drives, shape (num_envs,)."""
    active: NDArray[np.bool_]
    pedestrians: NDArray[np.bool_]
    """Whether there are any in the episode's world."""
    start: FloatArray
    position: FloatArray
    speeds: FloatArray
    """v of the last step and of the one before [m/s], shape (2, num_episodes)."""
    path_length: FloatArray
    min_clearance: FloatArray
    moved_at: NDArray[np.int64]
    clearance_sum: FloatArray
    jerk_sum: FloatArray
    side: NDArray[np.int64]
    """To which side the robot last turned: 1 left, -1 right, 0 neither yet."""
    reversals: NDArray[np.int64]
    intruded: NDArray[np.int64]
    """Steps with a pedestrian in the robot's personal space."""
    steps: NDArray[np.int64]
    success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    failure: list[str]

    @classmethod
    def begin(cls, batch: NavigationBatch) -> Recorder:
        """Start recording at the present state, one episode a robot."""
        state, n = batch.simulator.state, batch.num_envs
        return cls(
            dt=batch.config.control_dt,
            episode=np.arange(n),
            active=np.ones(n, dtype=np.bool_),
            pedestrians=_with_pedestrians(batch),
            start=state.pose[:, :2].copy(),
            position=state.pose[:, :2].copy(),
            speeds=np.tile(state.twist[:, 0], (2, 1)),
            path_length=np.zeros(n),
            min_clearance=state.clearance.copy(),
            moved_at=np.full(n, -1),
            clearance_sum=np.zeros(n),
            jerk_sum=np.zeros(n),
            side=np.zeros(n, dtype=np.int64),
            reversals=np.zeros(n, dtype=np.int64),
            intruded=np.zeros(n, dtype=np.int64),
            steps=np.zeros(n, dtype=np.int64),
            success=np.zeros(n, dtype=np.bool_),
            collision=np.zeros(n, dtype=np.bool_),
            failure=[""] * n,
        )

    @property
    def driving(self) -> NDArray[np.int64]:
        """The robots of the batch whose episodes go on."""
        return np.flatnonzero(self.active[self.episode])

    def lose(self, robots: NDArray[np.int64], reason: str) -> None:
        """End the episodes of these robots of the batch, if they go on, and note why."""
        for episode in self.episode[robots]:
            if self.active[episode]:
                self.failure[episode] = reason[:MAX_REASON]
                self.active[episode] = False

    def record(self, batch: NavigationBatch, command: FloatArray) -> None:
        """Advance the batch by one step and add what happened to the active episodes."""
        robots = self.driving
        step = batch.advance(command)
        now, position = self.episode[robots], step.pose[robots, :2]
        self.path_length[now] += np.linalg.norm(position - self.position[now], axis=1)
        self.position[now] = position
        self.min_clearance[now] = np.minimum(self.min_clearance[now], step.clearance[robots])
        self.steps[now] = step.count[robots]
        far = np.linalg.norm(position - self.start[now], axis=1) >= START_RADIUS
        first = now[far & (self.moved_at[now] < 0)]
        self.moved_at[first] = self.steps[first]
        self.clearance_sum[now] += step.clearance[robots]
        self._add_jerk(now, step.twist[robots, 0])
        self._add_turn(now, step.twist[robots, -1])
        if self.pedestrians.any():
            self.intruded[now] += self._intruding(batch)[robots]
        self.success[now], self.collision[now] = step.reached[robots], step.collided[robots]
        for robot, reason in step.faults.items():
            self.lose(np.array([robot]), reason)
        over = step.reached | step.collided | out_of_time(step, batch.config)
        self.active[now] &= ~over[robots]

    def _add_jerk(self, now: NDArray[np.int64], speed: FloatArray) -> None:
        last, before = self.speeds[:, now]
        # The first step knows no acceleration before it.
        jerk = np.abs(speed - 2.0 * last + before) / self.dt**2
        self.jerk_sum[now] += np.where(self.steps[now] > 1, jerk, 0.0)
        self.speeds[:, now] = speed, last

    def _add_turn(self, now: NDArray[np.int64], turn: FloatArray) -> None:
        side = np.where(np.abs(turn) > TURNING, np.sign(turn).astype(np.int64), 0)
        self.reversals[now] += self.side[now] * side < 0
        self.side[now] = np.where(side == 0, self.side[now], side)

    def _intruding(self, batch: NavigationBatch) -> NDArray[np.bool_]:
        """Tell which robots of the batch have a pedestrian in their personal space."""
        state, arrays = batch.simulator.state, batch.simulator.pool.arrays
        rows = arrays.mover_begin[state.world][:, None] + np.arange(state.mover_radius.shape[1])
        kind = arrays.mover_kind[np.minimum(rows, len(arrays.mover_kind) - 1)]
        gap = mover_gaps(state, batch.robot.footprint.circumscribed_radius)
        return ((kind == PEDESTRIAN) & (gap < PERSONAL_SPACE)).any(axis=1)

    def results(
        self, world: NDArray[np.int64], shortest: FloatArray, reference: FloatArray
    ) -> EpisodeResults:
        """Return what was recorded, together with what is known of each episode's world."""
        moved_at = np.where(self.moved_at < 0, self.steps, self.moved_at)
        return EpisodeResults(
            world=world,
            success=self.success,
            collision=self.collision,
            steps=self.steps,
            moving_time=self.dt * (self.steps - moved_at).astype(np.float64),
            path_length=self.path_length,
            shortest_path=shortest,
            reference_path=reference,
            min_clearance=self.min_clearance,
            mean_clearance=self.clearance_sum / np.maximum(self.steps, 1),
            jerk=self.jerk_sum / np.maximum(self.steps - 1, 1),
            turn_reversals=60.0 * self.reversals / np.maximum(self.dt * self.steps, self.dt),
            intrusion=np.where(self.pedestrians, self.intruded / np.maximum(self.steps, 1), np.nan),
            failure=np.array(self.failure, dtype=np.str_),
        )


def _with_pedestrians(batch: NavigationBatch) -> NDArray[np.bool_]:
    """Tell in which robots' worlds there are pedestrians."""
    arrays, world = batch.simulator.pool.arrays, batch.simulator.state.world
    counts = np.concatenate([[0], np.cumsum(arrays.mover_kind == PEDESTRIAN)])
    return counts[arrays.mover_begin[world + 1]] > counts[arrays.mover_begin[world]]
