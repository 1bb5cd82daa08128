# SPDX-License-Identifier: Apache-2.0
"""Solid and free cells, as maps have them: on lines of their own, which may be turned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]

MAX_CELLS = 64_000_000
"""Cells of a grid."""
MAX_COORDINATE = 1e7
"""[m]; UTM coordinates are below it. Further out a double has no micrometres left."""


@dataclass(frozen=True)
class OccupancyGrid:
    """A grid of solid cells."""

    occupied: NDArray[np.uint8]
    """1 where a cell is solid, shape (height, width); row 0 has the smallest y before turning."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float]
    """Corner of cell (0, 0) in the world [m]: the lower left one of a grid that is not turned."""
    yaw: float = 0.0
    """How far the grid is turned about its origin, counter-clockwise [rad]."""
    closed: bool = False
    """Whether all outside the grid is solid, as beyond the edge of a map; else it is free."""

    def __post_init__(self) -> None:
        """Refuse a grid that no simulator could use.

        Raises:
            InputError: it has no cells or too many, or a number is not finite or not positive.
        """
        if self.occupied.ndim != 2 or not 0 < self.occupied.size <= MAX_CELLS:
            shape = self.occupied.shape
            raise InputError(f"grid: must have rows and columns, 1 to {MAX_CELLS} cells: {shape}")
        if not 0.0 < self.resolution <= MAX_COORDINATE:
            raise InputError(f"grid: resolution = {self.resolution}: must be above 0")
        check_coordinates(np.asarray([*self.origin, self.yaw], dtype=np.float64), "grid: origin")

    @property
    def direction(self) -> tuple[float, float]:
        """Cosine and sine of the yaw."""
        return float(np.cos(self.yaw)), float(np.sin(self.yaw))

    def to_cells(self, points: ArrayLike) -> FloatArray:
        """Return where points of the world lie, in columns and rows, shape (..., 2)."""
        (cos, sin), offset = self.direction, np.asarray(points) - np.array(self.origin)
        x, y = offset[..., 0], offset[..., 1]
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1) / self.resolution

    def to_world(self, cells: ArrayLike) -> FloatArray:
        """Undo ``to_cells``; returns points of the world [m], shape (..., 2)."""
        (cos, sin), offset = self.direction, np.asarray(cells) * self.resolution
        x, y = offset[..., 0], offset[..., 1]
        return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + np.array(self.origin)

    def is_solid(self, x: float, y: float) -> bool:
        """Tell whether a point of the world [m] lies in a solid cell, or in what is closed."""
        column, row = np.floor(self.to_cells([x, y])).astype(np.int64)
        height, width = self.occupied.shape
        if 0 <= row < height and 0 <= column < width:
            return bool(self.occupied[row, column])
        return self.closed

    def extent(self) -> tuple[float, float, float, float]:
        """Return x_min, y_min, x_max, y_max of the grid in the world [m]."""
        return self._extent((0, 0, *self.occupied.shape))

    @property
    def free_extent(self) -> tuple[float, float, float, float] | None:
        """``extent`` of the free cells alone, None if there are none."""
        return None if self.free_area is None else self._extent(self.free_area)

    @cached_property
    def known(self) -> OccupancyGrid:
        """The same place in fewer cells: of a closed grid the free cells and a ring of solid ones.

        Nobody gets or sees beyond that ring.
        """
        area = self.free_area if self.closed else None
        if area is None:
            return self
        top, left, bottom, right = area
        cells = np.ones((bottom - top + 2, right - left + 2), dtype=np.uint8)
        cells[1:-1, 1:-1] = self.occupied[top:bottom, left:right]
        x, y = self.to_world([left - 1.0, top - 1.0])
        return OccupancyGrid(cells, self.resolution, (float(x), float(y)), self.yaw, closed=True)

    @cached_property
    def free_area(self) -> tuple[int, int, int, int] | None:
        """First row and column of the free cells, and those after the last; None without any."""
        free = self.occupied == 0
        rows, columns = np.flatnonzero(free.any(axis=1)), np.flatnonzero(free.any(axis=0))
        if len(rows) == 0:
            return None
        return int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1

    def _extent(self, area: tuple[int, int, int, int]) -> tuple[float, float, float, float]:
        """Return the extent of the cells from a first row and column to those after the last."""
        low, left, high, right = area
        corners = self.to_world([[left, low], [right, low], [right, high], [left, high]])
        (x_min, y_min), (x_max, y_max) = corners.min(axis=0), corners.max(axis=0)
        return float(x_min), float(y_min), float(x_max), float(y_max)


def coarsened(cells: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return cells ``factor`` times as large, true where one of theirs is."""
    height, width = (-(-n // factor) for n in cells.shape)
    padded = np.zeros((height * factor, width * factor), dtype=np.bool_)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(height, factor, width, factor).any(axis=(1, 3)))


def check_coordinates(values: FloatArray, name: str) -> None:
    """Refuse what is not finite or further out than any map.

    Raises:
        InputError: with the first such value.
    """
    # Not the other way round: a comparison with NaN is false.
    bad = values[~(np.abs(values) <= MAX_COORDINATE)]
    if len(bad):
        limit = f"{MAX_COORDINATE:.0e}"
        raise InputError(f"{name}: {bad[0]}: must be finite, between -{limit} and {limit}")
