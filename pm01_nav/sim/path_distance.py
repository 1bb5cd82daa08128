# SPDX-License-Identifier: Apache-2.0
"""How far the goal is along the shortest way that the robot can drive, for rewards.

A coarse raster of each world says where the robot fits. When an episode begins, the distance to
its goal spreads from cell to cell over that raster; in each step the robot reads it off the cells
around it. A policy never sees it.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled

DIAGONAL = np.sqrt(2.0)


@compiled
def spread_distance(state, i, worlds, scratch):
    """Fill the field of distances to the goal of environment i [m]; infinity where no way leads.

    A queue of cells whose neighbours may have become nearer (label correcting); a cell stands in
    it at most once, which ``scratch.queued`` marks.
    """
    w = state.world[i]
    begin, width = worlds.way_begin[w], int(worlds.way_frame[w, 3])
    cells = worlds.way_begin[w + 1] - begin
    if cells == 0:
        return
    size = worlds.way_frame[w, 2]
    for k in range(cells):
        state.path_field[i, k] = np.inf
        scratch.queued[i, k] = False
    count = start_at_goal(state, i, worlds, scratch)
    head = 0
    while count > 0:
        here = scratch.queue[i, head]
        head = head + 1 if head + 1 < cells else 0
        count -= 1
        scratch.queued[i, here] = False
        distance = state.path_field[i, here]
        for row in range(-1, 2):
            for column in range(-1, 2):
                there = here + row * width + column
                step = size * DIAGONAL if row != 0 and column != 0 else size
                nearer = distance + step < state.path_field[i, there] - 1e-6
                if nearer and worlds.way_cells[begin + there] != 0:
                    state.path_field[i, there] = distance + step
                    count = enqueue(scratch, i, there, head, count, cells)


@compiled
def start_at_goal(state, i, worlds, scratch):
    """Give the cells around the goal their straight distance; return how many there are."""
    w = state.world[i]
    begin, size = worlds.way_begin[w], worlds.way_frame[w, 2]
    width, cells = int(worlds.way_frame[w, 3]), worlds.way_begin[w + 1] - worlds.way_begin[w]
    column, row = cell_of(state.goal[i, 0], state.goal[i, 1], worlds, w)
    count = 0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            here = r * width + c
            if worlds.way_cells[begin + here] != 0:
                dx = worlds.way_frame[w, 0] + (c + 0.5) * size - state.goal[i, 0]
                dy = worlds.way_frame[w, 1] + (r + 0.5) * size - state.goal[i, 1]
                state.path_field[i, here] = np.sqrt(dx * dx + dy * dy)
                count = enqueue(scratch, i, here, 0, count, cells)
    return count


@compiled
def enqueue(scratch, i, cell, head, count, cells):
    """Put a cell at the end of the queue unless it stands in it; return the queue's length."""
    if scratch.queued[i, cell]:
        return count
    tail = head + count
    scratch.queue[i, tail if tail < cells else tail - cells] = cell
    scratch.queued[i, cell] = True
    return count + 1


@compiled
def cell_of(x, y, worlds, w):
    """Return column and row of the raster that hold a point, kept off its border of one cell."""
    size = worlds.way_frame[w, 2]
    width, height = int(worlds.way_frame[w, 3]), int(worlds.way_frame[w, 4])
    column = int(np.floor((x - worlds.way_frame[w, 0]) / size))
    row = int(np.floor((y - worlds.way_frame[w, 1]) / size))
    return min(max(column, 1), width - 2), min(max(row, 1), height - 2)


@compiled
def read_distance(state, i, worlds):
    """Read the path distance at the robot's place: over the best of the cells around it.

    Close to the goal, and where there is no raster, it is the straight distance. Where all those
    cells are closed it stays; an episode begins with the straight distance.
    """
    w = state.world[i]
    x, y, size = state.pose[i, 0], state.pose[i, 1], worlds.way_frame[w, 2]
    straight = state.goal_polar[i, 0]
    known = state.path_field.shape[1] > 0 and worlds.way_begin[w + 1] > worlds.way_begin[w]
    if not known or straight < 2.0 * size:
        state.path_distance[i] = straight
        return
    column, row = cell_of(x, y, worlds, w)
    best = np.inf
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            dx = worlds.way_frame[w, 0] + (c + 0.5) * size - x
            dy = worlds.way_frame[w, 1] + (r + 0.5) * size - y
            field = float(state.path_field[i, r * int(worlds.way_frame[w, 3]) + c])
            best = min(best, field + np.sqrt(dx * dx + dy * dy))
    if best < np.inf:
        state.path_distance[i] = max(best, straight)
