# SPDX-License-Identifier: Apache-2.0
"""Where a round robot fits: free cells, connected regions and shortest paths on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pm01_nav.compilation import compiled
from pm01_nav.geometry import points_in_polygon
from pm01_nav.worlds.grid_search import cheapest_path, line_is_free, pull_taut
from pm01_nav.worlds.world import OccupancyGrid, World

FloatArray = NDArray[np.float64]
MAX_CELLS = 4_000_000
"""Above this a raster gets coarser cells, so that a huge map still fits into memory."""


@dataclass(frozen=True)
class FreeSpace:
    """The cells of a world in whose centre a disc of some radius touches nothing."""

    free: NDArray[np.bool_]
    """Shape (height, width); row 0 has the smallest y."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float]
    """Lower left corner of cell (0, 0) [m]."""

    def regions(self) -> NDArray[np.int32]:
        """Number the connected regions from 1; 0 is not free. Same shape as ``free``."""
        labels = np.zeros(self.free.shape, dtype=np.int32)
        ndimage.label(self.free, output=labels)
        return labels

    def cell(self, x: float, y: float) -> tuple[int, int] | None:
        """Return the (row, column) that holds a point, or None outside the raster."""
        row = int(np.floor((y - self.origin[1]) / self.resolution))
        column = int(np.floor((x - self.origin[0]) / self.resolution))
        if 0 <= row < self.free.shape[0] and 0 <= column < self.free.shape[1]:
            return row, column
        return None

    def nearest_free(self, x: float, y: float, within: float) -> tuple[int, int] | None:
        """Return the free cell whose centre is nearest to a point, or None further than ``within``.

        The cell that holds the point is taken if it is free, however far its centre.
        """
        cell = self.cell(x, y)
        if cell is not None and self.free[cell]:
            return cell
        reach = int(np.ceil(within / self.resolution)) + 1
        row, column = np.floor((np.array([y, x]) - self.origin[::-1]) / self.resolution).astype(
            np.int64
        )
        low = max(row - reach, 0), max(column - reach, 0)
        high = max(row + reach + 1, 0), max(column + reach + 1, 0)
        rows, columns = np.nonzero(self.free[low[0] : high[0], low[1] : high[1]])
        rows, columns = rows + low[0], columns + low[1]
        distance = np.linalg.norm(self.centre(rows, columns) - np.array([x, y]), axis=1)
        if len(distance) == 0 or distance.min() > within:
            return None
        nearest = int(distance.argmin())
        return int(rows[nearest]), int(columns[nearest])

    def centre(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> FloatArray:
        """Return the centres of cells, shape (n, 2) [m]."""
        x = self.origin[0] + (columns + 0.5) * self.resolution
        y = self.origin[1] + (rows + 0.5) * self.resolution
        return np.stack([x, y], axis=-1).astype(np.float64)


def free_space(world: World, radius: float, resolution: float = 0.1) -> FreeSpace:
    """Rasterise a world for a disc of ``radius`` [m] on cells of ``resolution`` [m]."""
    x_min, y_min, x_max, y_max = world.bounds
    area = (x_max - x_min) * (y_max - y_min)
    resolution = max(resolution, float(np.sqrt(area / MAX_CELLS)))
    width = int(np.ceil((x_max - x_min) / resolution - 1e-9))
    height = int(np.ceil((y_max - y_min) / resolution - 1e-9))
    space = FreeSpace(np.ones((height, width), dtype=np.bool_), resolution, (x_min, y_min))
    _clear_discs(space.free, world.discs, x_min, y_min, resolution, radius)
    _clear_segments(space.free, world.all_segments, x_min, y_min, resolution, radius)
    for polygon in world.polygons:
        _clear_inside(space, polygon)
    if world.grid is not None:
        _clear_grid(space, world.grid, radius)
    return space


@compiled
def _clear_discs(free, discs, x_min, y_min, resolution, radius):
    height, width = free.shape
    for k in range(discs.shape[0]):
        x, y, reach = discs[k, 0] - x_min, discs[k, 1] - y_min, discs[k, 2] + radius
        for row in range(
            max(0, int((y - reach) / resolution)), min(height, int((y + reach) / resolution) + 1)
        ):
            for column in range(
                max(0, int((x - reach) / resolution)), min(width, int((x + reach) / resolution) + 1)
            ):
                dx = (column + 0.5) * resolution - x
                dy = (row + 0.5) * resolution - y
                if dx * dx + dy * dy < reach * reach:
                    free[row, column] = False


@compiled
def _clear_segments(free, segments, x_min, y_min, resolution, radius):
    height, width = free.shape
    for k in range(segments.shape[0]):
        x1, y1 = segments[k, 0] - x_min, segments[k, 1] - y_min
        x2, y2 = segments[k, 2] - x_min, segments[k, 3] - y_min
        ex, ey = x2 - x1, y2 - y1
        length_squared = max(ex * ex + ey * ey, 1e-18)
        for row in range(
            max(0, int((min(y1, y2) - radius) / resolution)),
            min(height, int((max(y1, y2) + radius) / resolution) + 1),
        ):
            for column in range(
                max(0, int((min(x1, x2) - radius) / resolution)),
                min(width, int((max(x1, x2) + radius) / resolution) + 1),
            ):
                px = (column + 0.5) * resolution - x1
                py = (row + 0.5) * resolution - y1
                along = min(max((px * ex + py * ey) / length_squared, 0.0), 1.0)
                dx, dy = px - along * ex, py - along * ey
                if dx * dx + dy * dy < radius * radius:
                    free[row, column] = False


def _clear_inside(space: FreeSpace, polygon: FloatArray) -> None:
    low = np.floor((polygon.min(axis=0) - space.origin) / space.resolution).astype(int)
    high = np.ceil((polygon.max(axis=0) - space.origin) / space.resolution).astype(int)
    low = np.maximum(low, 0)
    rows = np.arange(low[1], min(high[1], space.free.shape[0]))
    columns = np.arange(low[0], min(high[0], space.free.shape[1]))
    if len(rows) == 0 or len(columns) == 0:
        return
    row_of, column_of = (m.ravel() for m in np.meshgrid(rows, columns, indexing="ij"))
    inside = points_in_polygon(space.centre(row_of, column_of), polygon)
    space.free[row_of[inside], column_of[inside]] = False


def _clear_grid(space: FreeSpace, grid: OccupancyGrid, radius: float) -> None:
    distance = distance_to_occupied(grid)
    frame = (grid.origin[0], grid.origin[1], grid.resolution)
    _clear_cells(space.free, grid.occupied, distance, frame, space.origin, space.resolution, radius)


@compiled
def _clear_cells(free, occupied, distance, frame, origin, resolution, radius):
    """Block the raster's cells whose centre is nearer than ``radius`` to a solid cell.

    The distance transform settles all but those near the limit, which are measured.
    """
    x_min, y_min, size = frame
    height, width = occupied.shape
    reach = int(np.ceil(radius / size)) + 1
    for row in range(free.shape[0]):
        for column in range(free.shape[1]):
            x = (origin[0] + (column + 0.5) * resolution - x_min) / size
            y = (origin[1] + (row + 0.5) * resolution - y_min) / size
            c = min(max(int(np.floor(x)), 0), width - 1)
            r = min(max(int(np.floor(y)), 0), height - 1)
            # Centre to centre; each end may be half a diagonal nearer.
            if (distance[r, c] - np.sqrt(2.0)) * size >= radius:
                continue
            for k in range(max(r - reach, 0), min(r + reach + 1, height)):
                for j in range(max(c - reach, 0), min(c + reach + 1, width)):
                    dx, dy = max(j - x, x - j - 1.0, 0.0), max(k - y, y - k - 1.0, 0.0)
                    if occupied[k, j] != 0 and (dx * dx + dy * dy) * size * size < radius * radius:
                        free[row, column] = False


def distance_to_occupied(grid: OccupancyGrid) -> NDArray[np.float32]:
    """Return each cell's distance to the centre of the nearest solid cell, in cells.

    Shape (height, width); a large number where no cell is solid.
    """
    if not grid.occupied.any():
        return np.full(grid.occupied.shape, 1e6, dtype=np.float32)
    return np.asarray(ndimage.distance_transform_edt(grid.occupied == 0), dtype=np.float32)


def shortest_path_length(
    space: FreeSpace, start: tuple[float, float], goal: tuple[float, float]
) -> float:
    """Return the length of a shortest free path [m]; infinity if there is none.

    Dijkstra on 8 neighbours, then the path is pulled taut between cells that see each other.
    The end points need not be cell centres.
    """
    first, last = space.cell(*start), space.cell(*goal)
    if first is None or last is None:
        return float("inf")
    straight = float(np.hypot(goal[0] - start[0], goal[1] - start[1]))
    if line_is_free(space.free, *first, *last):
        return straight
    even = np.zeros(space.free.shape, dtype=np.float32)
    cells, costs = cheapest_path(space.free, even, first, last, False)
    if len(cells) == 0:
        return float("inf")
    corners = space.centre(cells[:, 0], cells[:, 1])
    corners[0], corners[-1] = start, goal
    kept = corners[pull_taut(space.free, even, cells, costs, len(cells))]
    return max(straight, float(np.linalg.norm(np.diff(kept, axis=0), axis=1).sum()))
