# SPDX-License-Identifier: Apache-2.0
"""From raw sensor values to a command, by way of the observation contract and a network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.policy.inputs import check_scan, finite_pair
from pm01_nav.policy.step_timer import Elapsed, StepTimer
from pm01_nav.task.frames import FrameStack
from pm01_nav.task.observation import (
    ObservationLayout,
    build_observation,
    discard_invalid,
    pool_sectors,
    show_ranges,
)
from pm01_nav.task.trail import Trail

Network = Callable[..., Any]
"""Observations in physical units (n, size) -> commands (n, 2) [m/s, rad/s].

A network that remembers is given its memory (n, memory_size) as well, zeros at first, and returns
commands and memory.
"""


class NetworkPolicy:
    """A network behind the ``Policy`` protocol."""

    def __init__(
        self,
        layout: ObservationLayout,
        network: Network,
        control_dt: float,
        memory_size: int = 0,
    ) -> None:
        """Show ``network`` what ``layout`` says, every ``control_dt`` [s].

        ``memory_size`` is how many numbers it remembers of a robot.
        """
        self.layout = layout
        self.control_dt = control_dt
        self.memory_size = memory_size
        self._memory: NDArray[np.float32] | None = None
        self._trail: Trail | None = None
        self._frames: FrameStack | None = None
        self._timer = StepTimer(control_dt)
        self._network = network
        self._previous: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Forget the last action, scans and places before a new episode."""
        self._previous = None
        self._memory = None
        self._trail = None
        self._frames = None
        self._timer.reset()

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these rows of a batch (n, ...) only."""
        if self._previous is not None:
            self._previous = self._previous[robots]
        if self._trail is not None:
            self._trail.keep(robots)
        if self._frames is not None:
            self._frames.keep(robots)
        if self._memory is not None:
            self._memory = self._memory[robots]
        self._timer.keep(robots)

    def act(
        self,
        scan: ArrayLike,
        goal: ArrayLike,
        velocity: ArrayLike,
        *,
        now: float | None = None,
        applied: ArrayLike | None = None,
        pose: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Return the next command (v, w) [m/s, rad/s]; one robot, or a leading batch dimension.

        ``scan`` (..., num_beams): raw ranges [m] by REP-117 (+inf no return, -inf too close, NaN
        invalid). ``goal`` (..., 2): x forward and y left in base_link [m]. ``velocity`` (..., 2):
        measured v and w [m/s, rad/s].

        On a robot the rest tells its memory what went on since the last call. ``now``: the time, by
        any clock that does not jump [s]; without it ``control_dt`` went by. ``applied`` (..., 2):
        the command that the robot was given [m/s, rad/s]; without it that was the last answer.
        ``pose`` (..., 3): by odometry [m, m, rad]; without it ``velocity`` tells how far it came.

        Raises:
            InputError: a length is wrong, a range is negative, no range of a scan is valid, or
                another number is not finite.
        """
        ranges = check_scan(scan, self.layout.scan)
        goal = finite_pair(goal, "goal")
        if applied is not None:
            applied = np.broadcast_to(finite_pair(applied, "applied"), goal.shape)
        polar = np.stack(
            [np.hypot(goal[..., 0], goal[..., 1]), np.arctan2(goal[..., 1], goal[..., 0])], axis=-1
        )
        velocity = np.broadcast_to(finite_pair(velocity, "velocity"), goal.shape)
        begins = self._previous is None or self._previous.shape != goal.shape
        if begins:
            self.reset()
        elapsed = self._timer.next(now, pose)
        if elapsed.paused:
            self._resume(elapsed)
        previous = self._previous_action(goal.shape, applied, begins)
        ranges = discard_invalid(ranges, self.layout.scan)
        scan = np.asarray(show_ranges(self.layout, pool_sectors(ranges, self.layout.sectors)))
        scans = self._with_earlier(scan, elapsed)
        visited = self._visited(velocity, elapsed)
        observation = build_observation(self.layout, scans, polar, velocity, previous, visited)
        batch = observation.reshape(-1, self.layout.size)
        command = self._answer(batch).astype(np.float64).reshape(goal.shape)
        self._previous = self.layout.limits.to_action(command)
        return command

    def _resume(self, elapsed: Elapsed) -> None:
        """Begin anew after a pause, but for places: odometry tells how far the robot came."""
        self._previous = None
        self._memory = None
        self._frames = None
        if elapsed.motion is None:
            self._trail = None

    def _previous_action(
        self, shape: tuple[int, ...], applied: NDArray[np.float64] | None, begins: bool
    ) -> NDArray[np.float64]:
        """Return what the robot was given last as an action in [-1, 1], of ``shape``."""
        if applied is None:
            return np.zeros(shape) if self._previous is None else self._previous
        action = self.layout.limits.to_action(applied)
        if not begins:
            return action
        # A robot at rest begins an episode, where environments show 0.
        return np.where(applied.any(axis=-1, keepdims=True), action, 0.0)

    def _answer(self, batch: NDArray[np.float32]) -> NDArray[np.float32]:
        if not self.memory_size:
            return self._network(batch)
        if self._memory is None:
            self._memory = np.zeros((len(batch), self.memory_size), dtype=np.float32)
        command, self._memory = self._network(batch, self._memory)
        return command

    def _with_earlier(
        self, scan: NDArray[np.float32], elapsed: Elapsed
    ) -> list[NDArray[np.float32]]:
        """Return this scan and the earlier ones, newest first, if the layout shows those."""
        layout = self.layout.frames
        if layout is None:
            return [scan]
        rows = scan.reshape(-1, scan.shape[-1])
        if self._frames is None:
            self._frames = FrameStack(layout, *rows.shape)
            self._frames.begin(slice(None), rows)
        self._frames.push(rows, elapsed.steps)
        return [frame.reshape(scan.shape) for frame in self._frames.show(slice(None))]

    def _visited(
        self, velocity: NDArray[np.float64], elapsed: Elapsed
    ) -> NDArray[np.float32] | None:
        """Follow the trail, if the layout has one; shape (..., trail size)."""
        layout = self.layout.trail
        if layout is None:
            return None
        rows = velocity.reshape(-1, 2)
        if self._trail is None:
            self._trail = Trail(layout, self.control_dt, len(rows))
        seconds, steps, _, motion = elapsed
        shown = self._trail.follow(rows, seconds=seconds, steps=steps, motion=motion)
        return shown.reshape(*velocity.shape[:-1], layout.size)
