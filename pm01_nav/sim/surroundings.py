# SPDX-License-Identifier: Apache-2.0
"""What stands around a mover: the nearest point of each disc, wall and group of solid cells."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import segment

MAX_WALLS = 16
"""The nearest so many discs, walls and groups of cells are looked at."""
OCTANT = np.sqrt(2.0) - 1.0
"""Tangent of 22.5 degrees."""


@compiled(inline=False)
def find_walls(state, i, k, reach, worlds, walls):
    """Find what stands within ``reach`` [m] of a mover; return how many rows were written.

    A row is the unit vector from the nearest point to the mover and the gap between them [m].
    """
    w, r = state.world[i], state.mover_radius[i, k]
    x, y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
    count = 0
    for j in range(worlds.disc_begin[w], worlds.disc_begin[w + 1]):
        dx, dy = x - worlds.discs[j, 0], y - worlds.discs[j, 1]
        far = r + worlds.discs[j, 2] + reach
        if dx * dx + dy * dy < far * far:
            count = add_wall(walls, count, dx, dy, r + worlds.discs[j, 2])
    for j in range(worlds.segment_begin[w], worlds.segment_begin[w + 1]):
        x1, y1, x2, y2 = segment(worlds, j)
        ex, ey = x2 - x1, y2 - y1
        along = ((x - x1) * ex + (y - y1) * ey) / max(ex * ex + ey * ey, 1e-18)
        along = min(max(along, 0.0), 1.0)
        dx, dy = x - x1 - along * ex, y - y1 - along * ey
        if dx * dx + dy * dy < (r + reach) * (r + reach):
            count = add_wall(walls, count, dx, dy, r)
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        count = find_cells(x, y, r, reach, worlds, w, walls, count)
    return count


@compiled
def add_wall(walls, count, dx, dy, r):
    """Add what lies at (-dx, -dy); of too many the farthest is left out. Return how many."""
    distance = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    row = count
    if count == MAX_WALLS:
        row = 0
        for j in range(1, count):
            if walls[j, 2] > walls[row, 2]:
                row = j
        if walls[row, 2] <= distance - r:
            return count
    walls[row, 0], walls[row, 1], walls[row, 2] = dx / distance, dy / distance, distance - r
    return min(count + 1, MAX_WALLS)


@compiled(inline=False)
def find_cells(x, y, r, reach, worlds, w, walls, count):
    """Add the nearest solid point in each eighth of the circle around (x, y).

    Whoever keeps away from the nearest point of an eighth cannot get to a farther one first.
    """
    offset, size = worlds.grid_begin[w], worlds.grid_frame[w, 2]
    px, py = (x - worlds.grid_frame[w, 0]) / size, (y - worlds.grid_frame[w, 1]) / size
    width, height = int(worlds.grid_frame[w, 3]), int(worlds.grid_frame[w, 4])
    far = (r + reach) / size
    column = min(max(int(np.floor(px)), 0), width - 1)
    row = min(max(int(np.floor(py)), 0), height - 1)
    # From centre to centre; each end may be half a diagonal nearer.
    if worlds.grid_distance[offset + row * width + column] - np.sqrt(2.0) > far:
        return count
    nearest = np.full((8, 3), far * far)
    for j in range(max(int(np.floor(py - far)), 0), min(int(py + far) + 1, height)):
        for k in range(max(int(np.floor(px - far)), 0), min(int(px + far) + 1, width)):
            if worlds.grid_cells[offset + j * width + k] != 0:
                dx = px - min(max(px, float(k)), k + 1.0)
                dy = py - min(max(py, float(j)), j + 1.0)
                squared = dx * dx + dy * dy
                side = octant(dx, dy)
                if squared < nearest[side, 2]:
                    nearest[side, 0], nearest[side, 1], nearest[side, 2] = dx, dy, squared
    for side in range(8):
        if nearest[side, 2] < far * far:
            count = add_wall(walls, count, nearest[side, 0] * size, nearest[side, 1] * size, r)
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
