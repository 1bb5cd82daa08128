# SPDX-License-Identifier: Apache-2.0
"""Kernels that search a grid of free cells: cheapest ways, and what can be seen past.

A grid is ``free``, bool of shape (height, width), and ``extra``, float32 of the same shape: what
each cell costs on top of the way's length, as a part of it. A cell is a tuple (row, column).
"""

from __future__ import annotations

import heapq

import numpy as np

from pm01_nav.compilation import compiled

SLACK = 1e-6
"""A straight line may cost so much more than the way it replaces: rounding, as a part of it."""


@compiled
def line_is_free(free, row, column, row_end, column_end):
    """Tell whether all cells that a straight line between two centres passes are free."""
    steps = 2 * max(abs(row_end - row), abs(column_end - column))
    for k in range(steps + 1):
        part = k / max(steps, 1)
        r = int(np.floor(row + part * (row_end - row) + 0.5))
        c = int(np.floor(column + part * (column_end - column) + 0.5))
        if not free[r, c]:
            return False
    return True


@compiled
def line_costs_at_most(free, extra, begin, end, limit):
    """Tell whether a straight line between two centres is free and costs ``limit`` or less."""
    rows, columns = end[0] - begin[0], end[1] - begin[1]
    steps = 2 * max(abs(rows), abs(columns))
    length = np.sqrt(float(rows * rows + columns * columns)) / max(steps, 1)
    cost = 0.0
    for k in range(steps + 1):
        part = k / max(steps, 1)
        r = int(np.floor(begin[0] + part * rows + 0.5))
        c = int(np.floor(begin[1] + part * columns + 0.5))
        if not free[r, c]:
            return False
        # Trapezoidal rule: the ends count half.
        weight = 0.5 if k == 0 or k == steps else 1.0
        cost += weight * length * (1.0 + extra[r, c])
        if cost > limit:
            return False
    return True


@compiled
def octile_distance(row, column, row_end, column_end):
    """Return the length of a shortest way of 8-connected steps with nothing between [cells]."""
    rows, columns = abs(row_end - row), abs(column_end - column)
    return max(rows, columns) + (np.sqrt(2.0) - 1.0) * min(rows, columns)


@compiled(allocates=True)
def cheapest_path(free, extra, start, goal, guided):
    """Return the cells of a cheapest 8-connected path, start first, and what is left from each.

    A step of length d [cells] costs d (1 + mean extra of its two cells). Shapes (n, 2) and (n,);
    no rows where there is no path. Start and goal may stand in closed cells. ``guided`` is A* with
    the octile distance, else it is Dijkstra's algorithm, which chooses differently among equals.
    """
    height, width = free.shape
    cost = np.full(height * width, np.inf)
    parent = np.full(height * width, -1, dtype=np.int64)
    # From the goal to the start, so that the parents lead the right way round.
    source, target = goal[0] * width + goal[1], start[0] * width + start[1]
    cost[source] = 0.0
    queue = [(0.0, source)]
    while len(queue) > 0:
        estimate, here = heapq.heappop(queue)
        if here == target:
            break
        r, c = here // width, here % width
        ahead = octile_distance(r, c, start[0], start[1]) if guided else 0.0
        if estimate > cost[here] + ahead:
            continue
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                nr, nc = r + dr, c + dc
                if (dr == 0 and dc == 0) or nr < 0 or nc < 0 or nr >= height or nc >= width:
                    continue
                there = nr * width + nc
                if not free[nr, nc] and there != target:
                    continue
                factor = 1.0 + 0.5 * (extra[r, c] + extra[nr, nc])
                through = cost[here] + factor * np.sqrt(float(dr * dr + dc * dc))
                if through < cost[there]:
                    cost[there] = through
                    parent[there] = here
                    ahead = octile_distance(nr, nc, start[0], start[1]) if guided else 0.0
                    heapq.heappush(queue, (through + ahead, there))
    if not np.isfinite(cost[target]):
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    return _trace(cost, parent, source, target, width)


@compiled(allocates=True)
def _trace(cost, parent, source, target, width):
    """Follow the parents from ``target`` to ``source``."""
    count = 1
    here = target
    while here != source:
        here = parent[here]
        count += 1
    cells, costs = np.zeros((count, 2), dtype=np.int64), np.zeros(count)
    here = target
    for k in range(count):
        cells[k, 0], cells[k, 1] = here // width, here % width
        costs[k] = cost[here]
        here = parent[here]
    return cells, costs


@compiled(allocates=True)
def pull_taut(free, extra, cells, costs, reach):
    """Return the indices of the cells left after skipping all that can be seen past.

    ``cells`` and ``costs`` are those of ``cheapest_path``. A straight line replaces at most
    ``reach`` steps, and only where it costs no more than they do.
    """
    count = cells.shape[0]
    kept = [0]
    here = 0
    while here < count - 1:
        begin = (cells[here, 0], cells[here, 1])
        furthest = here + 1
        for k in range(min(count - 1, here + reach), here + 1, -1):
            limit = (1.0 + SLACK) * (costs[here] - costs[k])
            if line_costs_at_most(free, extra, begin, (cells[k, 0], cells[k, 1]), limit):
                furthest = k
                break
        kept.append(furthest)
        here = furthest
    return np.array(kept)
