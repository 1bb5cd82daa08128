# SPDX-License-Identifier: Apache-2.0
"""What stands around a mover: the nearest point of each disc, wall and group of solid cells."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import segment
from pm01_nav.sim.grid_frame import to_cells, turn_from_grid

MAX_WALLS = 16
"""The nearest so many discs, walls and groups of cells are looked at."""
OCTANT = np.sqrt(2.0) - 1.0
"""Tangent of 22.5 degrees."""


@compiled
def find_walls(x, y, r, far, worlds, w, walls, row):
    """Find what stands within ``far`` [m] of a place (x, y); return how much was written.

    Each goes into ``walls[row]`` (n, 3): the unit vector from its nearest point to the place, and
    the gap between it and a disc of radius ``r`` there [m].
    """
    count = 0
    for j in range(worlds.disc_begin[w], worlds.disc_begin[w + 1]):
        dx, dy = x - worlds.discs[j, 0], y - worlds.discs[j, 1]
        reach = far + worlds.discs[j, 2]
        if dx * dx + dy * dy < reach * reach:
            count = add_wall(walls, row, count, dx, dy, r + worlds.discs[j, 2])
    for j in range(worlds.segment_begin[w], worlds.segment_begin[w + 1]):
        x1, y1, x2, y2 = segment(worlds, j)
        ex, ey = x2 - x1, y2 - y1
        cross = (x - x1) * ey - (y - y1) * ex
        if cross * cross > far * far * (ex * ex + ey * ey):
            continue  # The whole line is too far away.
        along = ((x - x1) * ex + (y - y1) * ey) / max(ex * ex + ey * ey, 1e-18)
        along = min(max(along, 0.0), 1.0)
        dx, dy = x - x1 - along * ex, y - y1 - along * ey
        if dx * dx + dy * dy < far * far:
            count = add_wall(walls, row, count, dx, dy, r)
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        count = find_cells(x, y, r, far, worlds, w, walls, row, count)
    return count


@compiled
def add_wall(walls, row, count, dx, dy, r):
    """Add what lies at (-dx, -dy); of too many the farthest is left out. Return how many."""
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    slot = count
    if count == MAX_WALLS:
        slot = 0
        for j in range(1, count):
            if walls[row, j, 2] > walls[row, slot, 2]:
                slot = j
        if walls[row, slot, 2] <= distance - r:
            return count
    walls[row, slot, 0], walls[row, slot, 1] = dx / distance, dy / distance
    walls[row, slot, 2] = distance - r
    return min(count + 1, MAX_WALLS)


@compiled(inline=False)
def find_cells(x, y, r, far, worlds, w, walls, row, count):
    """Add the nearest solid point in each eighth of the circle around (x, y).

    Whoever keeps away from the nearest point of an eighth cannot get to a farther one first. The
    last row of ``walls`` is overwritten.
    """
    offset, size = worlds.grid_begin[w], worlds.grid_frame[w, 2]
    px, py = to_cells(x, y, worlds, w)
    width, height = int(worlds.grid_frame[w, 3]), int(worlds.grid_frame[w, 4])
    far /= size
    column = min(max(int(np.floor(px)), 0), width - 1)
    line = min(max(int(np.floor(py)), 0), height - 1)
    # From centre to centre; each end may be half a diagonal nearer.
    if worlds.grid_distance[offset + line * width + column] - np.sqrt(2.0) > far:
        return count
    spare = walls.shape[0] - 1
    for side in range(8):
        walls[spare, side, 2] = far * far
    for j in range(max(int(np.floor(py - far)), 0), min(int(py + far) + 1, height)):
        for k in range(max(int(np.floor(px - far)), 0), min(int(px + far) + 1, width)):
            if worlds.grid_cells[offset + j * width + k] != 0:
                dx = px - min(max(px, float(k)), k + 1.0)
                dy = py - min(max(py, float(j)), j + 1.0)
                squared = dx * dx + dy * dy
                side = octant(dx, dy)
                if squared < walls[spare, side, 2]:
                    walls[spare, side, 0], walls[spare, side, 1] = dx, dy
                    walls[spare, side, 2] = squared
    for side in range(8):
        if walls[spare, side, 2] < far * far:
            dx, dy = turn_from_grid(walls[spare, side, 0], walls[spare, side, 1], worlds, w)
            count = add_wall(walls, row, count, dx * size, dy * size, r)
    return count


@compiled
def octant(dx, dy):
    """Return which eighth of the circle a vector is in; the first is centred on the x axis."""
    if abs(dy) <= OCTANT * abs(dx):
        return 0 if dx >= 0.0 else 4
    if abs(dx) <= OCTANT * abs(dy):
        return 2 if dy >= 0.0 else 6
    if dx > 0.0:
        return 1 if dy > 0.0 else 7
    return 3 if dy > 0.0 else 5
