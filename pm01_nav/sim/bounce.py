# SPDX-License-Identifier: Apache-2.0
"""Discs that move straight on and are thrown back by what stands in their way.

The time of each hit is exact: a moving disc meets an obstacle where its centre meets the obstacle
grown by its radius. What a disc overlaps already counts as hit at once, and only on the way in.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import segment
from pm01_nav.sim.grid_frame import to_cells, turn_from_grid, turn_to_grid

MAX_HITS = 8
"""In one step; in a corner too narrow for more the disc rests until the next."""
GRAZE = 1e-12
"""A line that enters a circle by less is a tangent [m^2]."""


@compiled(inline=False)
def bounce(x, y, ux, uy, length, r, worlds, w):
    """Move a disc by ``length`` [m] along the unit vector (ux, uy), reflected by what it meets.

    Returns its place and its direction: x, y, ux, uy.
    """
    for _ in range(MAX_HITS):
        distance, nx, ny = first_hit(x, y, ux, uy, length, r, worlds, w)
        x, y, length = x + distance * ux, y + distance * uy, length - distance
        if length <= 0.0:
            break
        into = ux * nx + uy * ny
        ux, uy = ux - 2.0 * into * nx, uy - 2.0 * into * ny
    return x, y, ux, uy


@compiled(inline=False)
def first_hit(x, y, ux, uy, length, r, worlds, w):
    """Return how far a disc moves before it hits something, and the normal of what it hits.

    Without a hit these are ``length`` [m] and a vector of zeros.
    """
    hit = hit_bounds(x, y, ux, uy, r, worlds.bounds[w], (length, 0.0, 0.0))
    for k in range(worlds.disc_begin[w], worlds.disc_begin[w + 1]):
        dx, dy = x - worlds.discs[k, 0], y - worlds.discs[k, 1]
        hit = hit_circle(dx, dy, ux, uy, worlds.discs[k, 2] + r, hit)
    for k in range(worlds.segment_begin[w], worlds.segment_begin[w + 1]):
        x1, y1, x2, y2 = segment(worlds, k)
        hit = hit_segment(x - x1, y - y1, x2 - x1, y2 - y1, ux, uy, r, hit)
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        hit = hit_grid(x, y, ux, uy, r, worlds, w, hit)
    return hit


@compiled
def hit_bounds(x, y, ux, uy, r, bounds, hit):
    """Return the earlier of ``hit`` and where a disc touches the bounds from within."""
    if ux != 0.0:
        gap = bounds[2] - r - x if ux > 0.0 else x - r - bounds[0]
        if gap < hit[0] * abs(ux):
            hit = (max(gap, 0.0) / abs(ux), -np.sign(ux), 0.0)
    if uy != 0.0:
        gap = bounds[3] - r - y if uy > 0.0 else y - r - bounds[1]
        if gap < hit[0] * abs(uy):
            hit = (max(gap, 0.0) / abs(uy), 0.0, -np.sign(uy))
    return hit


@compiled
def hit_circle(dx, dy, ux, uy, reach, hit):
    """Return the earlier of ``hit`` and where a point, at (dx, dy) from a circle, enters it."""
    along = dx * ux + dy * uy
    under = along * along - dx * dx - dy * dy + reach * reach
    if along >= 0.0 or under <= GRAZE:
        return hit
    distance = max(-along - np.sqrt(under), 0.0)
    if distance >= hit[0]:
        return hit
    nx, ny = dx + distance * ux, dy + distance * uy
    norm = np.sqrt(nx * nx + ny * ny)
    return distance, nx / norm, ny / norm


@compiled(inline=False)
def hit_segment(dx, dy, ex, ey, ux, uy, r, hit):
    """Return the earlier of ``hit`` and where a disc, at (dx, dy) from a wall's end, touches it.

    (ex, ey) is the wall's extent [m].
    """
    length = np.sqrt(ex * ex + ey * ey)
    if length > 0.0:
        tx, ty = ex / length, ey / length
        offset = tx * dy - ty * dx
        side = 1.0 if offset >= 0.0 else -1.0
        nx, ny = -side * ty, side * tx
        closing = -(ux * nx + uy * ny)
        if closing > 0.0:
            distance = max(abs(offset) - r, 0.0) / closing
            along = (dx + distance * ux) * tx + (dy + distance * uy) * ty
            if distance < hit[0] and 0.0 <= along <= length:
                hit = (distance, nx, ny)
    hit = hit_circle(dx, dy, ux, uy, r, hit)
    return hit_circle(dx - ex, dy - ey, ux, uy, r, hit)


@compiled(inline=False)
def hit_grid(x, y, ux, uy, r, worlds, w, hit):
    """Return the earlier of ``hit`` and where a disc touches a solid cell."""
    offset, size = worlds.grid_begin[w], worlds.grid_frame[w, 2]
    width, height = int(worlds.grid_frame[w, 3]), int(worlds.grid_frame[w, 4])
    px, py = to_cells(x, y, worlds, w)
    reach = (r + hit[0]) / size
    column = min(max(int(np.floor(px)), 0), width - 1)
    row = min(max(int(np.floor(py)), 0), height - 1)
    # From centre to centre; each end may be half a diagonal nearer.
    if worlds.grid_distance[offset + row * width + column] - np.sqrt(2.0) > reach:
        return hit
    ux, uy = turn_to_grid(ux, uy, worlds, w)
    found = (hit[0], 0.0, 0.0)
    for j in range(max(int(np.floor(py - reach)), 0), min(int(py + reach) + 1, height)):
        for k in range(max(int(np.floor(px - reach)), 0), min(int(px + reach) + 1, width)):
            if worlds.grid_cells[offset + j * width + k] != 0:
                left, low = (px - k) * size, (py - j) * size
                found = hit_segment(left, low, size, 0.0, ux, uy, r, found)
                found = hit_segment(left, low, 0.0, size, ux, uy, r, found)
                found = hit_segment(left - size, low - size, -size, 0.0, ux, uy, r, found)
                found = hit_segment(left - size, low - size, 0.0, -size, ux, uy, r, found)
    if found[0] >= hit[0]:
        return hit
    nx, ny = turn_from_grid(found[1], found[2], worlds, w)
    return found[0], nx, ny
