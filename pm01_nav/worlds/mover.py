# SPDX-License-Identifier: Apache-2.0
"""Obstacles that move: solid discs, each with its own way of moving."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]
Motion = Literal["bounce", "loop", "spline", "pedestrian"]


def _no_times() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True)
class Mover:
    """A disc that moves through a world. Lengths in metres, times in seconds.

    ``bounce`` starts at ``points[0]`` in the direction ``heading`` with ``speed`` and is thrown
    back by walls, static obstacles and the world's bounds. ``loop`` drives round the closed polygon
    ``points`` with ``speed``. ``spline`` passes ``points`` at ``times`` on a cubic Hermite curve,
    then begins anew: it jumps if the last point is not the first. ``pedestrian`` walks with the
    preferred ``speed`` from ``points[0]`` to the other points in turn and round again, or, where
    there is only one point, to places drawn from the world's free space, and avoids what it meets.
    """

    motion: Motion
    radius: float
    points: FloatArray
    """Shape (n, 2)."""
    speed: float = 0.0
    """[m/s]; not used by ``spline``."""
    heading: float = 0.0
    """[rad]; used by ``bounce`` only."""
    times: FloatArray = field(default_factory=_no_times)
    """When ``spline`` passes each point, from 0 on, shape (n,)."""

    def __post_init__(self) -> None:
        """Refuse a motion that no simulator could follow.

        Raises:
            InputError: an unknown motion, a wrong shape, or a number that is NaN, infinite, or not
                positive where it must be.
        """
        if self.motion not in get_args(Motion):
            allowed = ", ".join(get_args(Motion))
            raise InputError(f"mover: motion = {self.motion!r}: unknown; allowed: {allowed}")
        least = {"bounce": 1, "loop": 2, "spline": 2, "pedestrian": 1}[self.motion]
        if self.points.shape != (self.points.size // 2, 2) or len(self.points) < least:
            raise InputError(f"mover: points: a {self.motion} needs {least} or more of (x, y)")
        numbers = np.concatenate(
            [self.points.ravel(), self.times, [self.radius, self.speed, self.heading]]
        )
        if not np.isfinite(numbers).all():
            raise InputError("mover: all numbers must be finite")
        if self.radius <= 0.0:
            raise InputError(f"mover: radius = {self.radius}: must be above 0")
        if self.motion == "spline":
            rising = len(self.times) == len(self.points) and (np.diff(self.times) > 0.0).all()
            if not rising or self.times[0] != 0.0:
                raise InputError("mover: times: a spline needs one for each point, rising from 0")
        elif self.speed <= 0.0:
            raise InputError(f"mover: speed = {self.speed}: must be above 0")
