# SPDX-License-Identifier: Apache-2.0
"""Scans as policies are given them: which beams, what their ranges mean, and sectors of them.

Functions work on any array of the array API standard, shaped ``(..., n)``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from pm01_nav.arrays import array_namespace
from pm01_nav.errors import InputError
from pm01_nav.readings import ZERO_MEANS, ZeroMeans, read_zeros

if TYPE_CHECKING:
    from pm01_nav.robot import Lidar


@dataclass(frozen=True)
class ScanGeometry:
    """Which way the beams of a scan look and how far, as in ``sensor_msgs/LaserScan``."""

    num_beams: int
    angle_min: float
    """Direction of beam 0 in the lidar frame [rad]."""
    angle_increment: float
    """From one beam to the next, counter-clockwise [rad]."""
    range_min: float
    """[m]"""
    range_max: float
    """[m]"""
    zero_means: ZeroMeans = field(default="invalid", compare=False)
    """What a 0 of the lidar's driver stands for. No part of what a policy was trained to see."""

    def __post_init__(self) -> None:
        """Refuse a meaning that there is not.

        Raises:
            InputError: ``zero_means`` is unknown.
        """
        if self.zero_means not in ZERO_MEANS:
            allowed = ", ".join(ZERO_MEANS)
            raise InputError(f"zero_means = {self.zero_means!r}: unknown; allowed: {allowed}")


def scan_geometry(lidar: Lidar, range_max: float | None = None) -> ScanGeometry:
    """Return how a robot's lidar looks around, as far as it does or only to ``range_max`` [m]."""
    return ScanGeometry(
        num_beams=lidar.num_beams,
        angle_min=lidar.angle_min,
        angle_increment=lidar.angle_increment,
        range_min=lidar.range_min,
        range_max=lidar.range_max if range_max is None else range_max,
        zero_means=lidar.zero_means,
    )


def discard_invalid(scan: Any, geometry: ScanGeometry) -> Any:
    """Replace ranges that say nothing by +inf, so that none hides a nearer return; same shape [m].

    THE SANITISER: every scan passes it before anything else looks at it, the simulator's (where it
    is the kernel ``sim.lidar.sanitized``) as well as a robot's.

    A 0 is first read as ``geometry.zero_means`` says, whatever the limits.

    | raw range (REP-117 and ``sensor_msgs/LaserScan``) | means          | becomes |
    |---------------------------------------------------|----------------|---------|
    | +inf                                              | no return      | +inf    |
    | above range_max                                   | to be discarded| +inf    |
    | range_min to range_max, both included             | a return       | itself  |
    | finite and below range_min                        | to be discarded| +inf    |
    | -inf                                              | too close      | -inf    |
    | NaN                                               | invalid        | +inf    |

    Limits are compared in the precision of ``scan``: a driver's float32 range_min is valid.
    """
    xp = array_namespace(scan)
    scan = read_zeros(scan, geometry.zero_means)
    within = (scan >= geometry.range_min) & (scan <= geometry.range_max)
    return xp.where(within | (scan == -xp.inf), scan, xp.inf)


def sector_begins(num_beams: int, sectors: int) -> list[int]:
    """Return the first beam of each sector, and ``num_beams`` behind them, ``sectors`` + 1 numbers.

    Sector k holds beams floor(k num_beams / sectors) to floor((k + 1) num_beams / sectors) - 1:
    all have the same number where it divides, else one more or less.
    """
    return [k * num_beams // sectors for k in range(sectors + 1)]


def pool_sectors(ranges: Any, sectors: int) -> Any:
    """Return the nearest range in each of ``sectors`` sectors, shape (..., sectors).

    With 0 sectors every beam is one. Environments have this from the simulator.
    """
    if sectors == 0:
        return ranges
    xp = array_namespace(ranges)
    num_beams = ranges.shape[-1]
    if num_beams % sectors:
        beams = xp.asarray(_beams_of_sectors(num_beams, sectors), device=ranges.device)
        ranges = xp.take(ranges, beams, axis=-1)
    return xp.min(xp.reshape(ranges, (*ranges.shape[:-1], sectors, -1)), axis=-1)


@cache
def _beams_of_sectors(num_beams: int, sectors: int) -> tuple[int, ...]:
    """Return the beams of all sectors; where one lacks a beam, its last stands twice."""
    widest = -(-num_beams // sectors)
    begins = sector_begins(num_beams, sectors)
    return tuple(min(a + j, b - 1) for a, b in pairwise(begins) for j in range(widest))
