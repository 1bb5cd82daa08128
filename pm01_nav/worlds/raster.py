# SPDX-License-Identifier: Apache-2.0
"""Rasterise a world: a cell is solid if any part of an obstacle lies in it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.errors import InputError
from pm01_nav.geometry import polygon_edges
from pm01_nav.worlds.grid import MAX_CELLS, OccupancyGrid
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
CellArray = NDArray[np.uint8]

SLACK = 1e-6
"""Part of a cell by which obstacles are widened: rounding must not lose a point on an edge."""


def rasterise(world: World, resolution: float) -> OccupancyGrid:
    """Return the static obstacles of a world on cells of ``resolution`` [m].

    The grid covers the bounds and all obstacles. Its lines lie half a cell beside the bounds, so
    that a wall on the bounds takes one row of cells, not two; those of a world with a grid of the
    same resolution lie on that grid's lines, whose cells are then copied as they are, unless the
    grid is turned.

    Raises:
        InputError: the resolution is not positive, or would give too many cells.
    """
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise InputError(f"resolution = {resolution}: must be above 0")
    origin = _origin(world, resolution)
    width, height = _size(world, origin, resolution)
    solid = np.zeros((height, width), dtype=np.uint8)
    if world.grid is not None:
        _fill_grid(solid, world.grid, origin, resolution)
    _fill_discs(solid, _in_cells(world.discs, origin, resolution))
    _fill_segments(solid, _in_cells(world.all_segments, origin, resolution))
    for polygon in world.polygons:
        edges = polygon_edges(_in_cells(polygon, origin, resolution))
        _fill_inside(solid, np.ascontiguousarray(edges))
    closed = world.grid is not None and world.grid.closed
    return OccupancyGrid(solid, resolution, (float(origin[0]), float(origin[1])), closed=closed)


def _areas(world: World) -> FloatArray:
    """Return x_min, y_min, x_max, y_max of the bounds and the grid, shape (1 or 2, 4) [m]."""
    areas = [world.bounds]
    if world.grid is not None:
        areas.append(world.grid.extent())
    return np.array(areas)


def _reaches(world: World) -> FloatArray:
    """Return x_min, y_min, x_max, y_max of discs and segments, shape (n, 4) [m]."""
    centres, radii = world.discs[:, :2], world.discs[:, 2:]
    ends = world.all_segments.reshape(-1, 2)
    return np.concatenate([np.hstack([centres - radii, centres + radii]), np.hstack([ends, ends])])


def _origin(world: World, resolution: float) -> FloatArray:
    low = np.concatenate([_areas(world), _reaches(world)])[:, :2].min(axis=0)
    grid = world.grid
    if grid is None or grid.resolution != resolution or grid.yaw != 0.0:
        return low - resolution / 2.0
    cells = np.ceil((np.array(grid.origin) - low) / resolution - SLACK)
    return np.array(grid.origin) - cells * resolution


def _size(world: World, origin: FloatArray, resolution: float) -> tuple[int, int]:
    """Return how many cells wide and high the grid must be."""
    # An area ends where its last cell does; an obstacle's last point needs a cell of its own.
    ends = np.ceil((_areas(world)[:, 2:] - origin) / resolution - SLACK)
    touched = np.floor((_reaches(world)[:, 2:] - origin) / resolution + SLACK) + 1.0
    width, height = np.concatenate([ends, touched]).max(axis=0)
    if width * height > MAX_CELLS:
        raise InputError(
            f"resolution = {resolution}: gives {width * height:.3g} cells; "
            f"at most {MAX_CELLS} are allowed"
        )
    return int(width), int(height)


def _in_cells(values: FloatArray, origin: FloatArray, resolution: float) -> FloatArray:
    """Express rows of coordinates (and radii in the odd column out) in cells."""
    scaled = values / resolution
    for column in range(values.shape[1] // 2 * 2):
        scaled[:, column] -= origin[column % 2] / resolution
    return scaled


@compiled
def _fill_discs(solid: CellArray, discs: FloatArray) -> None:
    """Fill the cells that are nearer to a centre than its radius; all in cells."""
    height, width = solid.shape
    for k in range(discs.shape[0]):
        x, y, reach = discs[k, 0], discs[k, 1], discs[k, 2] + SLACK
        for row in range(max(0, int(np.floor(y - reach))), min(height, int(y + reach) + 1)):
            dy = max(row - y, y - row - 1.0, 0.0)
            half = np.sqrt(max(reach * reach - dy * dy, 0.0))
            first, last = int(np.floor(x - half)), int(np.floor(x + half))
            for column in range(max(0, first), min(width, last + 1)):
                solid[row, column] = 1


@compiled
def _fill_segments(solid: CellArray, segments: FloatArray) -> None:
    """Fill the cells that a segment passes, row by row; all in cells."""
    height, width = solid.shape
    for k in range(segments.shape[0]):
        x1, y1, x2, y2 = segments[k]
        if y1 > y2:
            x1, y1, x2, y2 = x2, y2, x1, y1
        low, high = y1 - SLACK, y2 + SLACK
        for row in range(max(0, int(np.floor(low))), min(height, int(np.floor(high)) + 1)):
            # The part of the segment within the row; all of it where it is level.
            first, last = 0.0, 1.0
            if y2 > y1:
                first = min(max((row - SLACK - y1) / (y2 - y1), 0.0), 1.0)
                last = min(max((row + 1.0 + SLACK - y1) / (y2 - y1), 0.0), 1.0)
            one, other = x1 + first * (x2 - x1), x1 + last * (x2 - x1)
            left = int(np.floor(min(one, other) - SLACK))
            right = int(np.floor(max(one, other) + SLACK))
            for column in range(max(0, left), min(width, right + 1)):
                solid[row, column] = 1


@compiled(allocates=True)
def _fill_inside(solid: CellArray, edges: FloatArray) -> None:
    """Fill the cells whose centre lies inside a polygon, row by row; ``edges`` (n, 4) in cells."""
    height, width = solid.shape
    crossings = np.zeros(edges.shape[0])
    lowest, highest = edges[:, 1].min(), edges[:, 1].max()
    for row in range(max(0, int(np.floor(lowest))), min(height, int(np.floor(highest)) + 1)):
        middle = row + 0.5
        count = 0
        for k in range(edges.shape[0]):
            x1, y1, x2, y2 = edges[k]
            if (y1 > middle) != (y2 > middle):
                crossings[count] = x1 + (middle - y1) / (y2 - y1) * (x2 - x1)
                count += 1
        between = np.sort(crossings[:count])
        for k in range(0, count - 1, 2):
            first, last = int(np.ceil(between[k] - 0.5)), int(np.floor(between[k + 1] - 0.5))
            for column in range(max(0, first), min(width, last + 1)):
                solid[row, column] = 1


def _fill_grid(
    solid: CellArray, grid: OccupancyGrid, origin: FloatArray, resolution: float
) -> None:
    """Fill what a grid's solid cells overlap, and what is not wholly inside a closed grid."""
    corner = _in_cells(np.array([grid.origin]), origin, resolution)[0]
    frame = (corner[0], corner[1], grid.resolution / resolution, *grid.direction)
    if grid.closed:
        _fill_outside(solid, grid.occupied.shape, frame)
    _fill_cells(solid, grid.occupied, frame)


@compiled
def _fill_outside(
    solid: CellArray, shape: tuple[int, int], frame: tuple[float, float, float, float, float]
) -> None:
    """Fill the cells that reach beyond another grid; ``frame`` is that of ``_fill_cells``."""
    x, y, size, cos, sin = frame
    reach = 0.5 * (abs(cos) + abs(sin)) - SLACK
    for row in range(solid.shape[0]):
        for column in range(solid.shape[1]):
            right, up = column + 0.5 - x, row + 0.5 - y
            along, across = cos * right + sin * up, cos * up - sin * right
            beyond = along < reach or along > shape[1] * size - reach
            if beyond or across < reach or across > shape[0] * size - reach:
                solid[row, column] = 1


@compiled
def _fill_cells(
    solid: CellArray, cells: CellArray, frame: tuple[float, float, float, float, float]
) -> None:
    """Fill what another grid's solid cells overlap.

    ``frame`` is its origin and the side of its cells, in cells, and cosine and sine of its yaw.
    """
    x, y, size, cos, sin = frame
    # Narrowed, not widened: a cell that only touches another does not fill it.
    half = 0.5 * size - SLACK * min(size, 1.0)
    around, within = half * (abs(cos) + abs(sin)), half + 0.5 * (abs(cos) + abs(sin))
    for r in range(cells.shape[0]):
        for c in range(cells.shape[1]):
            if cells[r, c] == 0:
                continue
            along, across = (c + 0.5) * size, (r + 0.5) * size
            middle_x = x + cos * along - sin * across
            middle_y = y + sin * along + cos * across
            low, high = int(np.floor(middle_y - around)), int(np.floor(middle_y + around))
            left, right = int(np.floor(middle_x - around)), int(np.floor(middle_x + around))
            for row in range(max(0, low), min(solid.shape[0] - 1, high) + 1):
                for column in range(max(0, left), min(solid.shape[1] - 1, right) + 1):
                    # Two squares are apart if a line along a side of one of them parts them.
                    dx, dy = column + 0.5 - middle_x, row + 0.5 - middle_y
                    if abs(cos * dx + sin * dy) < within and abs(cos * dy - sin * dx) < within:
                        solid[row, column] = 1
