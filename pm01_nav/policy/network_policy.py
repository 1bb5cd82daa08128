# SPDX-License-Identifier: Apache-2.0
"""From raw sensor values to a command, by way of the observation contract and a network."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.policy.inputs import check_scan, finite_pair
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
        self._network = network
        self._previous: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Forget the last action, scans and places before a new episode."""
        self._previous = None
        self._memory = None
        self._trail = None
        self._frames = None

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

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return the next command (v, w) [m/s, rad/s]; one robot, or a leading batch dimension.

        ``scan`` (..., num_beams): raw ranges [m] by REP-117 (+inf no return, -inf too close, NaN
        invalid). ``goal`` (..., 2): x forward and y left in base_link [m]. ``velocity`` (..., 2):
        measured v and w [m/s, rad/s].

        Raises:
            InputError: a length is wrong, a range is negative, no range of a scan is valid, or
                goal or velocity are not finite.
        """
        ranges = check_scan(scan, self.layout.scan)
        goal = finite_pair(goal, "goal")
        polar = np.stack(
            [np.hypot(goal[..., 0], goal[..., 1]), np.arctan2(goal[..., 1], goal[..., 0])], axis=-1
        )
        velocity = np.broadcast_to(finite_pair(velocity, "velocity"), goal.shape)
        if self._previous is None or self._previous.shape != goal.shape:
            self.reset()
            self._previous = np.zeros_like(goal)
        ranges = discard_invalid(ranges, self.layout.scan)
        scan = np.asarray(show_ranges(self.layout, pool_sectors(ranges, self.layout.sectors)))
        scans, visited = self._with_earlier(scan), self._visited(velocity)
        observation = build_observation(
            self.layout, scans, polar, velocity, self._previous, visited
        )
        batch = observation.reshape(-1, self.layout.size)
        command = self._answer(batch).astype(np.float64).reshape(goal.shape)
        self._previous = self.layout.limits.to_action(command)
        return command

    def _answer(self, batch: NDArray[np.float32]) -> NDArray[np.float32]:
        if not self.memory_size:
            return self._network(batch)
        if self._memory is None:
            self._memory = np.zeros((len(batch), self.memory_size), dtype=np.float32)
        command, self._memory = self._network(batch, self._memory)
        return command

    def _with_earlier(self, scan: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Return this scan and the earlier ones, newest first, if the layout shows those."""
        layout = self.layout.frames
        if layout is None:
            return [scan]
        rows = scan.reshape(-1, scan.shape[-1])
        if self._frames is None:
            self._frames = FrameStack(layout, *rows.shape)
            self._frames.begin(slice(None), rows)
        self._frames.push(rows)
        return [frame.reshape(scan.shape) for frame in self._frames.show(slice(None))]

    def _visited(self, velocity: NDArray[np.float64]) -> NDArray[np.float32] | None:
        """Follow the trail by one step, if the layout has one; shape (..., trail size)."""
        layout = self.layout.trail
        if layout is None:
            return None
        rows = velocity.reshape(-1, 2)
        if self._trail is None:
            self._trail = Trail(layout, self.control_dt, len(rows))
        return self._trail.follow(rows).reshape(*velocity.shape[:-1], layout.size)
