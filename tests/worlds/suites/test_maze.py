# SPDX-License-Identifier: Apache-2.0
"""Mazes follow their laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.suites.maze import _grow, maze
from pm01_nav.worlds.world import World


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
            assert 10.0 <= world.bounds[2 + axis] < 10.0 + 1.7
            middles = [low[axis] + 0.05 for low, high in _walls(world) if _across(low, high, axis)]
            places = np.unique(np.round([0.0, *middles, world.bounds[2 + axis]], 6))
            # Between two walls 0.1 m thick. Where a whole line of walls is missing the next one is
            # further away.
            assert np.diff(places).min() >= 0.85 + 0.1 - 1e-5
            assert np.median(np.diff(places)) <= 1.6 + 0.1


def test_all_of_a_maze_can_be_reached() -> None:
    for seed in range(40):
        assert free_space(maze(np.random.default_rng(seed)), 0.27).regions().max() == 1


def test_walls_are_joined() -> None:
    for seed in range(40):
        walls = _walls(maze(np.random.default_rng(seed)))
        assert 10 < len(walls) <= 60
        for axis in (0, 1):
            upright = [wall for wall in walls if _across(*wall, axis)]
            for low, high in upright:
                # No other wall of the same direction goes on where this one ends.
                others = [w for w in upright if abs(w[0][axis] - low[axis]) < 1e-6]
                assert sum(w[0][1 - axis] <= high[1 - axis] + 0.1 for w in others) == 1 + sum(
                    w[1][1 - axis] < low[1 - axis] for w in others
                )


def test_a_wall_can_be_seen_end_on() -> None:
    """Every wall is 0.1 m wide: 2 degrees and more at 2 m, wider than a beam apart."""
    for low, high in _walls(maze(np.random.default_rng(0))):
        assert min(high - low) == pytest.approx(0.1)


def _walls(world: World) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the lower left and upper right corners of the walls."""
    return [(p.min(axis=0), p.max(axis=0)) for p in world.polygons]


def _across(low: np.ndarray, high: np.ndarray, axis: int) -> bool:
    """Tell whether a wall is thin along an axis."""
    return bool(high[axis] - low[axis] < 0.1 + 1e-6)
