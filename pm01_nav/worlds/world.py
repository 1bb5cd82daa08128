# SPDX-License-Identifier: Apache-2.0
"""What stands around the robot, and where an episode may start and end. Worlds are data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import polygon_edges
from pm01_nav.worlds.mover import Mover

FloatArray = NDArray[np.float64]


def _no_rows(columns: int) -> FloatArray:
    return np.zeros((0, columns))


@dataclass(frozen=True)
class OccupancyGrid:
    """A grid of solid cells; everything outside it is free."""

    occupied: NDArray[np.uint8]
    """1 where a cell is solid, shape (height, width); row 0 has the smallest y."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float]
    """Lower left corner of cell (0, 0) in the world [m]."""


@dataclass(frozen=True)
class World:
    """A place to drive in. Lengths in metres, angles in radians, x right and y up."""

    name: str
    bounds: tuple[float, float, float, float]
    """The area in which starts and goals are drawn: x_min, y_min, x_max, y_max."""
    discs: FloatArray = field(default_factory=lambda: _no_rows(3))
    """Solid discs: x, y, radius, shape (num_discs, 3)."""
    polygons: tuple[FloatArray, ...] = ()
    """Solid simple polygons, each of shape (num_vertices, 2)."""
    segments: FloatArray = field(default_factory=lambda: _no_rows(4))
    """Thin walls: x1, y1, x2, y2, shape (num_segments, 4)."""
    grid: OccupancyGrid | None = None
    movers: tuple[Mover, ...] = ()
    """Discs that move."""
    start: tuple[float, float, float] | None = None
    """A fixed start pose x, y, yaw; None draws one from the free space."""
    start_area: tuple[float, float, float, float] | None = None
    """Where starts are drawn, like ``bounds``, unless ``start`` fixes one; None is anywhere."""
    goal_area: tuple[float, float, float, float] | None = None
    """Where goals are drawn, like ``bounds``; a single point fixes the goal; None is anywhere."""

    def __post_init__(self) -> None:
        """Refuse values that no simulator could use.

        Raises:
            InputError: a number is NaN or infinite, a radius is not positive, bounds are empty.
        """
        for name, rows in (("discs", self.discs), ("segments", self.segments)):
            if not np.isfinite(rows).all():
                raise InputError(f"world {self.name}: {name} must be finite numbers")
        if (self.discs[:, 2] <= 0.0).any():
            raise InputError(f"world {self.name}: disc radii must be positive")
        for polygon in self.polygons:
            if polygon.ndim != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
                raise InputError(f"world {self.name}: a polygon needs 3 or more finite vertices")
        x_min, y_min, x_max, y_max = self.bounds
        if not (np.isfinite(self.bounds).all() and x_min < x_max and y_min < y_max):
            raise InputError(f"world {self.name}: bounds {self.bounds} enclose no area")

    @property
    def all_segments(self) -> FloatArray:
        """Thin walls and the edges of the polygons together, shape (n, 4) [m]."""
        return np.concatenate([self.segments, *(polygon_edges(p) for p in self.polygons)])
