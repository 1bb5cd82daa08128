# SPDX-License-Identifier: Apache-2.0
"""Distance from the robot's footprint to what stands around it.

A circle measures from its centre; a convex polygon is handled in its own frame.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.grid_frame import to_cells, turn_to_grid
from pm01_nav.sim.views import listed, view_cell
from pm01_nav.worlds.segments import point_to_segment

GRID_EXACT_DISTANCE = 0.5
"""Up to this clearance [m] the distance to a grid is exact, beyond it to a cell's diagonal."""


@compiled(inline=False)
def point_to_polygon(px, py, base):
    """Return the signed distance from a point to the footprint, negative inside [m]."""
    inside = -1e18
    count = base.edges.shape[0]
    for k in range(count):
        inside = max(inside, base.edges[k, 0] * px + base.edges[k, 1] * py - base.edges[k, 2])
    if inside <= 0.0:
        return inside
    nearest = 1e18
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        nearest = min(
            nearest,
            point_to_segment(
                px,
                py,
                base.vertices[k, 0],
                base.vertices[k, 1],
                base.vertices[j, 0],
                base.vertices[j, 1],
            ),
        )
    return nearest


@compiled(inline=False)
def segment_to_polygon(x1, y1, x2, y2, base):
    """Return the distance from a segment to the footprint, 0 where they meet [m]."""
    nearest = max(min(point_to_polygon(x1, y1, base), point_to_polygon(x2, y2, base)), 0.0)
    if nearest == 0.0:
        return 0.0
    # Clip the segment by the footprint's sides: what is left lies inside.
    enter, leave = 0.0, 1.0
    for k in range(base.edges.shape[0]):
        nx, ny, offset = base.edges[k, 0], base.edges[k, 1], base.edges[k, 2]
        first, last = nx * x1 + ny * y1 - offset, nx * x2 + ny * y2 - offset
        if first > 0.0 and last > 0.0:
            leave = -1.0
        elif first > 0.0:
            enter = max(enter, first / (first - last))
        elif last > 0.0:
            leave = min(leave, first / (first - last))
    if enter <= leave:
        return 0.0
    for k in range(base.vertices.shape[0]):
        nearest = min(
            nearest, point_to_segment(base.vertices[k, 0], base.vertices[k, 1], x1, y1, x2, y2)
        )
    return nearest


@compiled
def clearance(x, y, cos, sin, base, worlds, w):
    """Return the distance from the footprint to the nearest obstacle of world w [m].

    ``cos``, ``sin`` are the pose's heading. Zero or negative in contact; 1e9 where nothing stands.
    """
    best = clearance_in_view(x, y, cos, sin, base, worlds, view_cell(x, y, 0.0, worlds, w))
    # The nearest thing can be seen, since nothing stands before it. Only what is near is listed.
    if best > worlds.view_range - base.radius:
        best = clearance_in_view(x, y, cos, sin, base, worlds, worlds.view_begin[w])
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        best = min(best, grid_clearance(x, y, cos, sin, base, worlds, w))
    return best - base.padding


@compiled(inline=False)
def clearance_in_view(x, y, cos, sin, base, worlds, cell):
    """Return the distance to the nearest disc or segment that a cell lists [m]."""
    if base.vertices.shape[0] == 0:
        return circle_clearance(x, y, base.radius, worlds, cell)
    return polygon_clearance(x, y, cos, sin, base, worlds, cell)


@compiled
def circle_clearance(x, y, radius, worlds, cell):
    """Return the distance from a circle around (x, y) to the nearest that a cell lists [m].

    Without branches: passing over far obstacles would cost more than it saves.
    """
    best = 1e9
    first, last = listed(worlds.seen_disc_begin, cell)
    for n in range(first, last):
        k = np.uint64(worlds.seen_discs[n])
        dx, dy = worlds.discs[k, 0] - x, worlds.discs[k, 1] - y
        best = min(best, np.sqrt(dx * dx + dy * dy) - worlds.discs[k, 2] - radius)
    first, last = listed(worlds.seen_segment_begin, cell)
    for n in range(first, last):
        x1, y1, x2, y2 = segment(worlds, np.uint64(worlds.seen_segments[n]))
        best = min(best, point_to_segment(x, y, x1, y1, x2, y2) - radius)
    return best


@compiled(inline=False)
def polygon_clearance(x, y, cos, sin, base, worlds, cell):
    """Return the distance from a polygonal footprint to the nearest that a cell lists [m].

    Obstacles whose bounding distance exceeds the best found so far are passed over.
    """
    best = 1e9
    first, last = listed(worlds.seen_disc_begin, cell)
    for n in range(first, last):
        k = np.uint64(worlds.seen_discs[n])
        dx, dy, r = worlds.discs[k, 0] - x, worlds.discs[k, 1] - y, worlds.discs[k, 2]
        if np.sqrt(dx * dx + dy * dy) - r - base.radius < best:
            distance = point_to_polygon(cos * dx + sin * dy, cos * dy - sin * dx, base)
            best = min(best, distance - r)
    first, last = listed(worlds.seen_segment_begin, cell)
    for n in range(first, last):
        x1, y1, x2, y2 = segment(worlds, np.uint64(worlds.seen_segments[n]))
        if point_to_segment(x, y, x1, y1, x2, y2) - base.radius < best:
            x1, y1 = to_base(x1 - x, y1 - y, cos, sin)
            x2, y2 = to_base(x2 - x, y2 - y, cos, sin)
            best = min(best, segment_to_polygon(x1, y1, x2, y2, base))
    return best


@compiled
def segment(worlds, k):
    """Return the ends x1, y1, x2, y2 of segment k [m]."""
    return (
        worlds.segments[k, 0],
        worlds.segments[k, 1],
        worlds.segments[k, 2],
        worlds.segments[k, 3],
    )


@compiled
def to_base(dx, dy, cos, sin):
    """Turn a world vector into the frame with the heading (cos, sin)."""
    return cos * dx + sin * dy, cos * dy - sin * dx


@compiled
def polar(dx, dy, cos, sin):
    """Return the length of a world vector, and its direction seen from the heading (cos, sin)."""
    ahead, left = to_base(dx, dy, cos, sin)
    return np.sqrt(dx * dx + dy * dy), np.arctan2(left, ahead)


@compiled(inline=False)
def grid_clearance(x, y, cos, sin, base, worlds, w):
    """Return the distance from the footprint to the nearest solid cell [m]."""
    offset, size = worlds.grid_begin[w], worlds.grid_frame[w, 2]
    width, height = int(worlds.grid_frame[w, 3]), int(worlds.grid_frame[w, 4])
    px, py = to_cells(x, y, worlds, w)
    column = min(max(int(np.floor(px)), 0), width - 1)
    row = min(max(int(np.floor(py)), 0), height - 1)
    far = (worlds.grid_distance[offset + row * width + column] - 1.5) * size - base.radius
    if far > GRID_EXACT_DISTANCE:
        return far
    best = GRID_EXACT_DISTANCE
    cos, sin = turn_to_grid(cos, sin, worlds, w)
    reach = int(np.ceil((base.radius + GRID_EXACT_DISTANCE) / size)) + 1
    for r in range(max(row - reach, 0), min(row + reach + 1, height)):
        for c in range(max(column - reach, 0), min(column + reach + 1, width)):
            if worlds.grid_cells[offset + r * width + c] != 0:
                left, low = (c - px) * size, (r - py) * size
                best = min(best, cell_clearance(left, low, size, cos, sin, base, best))
    return best


@compiled(inline=False)
def cell_clearance(left, low, size, cos, sin, base, best):
    """Return the distance to one solid cell, its corner given relative to the robot [m]."""
    dx = max(left, -(left + size), 0.0)
    dy = max(low, -(low + size), 0.0)
    distance = np.sqrt(dx * dx + dy * dy) - base.radius
    if base.vertices.shape[0] == 0 or distance >= best:
        return distance
    # The robot's centre inside the cell: no side need be near.
    nearest = 0.0 if left <= 0.0 <= left + size and low <= 0.0 <= low + size else best
    for side in range(4):
        x1 = left + (size if side == 1 or side == 2 else 0.0)
        y1 = low + (size if side >= 2 else 0.0)
        x2 = left + (size if side <= 1 else 0.0)
        y2 = low + (size if side == 1 or side == 2 else 0.0)
        x1, y1 = to_base(x1, y1, cos, sin)
        x2, y2 = to_base(x2, y2, cos, sin)
        nearest = min(nearest, segment_to_polygon(x1, y1, x2, y2, base))
    return nearest
