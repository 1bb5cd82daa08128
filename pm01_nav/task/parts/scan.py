# SPDX-License-Identifier: Apache-2.0
"""What the lidar sees now, and what it saw before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pm01_nav.arrays import Arrays, array_namespace
from pm01_nav.errors import InputError
from pm01_nav.task.frames import FramesLayout, FrameStack
from pm01_nav.task.parts.base import (
    NO_MEMORY,
    Memory,
    ObservationPart,
    Seen,
    clip,
    observation_part,
)


@observation_part
@dataclass(frozen=True)
class Scan(ObservationPart):
    """The scan, after it the earlier ones, newest first; shape (sectors,) or (scans, sectors)."""

    name = "scan"

    sectors: int = 0
    """The scan's nearest return in each of so many sectors; 0 keeps every beam."""
    nearness_distance: float = 0.3
    """A return at r metres is shown as (d - r) / (d + r) with this d [m]; 0 shows r itself.

    It spreads out the last decimetres, which decide whether a corner is cut or hit: with ranges
    themselves a policy went on scraping corners (94 % success), with nearness it learned not to
    (98 %), all else equal.
    """
    frames: FramesLayout | None = None
    """Which earlier scans are shown; None shows the present one alone."""

    def __post_init__(self) -> None:
        """Read ``frames`` from plain data; refuse sectors without a beam.

        Raises:
            InputError: there are more sectors than beams, or ``frames`` is not allowed.
        """
        if isinstance(self.frames, Mapping):
            object.__setattr__(self, "frames", FramesLayout(**self.frames))
        if not 0 <= self.sectors <= self.lidar.num_beams:
            raise InputError(
                f"sectors = {self.sectors}: must be from 0 to the number of beams, "
                f"{self.lidar.num_beams}"
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Sectors; before them scans, if there are earlier ones."""
        sectors = self.sectors or self.lidar.num_beams
        return (1 + self.frames.count, sectors) if self.frames else (sectors,)

    @property
    def bounds(self) -> tuple[float, float]:
        """Those of nearness, or of ranges [m]."""
        return (-1.0, 1.0) if self.nearness_distance > 0.0 else (0.0, self.lidar.range_max)

    @property
    def closed(self) -> bool:
        """Whether the last beam lies beside the first one."""
        turn = self.lidar.num_beams * self.lidar.angle_increment
        return math.isclose(turn, 2.0 * math.pi, rel_tol=1e-3)

    @property
    def needs(self) -> Mapping[str, Any]:
        """The nearest range of each sector."""
        return {"sectors": self.sectors}

    def memory(self, count: int, control_dt: float, arrays: Arrays) -> Memory:
        """Return room for the earlier scans."""
        if self.frames is None:
            return NO_MEMORY
        sectors = self.shape[1]
        return ScanMemory(self, FrameStack(self.frames, control_dt, count, sectors, arrays))

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the scans, each (n, sectors)."""
        if self.frames is None:
            return (self.present(seen),)
        return memory.stack.show(seen.robots)

    def present(self, seen: Seen) -> Any:
        """Return the present scan as it is shown, float32, shape (n, sectors).

        No return shows as range_max, and too close as range_min.
        """
        nearest = seen.nearest(self.sectors)
        xp = array_namespace(nearest)
        shown = clip(xp, nearest, self.lidar.range_min, self.lidar.range_max)
        if self.nearness_distance > 0.0:
            # (d - r) / (d + r), in fewer passes.
            shown += self.nearness_distance
            shown = (2.0 * self.nearness_distance) / shown
            shown -= 1.0
        return shown


class ScanMemory(Memory):
    """The last scans of robots, as they are shown."""

    def __init__(self, part: Scan, stack: FrameStack) -> None:
        """Keep them in ``stack``."""
        self._part = part
        self.period = stack.length
        self.stack = stack

    def begin(self, seen: Seen) -> None:
        """Let robots have seen nothing but this."""
        self.stack.begin(seen.robots, self._part.present(seen))

    def begin_where(self, begins: Any, seen: Seen) -> None:
        """Let the robots of a mask have seen nothing but this."""
        self.stack.begin_where(begins, self._part.present(seen))

    def push(self, seen: Seen) -> None:
        """Note the present scan; for steps that were left out it stands as well."""
        self.stack.push(self._part.present(seen), seen.elapsed.steps)

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""
        self.stack.keep(robots)

    def arrays(self) -> dict[str, Any]:
        """Return the scans, and which is the newest."""
        return self.stack.arrays()
