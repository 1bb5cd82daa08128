# SPDX-License-Identifier: Apache-2.0
"""Show a policy the beams that it was trained with, whatever the robot's lidar sends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Scan
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_world, wrap_angle
from pm01_nav.readings import read_zeros
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.task.scans import ScanGeometry, discard_invalid, pool_sectors, sector_begins

FloatArray = NDArray[np.float64]
ANGLE_TOLERANCE = 1e-3
"""Beams that are no further from where they should be go through as they are [rad]."""
MAX_BEAMS = 16384


class ScanFitter:
    """Turn scans of any angles into scans of one ``geometry``.

    Each beam of the policy gets the nearest return among the lidar's beams around it, so that
    nothing is lost when the lidar has more of them; where it has fewer, the closest beam serves.
    """

    def __init__(self, geometry: ScanGeometry) -> None:
        """Show scans as a lidar of this geometry would."""
        self.geometry = geometry
        self._key: tuple[float, ...] = ()
        self._same = False
        nothing = np.zeros(0, dtype=np.int64)
        self._source, self._target = nothing, nothing
        self._unserved, self._substitute = nothing, nothing

    def fit(self, scan: Scan) -> NDArray[np.float32]:
        """Return raw ranges by REP-117, shape (geometry.num_beams,) [m].

        Raises:
            InputError: the lidar does not look where the policy needs to see.
        """
        ranges = np.asarray(scan.ranges, dtype=np.float32)
        key = (len(ranges), scan.angle_min, scan.angle_increment)
        if key != self._key:
            self._match(*key)
            self._key = key
        ranges = read_zeros(ranges, self.geometry.zero_means)
        # A return that the lidar's driver declares invalid must not hide a valid one.
        low, high = np.float32(scan.range_min), np.float32(scan.range_max)
        within = (ranges >= low) & (ranges <= high)
        ranges = np.where(within | (ranges == -np.inf), ranges, np.float32(np.inf))
        if self._same:
            return ranges
        fitted = np.full(self.geometry.num_beams, np.inf, dtype=np.float32)
        np.minimum.at(fitted, self._target, ranges[self._source])
        fitted[self._unserved] = ranges[self._substitute]
        return fitted

    def _match(self, num_beams: int, angle_min: float, increment: float) -> None:
        """Find the beam of the policy that is closest to each one of the lidar, and back."""
        finite = math.isfinite(angle_min) and math.isfinite(increment)
        if not 1 <= num_beams <= MAX_BEAMS or not finite or increment == 0.0:
            raise InputError(f"scan: {num_beams} beams in steps of {increment:g} rad: unusable")
        ours, own = self.geometry, self.geometry.angle_increment
        closest, off = _closest(
            _angles(num_beams, angle_min, increment), ours.num_beams, ours.angle_min, own
        )
        self._same = num_beams == ours.num_beams and bool(
            (closest == np.arange(num_beams)).all() and off.max() < ANGLE_TOLERANCE
        )
        # A beam beside all of ours looks elsewhere: it is left to the safety check.
        self._source = np.flatnonzero(off <= 0.5 * abs(own) + ANGLE_TOLERANCE)
        self._target = closest[self._source]
        self._unserved = np.setdiff1d(np.arange(ours.num_beams), self._target)
        wanted = _angles(ours.num_beams, ours.angle_min, own)[self._unserved]
        self._substitute, off = _closest(wanted, num_beams, angle_min, increment)
        blind = off > 0.5 * abs(increment) + ANGLE_TOLERANCE
        if blind.any():
            raise InputError(
                f"scan: no beam looks towards {math.degrees(wanted[blind.argmax()]):.1f} degrees, "
                f"where the policy needs one; it was trained with {ours.num_beams} beams from "
                f"{ours.angle_min:.4f} rad in steps of {own:.5f} rad"
            )


def _angles(count: int, angle_min: float, increment: float) -> FloatArray:
    return angle_min + increment * np.arange(count, dtype=np.float64)


def _closest(
    angles: FloatArray, count: int, angle_min: float, increment: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return which of ``count`` beams looks closest to each direction, and how far off it is."""
    ahead = np.sign(increment) * (angles - angle_min) % (2.0 * np.pi)
    # Beyond the last beam the first one is the other candidate.
    after = np.minimum(np.rint(ahead / abs(increment)), count - 1).astype(np.int64)
    off = np.abs(wrap_angle(angles - (angle_min + increment * after)))
    off_first = np.abs(wrap_angle(angles - angle_min))
    return np.where(off_first < off, 0, after), np.minimum(off, off_first)


def sector_lines(
    layout: ObservationLayout, ranges: NDArray[np.float32], mount: FloatArray
) -> FloatArray:
    """Return from where to where each beam or sector of a policy looks, (n, 2, 2) [m].

    It is in base_link. ``ranges`` (num_beams,) are raw ones of the layout's lidar, ``mount`` (3,)
    is its pose. A sector is drawn along its middle; no return ends at range_max, too close at
    range_min.
    """
    scan, part = layout.scan, layout.part("scan")
    nearest = pool_sectors(discard_invalid(ranges, scan), part.sectors if part else 0)
    shown = np.clip(nearest, scan.range_min, scan.range_max)
    begins = np.array(sector_begins(scan.num_beams, len(shown)))
    middle = 0.5 * (begins[:-1] + begins[1:] - 1)
    angle = scan.angle_min + scan.angle_increment * middle
    ends = np.stack([shown * np.cos(angle), shown * np.sin(angle)], axis=-1)
    return to_world(np.stack([np.zeros_like(ends), ends], axis=1), mount)
