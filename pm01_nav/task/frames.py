# SPDX-License-Identifier: Apache-2.0
"""A memory of the last scans, which tells what moves from what stands still.

Environments and policies keep it alike, in this class.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.arrays import NUMPY, Arrays, array_namespace
from pm01_nav.durations import whole_steps
from pm01_nav.errors import InputError


@dataclass(frozen=True)
class FramesLayout:
    """Which earlier scans are shown beside the present one."""

    count: int = 2
    """How many."""
    interval_s: float = 0.3
    """Time between one and the next [s], rounded to control periods."""

    def __post_init__(self) -> None:
        """Refuse numbers that are not positive.

        Raises:
            InputError: names the first one.
        """
        for name, value in asdict(self).items():
            if not 0 < value < math.inf:
                raise InputError(f"frames.{name} = {value}: must be above 0")


class FrameStack:
    """The last scans of n robots, each as observations show it (``Scan.present``)."""

    def __init__(
        self,
        layout: FramesLayout,
        control_dt: float,
        num_robots: int,
        sectors: int,
        arrays: Arrays = NUMPY,
    ) -> None:
        """Make room; ``begin`` fills it. ``control_dt`` [s] lies between two scans."""
        interval = whole_steps(layout.interval_s, control_dt)
        self._ago = [interval * k for k in range(layout.count + 1)]
        self.length = self._ago[-1] + 1
        """How many scans are remembered; after so many steps each lies where it lay before."""
        shape = (self.length, num_robots, sectors)
        self._ring = arrays.xp.zeros(shape, dtype=arrays.xp.float32, device=arrays.place)
        self._now = np.zeros(1, dtype=np.int64)

    def begin(self, robots: NDArray[np.int64] | slice, scan: NDArray[np.float32]) -> None:
        """Let some robots have seen nothing but ``scan`` (n, sectors)."""
        self._ring[:, robots] = scan

    def begin_where(self, begins: Any, scan: Any) -> None:
        """Let the robots of a mask (num_robots,) have seen nothing but ``scan`` (num_robots, n)."""
        xp = array_namespace(scan)
        self._ring[...] = xp.where(begins[None, :, None], scan[None], self._ring)

    def push(self, scan: NDArray[np.float32], steps: int = 1) -> None:
        """Go on by ``steps`` control steps, in which the robots saw ``scan`` (num_robots, sectors).

        With 0 it stands for the newest one.
        """
        for _ in range(steps):
            self._now[0] = (self._now[0] + 1) % len(self._ring)
            self._ring[self._now[0]] = scan
        if steps == 0:
            self._ring[self._now[0]] = scan

    def show(self, robots: NDArray[np.int64] | slice) -> list[NDArray[np.float32]]:
        """Return the present scan and the earlier ones, newest first, each (n, sectors)."""
        now = int(self._now[0])
        return [self._ring[now - ago, robots] for ago in self._ago]

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        self._ring = self._ring[:, robots]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that make up the memory, not copied."""
        return {"frames": self._ring, "frame_now": self._now}
