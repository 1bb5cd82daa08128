# SPDX-License-Identifier: Apache-2.0
"""Worlds of BARN's kind: fields of cylinders, grown by a cellular automaton."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds import barn
from pm01_nav.worlds.barn_grid import outer_walls
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BARN_SIZE = 30
"""Cells along each side of BARN's grid."""
BARN_CELL = 0.15
"""Side of a cell [m]; a cylinder fills it."""
BARN_RADIUS = 0.075
# Perille et al. (2020) fill with 0.15, 0.20, 0.25, 0.30 and throw away what has no way through,
# of the fullest grids all but about one in a thousand. Opening a way instead leaves more cylinders
# standing; with these two lower levels their number is again distributed as in the real worlds.
BARN_FILL = (0.15, 0.20, 0.23, 0.27)
BARN_WAY = 5
"""Cells across the square that must pass: Perille et al. keep 2 free on each side of the path."""


@suite(frozen="a779dcf47f1ec0b0c7eb8934d95351199300552248829aba36aa315fbe9d5884")
def barn_like(rng: np.random.Generator) -> World:
    """Draw a world of the same kind as BARN's: blobs grown by a cellular automaton.

    The grid's rows run along x, its columns along y, as in the original generator.
    """
    from scipy import ndimage

    # Fill: uniform on BARN_FILL; each cell is solid with that probability, side walls always.
    fill = rng.choice(BARN_FILL)
    solid = rng.random((BARN_SIZE, BARN_SIZE)) < fill
    solid[[0, -1]] = True
    # Smoothing steps: uniform on 2, 3, 4 (Perille et al.).
    for _ in range(rng.integers(2, 5)):
        neighbours = _count_neighbours(solid)
        solid = (neighbours >= 5) | (solid & (neighbours >= 2))
    solid &= ~_cheapest_way(solid, rng)
    # Blobs are hollow: a cell with eight solid neighbours gets no cylinder.
    inside = ndimage.binary_erosion(solid, np.ones((3, 3))).astype(np.bool_)
    row, column = np.nonzero(solid & ~inside)
    blobs = np.stack([-4.425 + BARN_CELL * row, 5.175 + BARN_CELL * column], axis=1)
    places = np.concatenate([outer_walls(), blobs])
    discs = np.column_stack([places, np.full(len(places), BARN_RADIUS)])
    goal_area = (*barn.GOAL, *barn.GOAL)
    return World("barn_like", barn.BOUNDS, discs=discs, start=barn.START, goal_area=goal_area)


def _count_neighbours(solid: BoolArray) -> NDArray[np.int8]:
    """Count each cell's eight neighbours; beyond the side walls is solid, beyond the ends free."""
    padded = np.pad(solid.astype(np.int8), 1)
    padded[[0, -1]] = 1
    three = padded[:-2] + padded[1:-1] + padded[2:]
    return three[:, :-2] + three[:, 1:-1] + three[:, 2:] - solid


def _cheapest_way(solid: BoolArray, rng: np.random.Generator) -> BoolArray:
    """Return the cells of a way from end to end, 5 cells wide, that clears as little as possible.

    It moves by at most one row a column and is found column by column (dynamic programming).
    """
    from scipy import ndimage

    half = BARN_WAY // 2
    inner = slice(1 + half, BARN_SIZE - 1 - half)
    # Solid cells in the square around a cell, plus U(0, 0.5) to choose among equal ways.
    blocked = ndimage.uniform_filter(solid.astype(np.float64), BARN_WAY, mode="constant")
    cost = np.full(solid.shape, np.inf)
    cost[inner] = BARN_WAY**2 * blocked[inner] + rng.uniform(0.0, 0.5, cost[inner].shape)
    # A sidestep costs as much as two solid cells: the ways of the real worlds are that straight.
    sidestep = np.array([[2.0], [0.0], [2.0]])
    step = np.zeros(solid.shape, dtype=np.int64)
    padded = np.full(BARN_SIZE + 2, np.inf)
    for column in range(BARN_SIZE):
        before = np.stack([padded[:-2], padded[1:-1], padded[2:]]) + sidestep
        step[:, column] = before.argmin(axis=0) - 1
        padded[1:-1] = cost[:, column] + (before.min(axis=0) if column else 0.0)
    row = int(padded.argmin()) - 1
    way = np.zeros(solid.shape, dtype=np.bool_)
    for column in range(BARN_SIZE - 1, -1, -1):
        way[row - half : row + half + 1, max(column - half, 0) : column + half + 1] = True
        row += int(step[row, column])
    return way
