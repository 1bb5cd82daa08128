# SPDX-License-Identifier: Apache-2.0
"""Mazes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.suites.layout import (
    WALL_THICKNESS,
    Area,
    Layout,
    merge_walls,
    room_walls,
)
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

Cell = tuple[int, int]
BoolArray = NDArray[np.bool_]

LEAST_SIDE = 10.0
"""Of the maze [m]."""
PASSAGE_WIDTH = (0.85, 1.6)
"""[m]"""


@suite(frozen="e44d4f408981ad4626c431a2eb6f95960e04dcd2a073878fa239979d5ce276be")
def maze(rng: np.random.Generator) -> World:
    """Draw a maze whose passages differ in width; some dead ends are opened, so that it has rings.

    It grows from cell to cell: from the latest one, which gives long ways, or from a random one,
    which gives many short dead ends.
    """
    x, y = _edges(rng), _edges(rng)
    columns, rows = len(x) - 1, len(y) - 1
    # It grows from the latest cell with probability U(0.5, 1).
    latest = rng.uniform(0.5, 1.0)
    right, above = _grow(columns, rows, latest, rng)
    # Each wall that is left falls with probability U(0, 0.12).
    falls = rng.uniform(0.0, 0.12)
    right |= rng.random(right.shape) < falls
    above |= rng.random(above.shape) < falls
    walls: list[Area] = [(x[i + 1], y[j], x[i + 1], y[j + 1]) for i, j in np.argwhere(~right)]
    walls += [(x[i], y[j + 1], x[i + 1], y[j + 1]) for i, j in np.argwhere(~above)]
    bounds = (0.0, 0.0, x[-1], y[-1])
    layout = Layout(bounds, [room_walls(*bounds)])
    # Half their thickness longer, so that corners are closed.
    layout.add_walls(merge_walls(walls), beyond=0.5 * WALL_THICKNESS)
    return layout.world("maze")


def _edges(rng: np.random.Generator) -> list[float]:
    """Draw where the middles of walls may stand along one side [m]: n + 1 for n passages."""
    # Passages U(0.85, 1.6) m wide, those at the side half a wall wider; until the side is 10 m
    # long or more.
    edges = [0.0]
    while edges[-1] < LEAST_SIDE:
        edges.append(edges[-1] + rng.uniform(*PASSAGE_WIDTH) + WALL_THICKNESS)
    return edges


def _grow(
    columns: int, rows: int, latest: float, rng: np.random.Generator
) -> tuple[BoolArray, BoolArray]:
    """Open walls until every cell is connected (growing tree).

    Returns which cells are open to the right (columns - 1, rows) and upwards (columns, rows - 1).
    """
    right = np.zeros((columns - 1, rows), dtype=np.bool_)
    above = np.zeros((columns, rows - 1), dtype=np.bool_)
    # The first cell is uniform.
    active: list[Cell] = [(int(rng.integers(columns)), int(rng.integers(rows)))]
    seen = set(active)
    while active:
        index = len(active) - 1
        if rng.random() >= latest:
            index = int(rng.integers(len(active)))
        i, j = active[index]
        around = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        unseen = [
            (k, m) for k, m in around if 0 <= k < columns and 0 <= m < rows and (k, m) not in seen
        ]
        if not unseen:
            active.pop(index)
            continue
        # The next cell is uniform on the neighbours not seen yet.
        k, m = unseen[rng.integers(len(unseen))]
        if k != i:
            right[min(i, k), j] = True
        else:
            above[i, min(j, m)] = True
        seen.add((k, m))
        active.append((k, m))
    return right, above
