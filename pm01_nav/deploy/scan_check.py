# SPDX-License-Identifier: Apache-2.0
"""What the newest scan tells, and whether it tells enough to drive by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.motion_check import AHEAD_AND_BEHIND, CONE, returns_as_points, seen_share
from pm01_nav.readings import ZeroMeans, is_valid, read_zeros

if TYPE_CHECKING:
    from pm01_nav.robot import Lidar

LONGEST_GAP_S = 0.5
"""Scans further apart than this do not count as a lidar that repeats itself [s]."""


def by_rep_117(scan: Scan, zero_means: ZeroMeans) -> Scan:
    """Return a driver's scan with ranges by REP-117 alone, float32.

    A 0 becomes what it means, and what is invalid becomes NaN: with finite ranges outside the
    scan's own limits a driver says that it does not know.
    """
    ranges = read_zeros(np.asarray(scan.ranges, dtype=np.float32), zero_means)
    # In float32, as the driver wrote it: its range_min must not fall below our float64 one.
    valid = is_valid(ranges, np.float32(scan.range_min), np.float32(scan.range_max))
    return replace(scan, ranges=np.where(valid, ranges, np.float32(np.nan)))


class ScanCheck:
    """The newest scan of a robot's lidar."""

    def __init__(
        self,
        lidar: Lidar,
        valid_share_min: float,
        frozen_s: float,
        courses: Sequence[float] = AHEAD_AND_BEHIND,
    ) -> None:
        """Ask for ``valid_share_min`` of a scan's beams, and of those that look one way.

        A lidar that repeats one scan while the robot moves, for ``frozen_s`` [s] in all, is frozen.
        ``courses`` [rad] are where the robot goes most, for the advice to a person.
        """
        self._courses = tuple(courses)
        self._mount = np.array([lidar.x, lidar.y, lidar.yaw])
        self._zero_means: ZeroMeans = lidar.zero_means
        self._valid_share_min = valid_share_min
        self._frozen_s = frozen_s
        self.stamp = math.nan
        """When the newest scan was taken, by the robot's clock [s]."""
        self._usable_at = math.nan
        """The same of the newest usable one."""
        self._bits = b""
        """Of its ranges; a copy, since a driver may write into the same array again."""
        self._repeated_s = 0.0
        """For how long the robot has moved while the ranges stayed as they are [s]."""
        self.returns: NDArray[np.float64] | None = None
        """Where the newest scan met something, in base_link, (n, 2) [m]; None if it is unusable."""
        self.advice: str | None = None
        """What a person can do about a scan that tells too little; None if it tells enough."""
        self._clean: Scan | None = None
        """The newest scan by REP-117; None if it is unusable."""

    @property
    def frozen(self) -> bool:
        """Whether the lidar repeats one scan, as none does that moves and sees something."""
        return self._repeated_s > self._frozen_s - 1e-6

    def sees(self, course: float) -> bool:
        """Tell whether the newest scan tells enough of what lies on a course [rad].

        Ahead and behind it is up to who mounts a lidar. The edge of what it sees may lie anywhere
        beside a slanting course, so there it must see both sides, too.
        """
        straight = course in AHEAD_AND_BEHIND
        courses = (course,) if straight else (course - CONE / 2, course, course + CONE / 2)
        return min(self._seen(courses)) >= self._valid_share_min

    def _seen(self, courses: Sequence[float]) -> tuple[float, ...]:
        """Return how much the newest scan tells of what lies on each course."""
        if self._clean is None:
            return (0.0,) * len(courses)
        return seen_share(self._clean, float(self._mount[2]), courses)

    def see(self, scan: Scan, *, moves: bool) -> bool:
        """Take in a scan, and whether the robot moved before it; tell whether it is usable."""
        self.stamp = scan.stamp
        self.returns = self._clean = self.advice = None
        if not _is_well_formed(scan):
            return False
        clean = by_rep_117(scan, self._zero_means)
        valid = 1.0 - float(np.isnan(clean.ranges).mean())
        if valid > 0.0 and valid >= self._valid_share_min:
            self.returns = returns_as_points(clean, self._mount)
            self._clean = clean
            self._note_repetition(scan, clean, moves)
        if not self._tells_enough(clean):
            self.advice = _advice(scan, clean)
        return self.returns is not None

    def _tells_enough(self, scan: Scan) -> bool:
        """Tell whether the ways that the robot goes are seen, as far as the lidar looks there."""
        least, seen = self._valid_share_min, self._seen(self._courses)
        if min(seen) >= least:
            return True
        whole = replace(scan, ranges=np.full_like(scan.ranges, np.inf))
        possible = seen_share(whole, float(self._mount[2]), self._courses)
        return all(s >= least or p < least for s, p in zip(seen, possible, strict=True))

    def forget(self) -> None:
        """Drop what was seen."""
        self.returns = self._clean = self.advice = None
        self.stamp, self._bits, self._repeated_s = math.nan, b"", 0.0

    def _note_repetition(self, scan: Scan, clean: Scan, moves: bool) -> None:
        """Note for how long usable scans have been equal to the last bit, with something in range.

        A lidar in free space repeats itself rightly: no return looks the same from everywhere.
        """
        bits, since = np.asarray(scan.ranges).tobytes(), scan.stamp - self._usable_at
        met = bool(np.isfinite(clean.ranges).any())
        if not (met and bits == self._bits and 0.0 < since <= LONGEST_GAP_S):
            self._repeated_s = 0.0
        elif moves:
            self._repeated_s += since
        self._usable_at, self._bits = scan.stamp, bits


def _is_well_formed(scan: Scan) -> bool:
    """Tell whether a scan is one of a lidar that goes round once, without negative ranges."""
    ranges = np.asarray(scan.ranges)
    numbers = (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max)
    if ranges.ndim != 1 or ranges.size == 0 or not all(map(math.isfinite, numbers)):
        return False
    # Twice round, a beam's place would be a guess.
    if (ranges.size - 1) * abs(scan.angle_increment) > 2.0 * math.pi + 1e-3:
        return False
    return not (np.isfinite(ranges) & (ranges < 0.0)).any()


def _advice(scan: Scan, clean: Scan) -> str | None:
    """Say what most of the ranges that tell nothing are, and what helps."""
    ranges, lost = np.asarray(scan.ranges), np.isnan(clean.ranges)
    count, many = len(ranges), 0.5 * np.count_nonzero(lost)
    zeros = np.count_nonzero(lost & (ranges == 0.0))
    if zeros > many:
        which = "the scan is mostly zeros" if zeros > 0.5 * count else f"{zeros} ranges are 0"
        return (
            f"{which}: set lidar.zero_means in the robot's YAML to what this driver means by 0 "
            "(no_return: lidars of the LDS class)"
        )
    beyond = np.count_nonzero(lost & (ranges > scan.range_max))
    if beyond > many:
        return (
            f"{beyond} of {count} ranges are beyond the scan's range_max ({scan.range_max:g} m): "
            "let the driver or a filter send +inf for no return (REP-117)"
        )
    below = np.count_nonzero(lost & (ranges < scan.range_min) & (ranges > 0.0))
    if below > many:
        return (
            f"{below} of {count} ranges are below the scan's range_min ({scan.range_min:g} m): "
            "let the driver or a filter send -inf for too close (REP-117)"
        )
    return None
