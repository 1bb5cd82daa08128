# SPDX-License-Identifier: Apache-2.0
"""Searches on a grid of free cells, against SciPy's and by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from pm01_nav.worlds.grid_search import cheapest_path, line_is_free, pull_taut

NEIGHBOURS = [(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1) if (r, c) != (0, 0)]


def random_grid(rng: np.random.Generator):
    """Return free cells, an extra cost for each, and two free cells."""
    shape = tuple(rng.integers(2, 30, 2))
    free = rng.random(shape) > rng.uniform(0.0, 0.45)
    free[0, 0] = free[-1, -1] = True
    extra = rng.uniform(0.0, 5.0, shape).astype(np.float32) * rng.integers(0, 2)
    first, last = rng.permutation(np.argwhere(free))[[0, -1]].tolist()
    return free, extra, tuple(first), tuple(last)


def scipy_cost(free, extra, first, last) -> float:
    """Return the least cost from ``first`` to ``last`` by SciPy, on a graph built cell by cell."""
    height, width = free.shape
    rows, columns, costs = [], [], []
    for r, c in np.argwhere(free).tolist():
        for dr, dc in NEIGHBOURS:
            nr, nc = r + dr, c + dc
            if 0 <= nr < height and 0 <= nc < width and free[nr, nc]:
                mean = (float(extra[r, c]) + float(extra[nr, nc])) / 2
                rows.append(r * width + c)
                columns.append(nr * width + nc)
                costs.append(math.hypot(dr, dc) * (1 + mean))
    graph = coo_array((costs, (rows, columns)), shape=(height * width,) * 2).tocsr()
    distance = dijkstra(graph, indices=first[0] * width + first[1])
    return float(distance[last[0] * width + last[1]])


@pytest.mark.parametrize("guided", [True, False])
def test_cost_is_scipys_on_random_grids(guided: bool) -> None:
    rng = np.random.default_rng(0)
    found = 0
    for _ in range(150):
        free, extra, first, last = random_grid(rng)
        cells, costs = cheapest_path(free, extra, first, last, guided)
        expected = scipy_cost(free, extra, first, last)
        if len(cells) == 0:
            assert expected == math.inf
            continue
        found += 1
        # The extra costs are float32: seven digits.
        assert costs[0] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert costs[-1] == 0.0
        assert (tuple(cells[0]), tuple(cells[-1])) == (first, last)
        assert (np.abs(np.diff(cells, axis=0)).max(axis=1, initial=0) == 1).all()
        assert free[cells[:, 0], cells[:, 1]].all()
    assert found > 80


def test_path_by_hand() -> None:
    # A wall in row 2 but for its last column; from corner to corner of 5 x 5.
    free = np.ones((5, 5), dtype=np.bool_)
    free[2, :4] = False
    cells, costs = cheapest_path(free, np.zeros((5, 5), np.float32), (0, 0), (4, 0), True)
    # Two rows and four columns to the gap: two diagonal and two straight steps; then the same.
    assert costs[0] == pytest.approx(2 * (2 + 2 * math.sqrt(2.0)))
    assert [2, 4] in cells.tolist()
    assert len(cells) == 9


def test_start_and_goal_may_stand_in_closed_cells() -> None:
    free = np.array([[False, True, True, False]])
    cells, costs = cheapest_path(free, np.zeros((1, 4), np.float32), (0, 0), (0, 3), True)
    assert len(cells) == 4
    assert costs[0] == 3.0
    assert len(cheapest_path(~free, np.zeros((1, 4), np.float32), (0, 0), (0, 3), True)[0]) == 0


def test_taut_path_of_an_open_grid_is_straight() -> None:
    free, even = np.ones((20, 30), dtype=np.bool_), np.zeros((20, 30), dtype=np.float32)
    cells, costs = cheapest_path(free, even, (1, 2), (17, 25), False)
    assert pull_taut(free, even, cells, costs, len(cells)).tolist() == [0, len(cells) - 1]


def test_straight_pieces_are_no_longer_than_asked() -> None:
    free, even = np.ones((3, 21), dtype=np.bool_), np.zeros((3, 21), dtype=np.float32)
    cells, costs = cheapest_path(free, even, (1, 0), (1, 20), True)
    assert pull_taut(free, even, cells, costs, 8).tolist() == [0, 8, 16, 20]


def test_lines_replace_only_what_costs_as_much() -> None:
    # A dear square in the middle: around it is longer, but cheaper, and stays so.
    free, extra = np.ones((21, 41), dtype=np.bool_), np.zeros((21, 41), dtype=np.float32)
    extra[5:, 18:23] = 50.0
    cells, costs = cheapest_path(free, extra, (10, 0), (10, 40), True)
    kept = cells[pull_taut(free, extra, cells, costs, len(cells))]
    assert kept[:, 0].min() == 4
    pieces = np.linalg.norm(np.diff(kept, axis=0), axis=1)
    assert pieces.sum() <= costs[0]


def test_taut_paths_of_random_grids_are_free_and_no_longer() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        free, _, first, last = random_grid(rng)
        even = np.zeros(free.shape, dtype=np.float32)
        cells, costs = cheapest_path(free, even, first, last, True)
        if len(cells) == 0:
            continue
        kept = cells[pull_taut(free, even, cells, costs, len(cells))]
        assert np.linalg.norm(np.diff(kept, axis=0), axis=1).sum() <= costs[0] + 1e-9
        for a, b in pairwise(kept):
            # A single diagonal step may pass between two closed cells that touch at a corner.
            assert line_is_free(free, *a, *b) or np.abs(b - a).max() == 1
