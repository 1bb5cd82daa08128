# SPDX-License-Identifier: Apache-2.0
"""Mazes follow their laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.suites.maze import _grow, maze


@pytest.mark.parametrize("latest", [0.0, 0.5, 1.0])
def test_growing_leaves_one_way_between_any_two_cells(latest: float) -> None:
    columns, rows = 7, 5
    for seed in range(20):
        right, above = _grow(columns, rows, latest, np.random.default_rng(seed))
        # A connected graph of n cells with n - 1 openings is a tree.
        assert right.sum() + above.sum() == columns * rows - 1
        # Cells and openings drawn as pixels are connected.
        picture = np.zeros((2 * columns - 1, 2 * rows - 1), dtype=bool)
        picture[::2, ::2] = True
        picture[1::2, ::2], picture[::2, 1::2] = right, above
        assert ndimage.label(picture)[1] == 1


def test_latest_cells_make_longer_ways_than_random_ones() -> None:
    def dead_ends(latest: float) -> float:
        count = 0
        for seed in range(20):
            right, above = _grow(8, 8, latest, np.random.default_rng(seed))
            openings = np.zeros((8, 8), dtype=int)
            openings[:-1] += right
            openings[1:] += right
            openings[:, :-1] += above
            openings[:, 1:] += above
            count += int((openings == 1).sum())
        return count / 20

    # Of 64 cells a depth-first maze leaves about a tenth as dead ends, Prim's about a third.
    assert dead_ends(1.0) < 10
    assert dead_ends(0.0) > 16


def test_passages_are_as_wide_as_they_say() -> None:
    for seed in range(40):
        world = maze(np.random.default_rng(seed))
        assert world.bounds[:2] == (0.0, 0.0)
        for axis in (0, 1):
            assert 9.2 <= world.bounds[2 + axis] < 9.2 + 1.6
            upright = world.segments[:, axis] == world.segments[:, axis + 2]
            places = np.unique(world.segments[upright][:, axis])
            # Where a whole line of walls is missing the next one is further away.
            assert np.diff(places).min() >= 0.85 - 1e-9
            assert np.median(np.diff(places)) <= 1.6


def test_all_of_a_maze_can_be_reached() -> None:
    for seed in range(40):
        assert free_space(maze(np.random.default_rng(seed)), 0.27).regions().max() == 1


def test_walls_are_joined() -> None:
    for seed in range(40):
        segments = maze(np.random.default_rng(seed)).segments
        ends = {tuple(s[:2]) for s in segments.tolist()}
        for x1, y1, x2, y2 in segments[4:].tolist():
            assert x1 == x2 or y1 == y2
            # No other wall of the same direction goes on where this one ends.
            following = [s for s in segments[4:].tolist() if tuple(s[:2]) == (x2, y2)]
            assert not any((s[0] == s[2]) == (x1 == x2) for s in following)
        assert len(ends) > 10
        assert len(segments) <= 60
