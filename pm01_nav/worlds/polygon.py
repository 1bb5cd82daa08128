# SPDX-License-Identifier: Apache-2.0
"""Tell a simple polygon from one that crosses itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled

FloatArray = NDArray[np.float64]

LEAST_AREA = 1e-12
"""An area below this part of the square of the polygon's extent is rounding, not area."""


def signed_area(vertices: FloatArray) -> float:
    """Return the area of a simple polygon (n, 2) [m^2], positive if it runs counter-clockwise."""
    # Relative to one of its corners, so that a polygon far from the origin loses no digits.
    x, y = (vertices - vertices[0]).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def has_area(vertices: FloatArray) -> bool:
    """Tell whether a polygon (n, 2) encloses more area than rounding could."""
    extent = float(np.ptp(vertices, axis=0).max())
    return abs(signed_area(vertices)) > LEAST_AREA * extent * extent


def is_simple(vertices: FloatArray) -> bool:
    """Tell whether the edges of a polygon (n, 2) meet at their common corners only.

    A repeated corner, an edge that runs back on the one before it, and a corner that lies on
    another edge are refused like a crossing.
    """
    vertices = np.ascontiguousarray(vertices, dtype=np.float64)
    # Boxes are most of all polygons; for them alone nothing needs to be compiled.
    if _is_convex(vertices):
        return True
    left_ends = np.minimum(vertices[:, 0], np.roll(vertices[:, 0], -1))
    return bool(_edges_meet_at_corners_only(vertices, np.argsort(left_ends, kind="stable")))


def _is_convex(vertices: FloatArray) -> bool:
    """Tell whether a polygon (n, 2) turns to one side at every corner, and once around in all."""
    edges = np.roll(vertices, -1, axis=0) - vertices
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    if not ((turns > 0.0).all() or (turns < 0.0).all()):
        return False
    # A star turns to one side at every corner, too, but twice around.
    angles = np.arctan2(turns, (edges * following).sum(axis=1))
    return bool(abs(abs(angles.sum()) - 2.0 * np.pi) < 1e-6)


@compiled
def _turn(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return 1 where c lies left of the line from a to b, -1 right of it, 0 on it."""
    one, other = (bx - ax) * (cy - ay), (by - ay) * (cx - ax)
    return (one > other) - (one < other)


@compiled
def _within(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> bool:
    """Tell whether c, which lies on the line through a and b, lies between them."""
    return min(ax, bx) <= cx <= max(ax, bx) and min(ay, by) <= cy <= max(ay, by)


@compiled
def _meet(ends: FloatArray) -> bool:
    """Tell whether the segments a b and c d, ``ends`` (4, 2), have a point in common."""
    ax, ay, bx, by = ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1]
    cx, cy, dx, dy = ends[2, 0], ends[2, 1], ends[3, 0], ends[3, 1]
    c_side, d_side = _turn(ax, ay, bx, by, cx, cy), _turn(ax, ay, bx, by, dx, dy)
    a_side, b_side = _turn(cx, cy, dx, dy, ax, ay), _turn(cx, cy, dx, dy, bx, by)
    if c_side * d_side < 0 and a_side * b_side < 0:
        return True
    return (
        (c_side == 0 and _within(ax, ay, bx, by, cx, cy))
        or (d_side == 0 and _within(ax, ay, bx, by, dx, dy))
        or (a_side == 0 and _within(cx, cy, dx, dy, ax, ay))
        or (b_side == 0 and _within(cx, cy, dx, dy, bx, by))
    )


@compiled
def _folds_back(ends: FloatArray) -> bool:
    """Tell whether the edge from b to c runs back on the one from a to b, ``ends`` (3, 2)."""
    ax, ay, bx, by, cx, cy = ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1], ends[2, 0], ends[2, 1]
    forward = (bx - ax) * (cx - bx) + (by - ay) * (cy - by)
    return _turn(ax, ay, bx, by, cx, cy) == 0 and forward <= 0.0


@compiled(allocates=True)
def _edges_meet_at_corners_only(vertices: FloatArray, order: NDArray[np.int64]) -> bool:
    """Compare each edge with those that begin left of its right end; ``order`` is by left ends."""
    count = len(vertices)
    ends = np.zeros((4, 2))
    for k in range(count):
        ends[0], ends[1], ends[2] = vertices[k - 1], vertices[k], vertices[(k + 1) % count]
        if _folds_back(ends):
            return False
    for i in range(count):
        k = order[i]
        ends[0], ends[1] = vertices[k], vertices[(k + 1) % count]
        right = max(ends[0, 0], ends[1, 0])
        for j in range(i + 1, count):
            other = order[j]
            ends[2], ends[3] = vertices[other], vertices[(other + 1) % count]
            if min(ends[2, 0], ends[3, 0]) > right:
                break
            apart = abs(k - other)
            if 1 < apart < count - 1 and _meet(ends):
                return False
    return True
