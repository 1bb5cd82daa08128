# SPDX-License-Identifier: Apache-2.0
"""From raw sensor values to a command, by way of the observation contract and a network."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.arrays import NUMPY
from pm01_nav.policy.inputs import check_scan, finite_numbers, finite_pair
from pm01_nav.policy.step_timer import StepTimer
from pm01_nav.task.observation import ObservationLayout, Observer
from pm01_nav.task.parts import Memory, ObservationPart, Seen
from pm01_nav.task.scans import discard_invalid

Network = Callable[..., Any]
"""Observations in physical units (n, size) -> commands (n, axes) [m/s, rad/s].

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
        self._observer: Observer | None = None
        self._timer = StepTimer(control_dt)
        self._network = network
        self._previous: NDArray[np.float64] | None = None
        self._shape: tuple[int, ...] = ()

    def reset(self) -> None:
        """Forget the last action and all that its parts remember before a new episode."""
        self._previous = None
        self._memory = None
        self._observer = None
        self._timer.reset()

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these rows of a batch (n, ...) only."""
        if self._previous is not None:
            self._previous = self._previous[robots]
            self._shape = self._previous.shape
        if self._observer is not None:
            self._observer.keep(robots)
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
        """Return the next command (..., axes) [m/s, rad/s], of one robot or many.

        ``scan`` (..., num_beams): raw ranges [m] by REP-117 (+inf no return, -inf too close, NaN
        invalid). ``goal`` (..., 2): x forward and y left in base_link [m]. ``velocity``
        (..., axes): measured v and w, or vx, vy and w [m/s, rad/s].

        On a robot the rest tells its memory what went on since the last call. ``now``: the time, by
        any clock that does not jump [s]; without it ``control_dt`` went by. ``applied``
        (..., axes): the command that the robot was given; without it that was the last answer.
        ``pose`` (..., 3): by odometry [m, m, rad]; without it ``velocity`` tells how far it came.

        Raises:
            InputError: a length is wrong, a range is negative, no range of a scan is valid, or
                another number is not finite.
        """
        ranges = check_scan(scan, self.layout.scan)
        goal = finite_pair(goal, "goal")
        axes = self.layout.drive.size
        shape = (*goal.shape[:-1], axes)
        if applied is not None:
            applied = finite_numbers(applied, "applied", axes)
            applied = np.broadcast_to(applied, shape).reshape(-1, axes)
        velocity = finite_numbers(velocity, "velocity", axes)
        velocity = np.broadcast_to(velocity, shape).reshape(-1, axes)
        ranges = np.broadcast_to(ranges, (*shape[:-1], ranges.shape[-1]))
        ranges = ranges.reshape(-1, ranges.shape[-1])
        x, y = goal.reshape(-1, 2).T
        polar = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=-1)
        begins = self._previous is None or self._shape != shape
        if begins:
            self.reset()
            self._shape = shape
        elapsed = self._timer.next(now, pose)
        if elapsed.paused:
            # What a network remembers cannot be moved on.
            self._previous = self._memory = None
        previous = self._previous_action(len(polar), applied, begins)
        ranges = discard_invalid(ranges, self.layout.scan)
        observation = self._observe(Seen(ranges, polar, velocity, previous, elapsed))
        command = self._answer(observation).astype(np.float64)
        self._previous = self.layout.drive.to_action(command)
        return command.reshape(shape)

    def _observe(self, seen: Seen) -> NDArray[np.float32]:
        """Take note of what is seen, and return what the network is shown, (n, size)."""
        if self._observer is None:
            self._observer = Observer(self.layout, self._remember)
            self._observer.begin(seen)
        elif seen.elapsed.paused:
            self._observer.forget(seen)
        self._observer.push(seen)
        return self._observer.show(seen)

    def _remember(self, part: ObservationPart) -> Memory:
        return part.memory(math.prod(self._shape[:-1]), self.control_dt, NUMPY)

    def _previous_action(
        self, count: int, applied: NDArray[np.float64] | None, begins: bool
    ) -> NDArray[np.float64]:
        """Return what each robot was given last as an action in [-1, 1], (count, axes)."""
        if applied is None:
            nothing = np.zeros((count, self.layout.drive.size))
            return nothing if self._previous is None else self._previous
        action = self.layout.drive.to_action(applied)
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
