# SPDX-License-Identifier: Apache-2.0
"""Turn a world into the few shapes that other formats know: boxes and convex pieces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.grid import OccupancyGrid
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

WALL_THICKNESS = 0.02
"""Thin walls become boxes of this thickness [m]."""
MAX_BOXES = 200_000
"""A grid that needs more boxes is refused: no physics engine loads them."""
MAX_PIECE_CORNERS = 300
"""Corners of a polygon that is cut into convex pieces, which takes up to their cube."""


class Box(NamedTuple):
    """A turned rectangle on the floor [m, rad]."""

    x: float
    y: float
    length: float
    width: float
    yaw: float


def as_box(polygon: FloatArray) -> Box | None:
    """Return the rectangle that a polygon (n, 2) is, None if it is none."""
    if len(polygon) != 4:
        return None
    first, second = polygon[1] - polygon[0], polygon[3] - polygon[0]
    length, width = float(np.linalg.norm(first)), float(np.linalg.norm(second))
    size = max(length, width)
    # The fourth corner of a parallelogram, and its angle, to a billionth.
    closes = np.linalg.norm(polygon[0] + first + second - polygon[2]) <= 1e-9 * size
    if not closes or abs(first @ second) > 1e-9 * length * width:
        return None
    x, y = (polygon[0] + polygon[2]) / 2.0
    return Box(float(x), float(y), length, width, float(np.arctan2(first[1], first[0])))


def wall_boxes(segments: FloatArray, thickness: float = WALL_THICKNESS) -> list[Box]:
    """Return each thin wall as a box of this thickness [m]; a point becomes a square."""
    boxes = []
    for x1, y1, x2, y2 in segments.tolist():
        length = max(float(np.hypot(x2 - x1, y2 - y1)), thickness)
        yaw = float(np.arctan2(y2 - y1, x2 - x1))
        boxes.append(Box((x1 + x2) / 2.0, (y1 + y2) / 2.0, length, thickness, yaw))
    return boxes


def grid_boxes(grid: OccupancyGrid) -> list[Box]:
    """Cover the solid cells with boxes: runs in a row, joined with equal runs in the next rows.

    Of a closed grid those are covered that surround what is free.

    Raises:
        InputError: it would take more than ``MAX_BOXES``.
    """
    grid = grid.known
    runs = _runs(grid.occupied != 0)
    # Equal runs one above the other stand together: sorted by begin, end, row.
    runs = runs[np.lexsort((runs[:, 0], runs[:, 2], runs[:, 1]))]
    joins = np.zeros(len(runs), dtype=np.bool_)
    joins[1:] = (np.diff(runs[:, 0]) == 1) & (np.diff(runs[:, 1:], axis=0) == 0).all(axis=1)
    first = np.nonzero(~joins)[0]
    if len(first) > MAX_BOXES:
        raise InputError(f"the grid would take {len(first)} boxes; at most {MAX_BOXES} are written")
    last = np.append(first, len(runs))[1:] - 1
    bottom, begin, end, top = np.column_stack([runs[first], runs[last, 0]]).T
    middles = grid.to_world(np.column_stack([begin + end, bottom + top + 1]) / 2.0)
    sides = grid.resolution * np.column_stack([end - begin, top + 1 - bottom])
    places = np.hstack([middles, sides]).tolist()
    return [Box(x, y, length, width, grid.yaw) for x, y, length, width in places]


def _runs(solid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return row, first column and column after the last of each run of solid cells, (n, 3)."""
    padded = np.pad(solid, ((0, 0), (1, 1))).astype(np.int8)
    steps = np.diff(padded, axis=1)
    rows, begins = np.nonzero(steps == 1)
    ends = np.nonzero(steps == -1)[1]
    return np.column_stack([rows, begins, ends])


def obstacle_boxes(
    world: World, wall_thickness: float = WALL_THICKNESS
) -> Iterator[tuple[str, Box]]:
    """Yield a name and a box for each rectangle, thin wall and group of solid cells."""
    for index, polygon in enumerate(world.polygons):
        box = as_box(polygon)
        if box is not None:
            yield f"box_{index}", box
    for index, box in enumerate(wall_boxes(world.segments, wall_thickness)):
        yield f"wall_{index}", box
    for index, box in enumerate([] if world.grid is None else grid_boxes(world.grid)):
        yield f"cells_{index}", box


def counter_clockwise(polygon: FloatArray) -> FloatArray:
    """Return the corners (n, 2) counter-clockwise."""
    x, y = (polygon - polygon[0]).T
    area = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))
    return polygon if area > 0.0 else polygon[::-1]


def is_convex(polygon: FloatArray) -> bool:
    """Tell whether a simple polygon (n, 2) turns to one side only."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    return bool((turns >= 0.0).all() or (turns <= 0.0).all())


def convex_pieces(polygon: FloatArray) -> list[FloatArray]:
    """Cut a simple polygon (n, 2) into convex pieces: itself, or triangles by ear clipping.

    Raises:
        InputError: it is not convex and has too many corners.
    """
    if is_convex(polygon):
        return [polygon]
    if len(polygon) > MAX_PIECE_CORNERS:
        raise InputError(
            f"a polygon of {len(polygon)} corners that is not convex: at most "
            f"{MAX_PIECE_CORNERS} corners can be cut into convex pieces"
        )
    rest = list(counter_clockwise(polygon))
    pieces = []
    while len(rest) > 3:
        ear = next((k for k in range(len(rest)) if _is_ear(np.array(rest), k)), None)
        if ear is None:
            # Rounding left no ear; what remains has next to no width.
            break
        pieces.append(np.array([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]]))
        del rest[ear]
    return [*pieces, np.array(rest)]


def _is_ear(corners: FloatArray, k: int) -> bool:
    """Tell whether the triangle at corner ``k`` lies inside and holds no other corner."""
    triangle = corners[[k - 1, k, (k + 1) % len(corners)]]
    first, second = triangle[1] - triangle[0], triangle[2] - triangle[1]
    if first[0] * second[1] - first[1] * second[0] <= 0.0:
        return False
    others = np.delete(corners, [k - 1, k, (k + 1) % len(corners)], axis=0)
    return not _in_triangle(others, triangle).any()


def _in_triangle(points: FloatArray, triangle: FloatArray) -> NDArray[np.bool_]:
    """Tell which ``points`` (n, 2) lie in a counter-clockwise triangle or on its edge."""
    edges = np.roll(triangle, -1, axis=0) - triangle
    from_corner = points[:, None, :] - triangle[None, :, :]
    cross = edges[:, 0] * from_corner[:, :, 1] - edges[:, 1] * from_corner[:, :, 0]
    return np.asarray((cross >= 0.0).all(axis=1))
