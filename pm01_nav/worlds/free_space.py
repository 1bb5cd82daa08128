# SPDX-License-Identifier: Apache-2.0
"""Where a round robot fits: free cells, connected regions and shortest paths on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.worlds.grid import OccupancyGrid, coarsened
from pm01_nav.worlds.grid_search import cheapest_path, line_is_free, pull_taut
from pm01_nav.worlds.world import World

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
        from scipy import ndimage

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

    def coarsened(self, factor: int) -> FreeSpace:
        """Return a raster of cells ``factor`` times as large, free where any of theirs is.

        A border of closed cells surrounds it.
        """
        size, free = factor * self.resolution, coarsened(self.free, factor)
        return FreeSpace(np.pad(free, 1), size, (self.origin[0] - size, self.origin[1] - size))

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

    def within(
        self, area: tuple[float, float, float, float], margin: float = 0.0
    ) -> NDArray[np.bool_]:
        """Tell which cells' centres lie in an area, ``margin`` [m] from its edges or more.

        Same shape as ``free``.
        """
        height, width = self.free.shape
        x, y = self.centre(np.arange(max(height, width)), np.arange(max(height, width))).T
        # A hair more, because centres are computed and areas are round numbers.
        least = margin - 1e-9
        across = (x >= area[0] + least) & (x <= area[2] - least)
        up = (y >= area[1] + least) & (y <= area[3] - least)
        return up[:height, None] & across[None, :width]


def free_space(world: World, radius: float, resolution: float = 0.1) -> FreeSpace:
    """Rasterise a world for a disc of ``radius`` [m] on cells of ``resolution`` [m]."""
    known = np.array(world.known_bounds)
    resolution = max(resolution, float(np.sqrt(np.prod(known[2:] - known[:2]) / MAX_CELLS)))
    # The lines are those of the whole bounds, so that cropping changes no place.
    corner = np.array(world.bounds[:2])
    first = np.floor((known[:2] - corner) / resolution + 1e-9)
    last = np.ceil((known[2:] - corner) / resolution - 1e-9)
    width, height = (int(cells) for cells in last - first)
    x_min, y_min = (float(value) for value in corner + first * resolution)
    space = FreeSpace(np.ones((height, width), dtype=np.bool_), resolution, (x_min, y_min))
    _clear_discs(space.free, world.discs, x_min, y_min, resolution, radius)
    _clear_segments(space.free, world.all_segments, x_min, y_min, resolution, radius)
    for polygon in world.polygons:
        _clear_inside(space.free, polygon, x_min, y_min, resolution)
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


@compiled(allocates=True)
def _clear_inside(free, vertices, x_min, y_min, resolution):
    """Block the cells whose centre is inside a polygon, by counting crossings."""
    height, width = free.shape
    low_x, high_x = vertices[:, 0].min() - x_min, vertices[:, 0].max() - x_min
    low_y, high_y = vertices[:, 1].min() - y_min, vertices[:, 1].max() - y_min
    for row in range(
        max(0, int(low_y / resolution)), min(height, int(max(high_y, 0.0) / resolution) + 1)
    ):
        y = y_min + (row + 0.5) * resolution
        for column in range(
            max(0, int(low_x / resolution)), min(width, int(max(high_x, 0.0) / resolution) + 1)
        ):
            x = x_min + (column + 0.5) * resolution
            inside = False
            for k in range(vertices.shape[0]):
                x1, y1 = vertices[k - 1, 0], vertices[k - 1, 1]
                x2, y2 = vertices[k, 0], vertices[k, 1]
                if (y1 > y) != (y2 > y) and x < x1 + (y - y1) * (x2 - x1) / (y2 - y1):
                    inside = not inside
            if inside:
                free[row, column] = False


def _clear_grid(space: FreeSpace, grid: OccupancyGrid, radius: float) -> None:
    closed, grid = grid.closed, grid.known
    distance = distance_to_occupied(grid)
    frame = (*grid.origin, grid.resolution, *grid.direction, closed)
    raster = (*space.origin, space.resolution)
    _clear_cells(space.free, grid.occupied, distance, frame, raster, radius)


@compiled
def _clear_cells(free, occupied, distance, frame, raster, radius):
    """Block the raster's cells whose centre is nearer than ``radius`` to a solid cell.

    The distance transform settles all but those near the limit, which are measured.
    """
    x_min, y_min, size, cos, sin, closed = frame
    height, width = occupied.shape
    reach = int(np.ceil(radius / size)) + 1
    for row in range(free.shape[0]):
        for column in range(free.shape[1]):
            right = raster[0] + (column + 0.5) * raster[2] - x_min
            up = raster[1] + (row + 0.5) * raster[2] - y_min
            x, y = (cos * right + sin * up) / size, (cos * up - sin * right) / size
            inside = 0.0 <= x <= width and 0.0 <= y <= height
            if closed and not inside:
                free[row, column] = False
                continue
            c = min(max(int(np.floor(x)), 0), width - 1)
            r = min(max(int(np.floor(y)), 0), height - 1)
            # Centre to centre; each end may be half a diagonal nearer.
            if (distance[r, c] - np.sqrt(2.0)) * size >= radius:
                continue
            if inside and (distance[r, c] + np.sqrt(0.5)) * size < radius:
                free[row, column] = False
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
    from scipy import ndimage

    if not grid.occupied.any():
        return np.full(grid.occupied.shape, 1e6, dtype=np.float32)
    return np.asarray(ndimage.distance_transform_edt(grid.occupied == 0), dtype=np.float32)


def shortest_path(
    space: FreeSpace, start: tuple[float, float], goal: tuple[float, float]
) -> FloatArray:
    """Return a shortest free path with its end points, shape (n, 2) [m]; no rows if there is none.

    Dijkstra on 8 neighbours, then the path is pulled taut between cells that see each other.
    The end points need not be cell centres.
    """
    first, last = space.cell(*start), space.cell(*goal)
    if first is None or last is None:
        return np.zeros((0, 2))
    if line_is_free(space.free, *first, *last):
        return np.array([start, goal], dtype=np.float64)
    even = np.zeros(space.free.shape, dtype=np.float32)
    cells, costs = cheapest_path(space.free, even, first, last, False)
    if len(cells) == 0:
        return np.zeros((0, 2))
    corners = space.centre(cells[:, 0], cells[:, 1])
    corners[0], corners[-1] = start, goal
    return corners[pull_taut(space.free, even, cells, costs, len(cells))]


def shortest_path_length(
    space: FreeSpace, start: tuple[float, float], goal: tuple[float, float]
) -> float:
    """Return the length of a shortest free path [m]; infinity if there is none."""
    path = shortest_path(space, start, goal)
    if len(path) == 0:
        return float("inf")
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
