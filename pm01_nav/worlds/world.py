# SPDX-License-Identifier: Apache-2.0
"""What stands around the robot, and where an episode may start and end. Worlds are data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import polygon_edges
from pm01_nav.worlds.grid import OccupancyGrid, check_coordinates
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.polygon import has_area, is_simple

FloatArray = NDArray[np.float64]

MAX_OBSTACLES = 200_000
"""Discs, segments, corners of polygons and movers together; more is refused, not awaited."""
MAX_CORNERS = 10_000
"""Corners of one polygon: whether it crosses itself takes up to their square to find out."""
BOUNDS_SIDE = (1e-3, 1e5)
"""Least and greatest side of the bounds [m]."""


def _no_rows(columns: int) -> FloatArray:
    return np.zeros((0, columns))


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
    reference_length: float = math.nan
    """Length of the way by which a benchmark judges times [m]; NaN where none does."""

    def __post_init__(self) -> None:
        """Refuse values that no simulator could use.

        Raises:
            InputError: there are too many obstacles; a number is NaN, infinite or too large, a
                radius is not positive, a polygon crosses itself or has no area, bounds are empty.
        """
        try:
            self._check_counts()
            self._check_numbers()
            for index, polygon in enumerate(self.polygons):
                _check_polygon(polygon, f"polygons[{index}]")
            _check_bounds(self.bounds)
            for name in ("start_area", "goal_area"):
                _check_area(getattr(self, name), name)
        except InputError as error:
            raise InputError(f"world {self.name}: {error}") from None

    def _check_counts(self) -> None:
        for name, rows, columns in (("discs", self.discs, 3), ("segments", self.segments, 4)):
            if rows.ndim != 2 or rows.shape[1] != columns:
                raise InputError(f"{name}: must have shape (n, {columns}), not {rows.shape}")
        corners = sum(len(polygon) for polygon in self.polygons)
        count = len(self.discs) + len(self.segments) + corners + len(self.movers)
        if count > MAX_OBSTACLES:
            raise InputError(
                f"{count} obstacles (discs, segments, corners of polygons, movers): "
                f"at most {MAX_OBSTACLES} are allowed; a grid holds more"
            )

    def _check_numbers(self) -> None:
        named: list[tuple[str, object]] = [("discs", self.discs), ("segments", self.segments)]
        for k, mover in enumerate(self.movers):
            named.append((f"movers[{k}]", [*mover.points.flat, mover.radius, mover.speed]))
        named += [
            (name, getattr(self, name) or ()) for name in ("start", "start_area", "goal_area")
        ]
        for name, values in named:
            check_coordinates(np.asarray(values, dtype=np.float64), name)
        for index in np.nonzero(self.discs[:, 2] <= 0.0)[0][:1]:
            radius = self.discs[index, 2]
            raise InputError(f"discs[{index}]: radius = {radius}: must be positive")

    @cached_property
    def known_bounds(self) -> tuple[float, float, float, float]:
        """The part of ``bounds`` in which there is anything free; ``bounds`` if there is nothing.

        The rest of a map is solid, and may be most of it: 100 m around one room.
        """
        known = self.grid.free_extent if self.grid is not None and self.grid.closed else None
        if known is None:
            return self.bounds
        low = np.maximum(self.bounds[:2], known[:2])
        high = np.minimum(self.bounds[2:], known[2:])
        if (low >= high).any():
            return self.bounds
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def all_segments(self) -> FloatArray:
        """Thin walls and the edges of the polygons together, shape (n, 4) [m]."""
        return np.concatenate([self.segments, *(polygon_edges(p) for p in self.polygons)])


def _check_polygon(polygon: FloatArray, name: str) -> None:
    if polygon.ndim != 2 or polygon.shape[1] != 2 or not 3 <= len(polygon) <= MAX_CORNERS:
        shape = polygon.shape
        raise InputError(f"{name}: must have 3 to {MAX_CORNERS} corners (x, y), not {shape}")
    check_coordinates(polygon, name)
    if not has_area(polygon):
        raise InputError(f"{name}: encloses no area")
    if not is_simple(polygon):
        raise InputError(f"{name}: crosses or touches itself; its edges may meet at corners only")


def _check_bounds(bounds: tuple[float, float, float, float]) -> None:
    check_coordinates(np.asarray(bounds, dtype=np.float64), "bounds")
    least, most = BOUNDS_SIDE
    x_min, y_min, x_max, y_max = bounds
    if not (x_min < x_max and y_min < y_max):
        raise InputError(f"bounds {bounds} enclose no area")
    for side in (x_max - x_min, y_max - y_min):
        if not least <= side <= most:
            raise InputError(f"bounds {bounds}: a side of {side:.6g} m: must be {least} to {most}")


def _check_area(area: tuple[float, float, float, float] | None, name: str) -> None:
    if area is not None and (area[0] > area[2] or area[1] > area[3]):
        raise InputError(f"{name} = {area}: must be x_min, y_min, x_max, y_max")
