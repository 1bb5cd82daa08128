# SPDX-License-Identifier: Apache-2.0
"""Worlds of DynaBARN's kind: large discs that cross a hall without regard for the robot."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

HALF = 10.0
"""Half the side of the hall, which is open where the robot starts [m]."""
WALL = 0.25
"""Half the thickness of its walls [m]."""
BOUNDS = (-11.25, -11.25, 12.0, 11.25)
START = (11.0, 0.0, 3.14)
GOAL = (-9.0, 0.0)
RADIUS = 0.5
"""Of a moving disc [m]."""


class Level(NamedTuple):
    """How hard a world is; limits are both included."""

    movers: tuple[int, int]
    speed: tuple[float, float]
    """Of a mover along its way [m/s]."""
    bends: tuple[int, int]
    """Places within the hall that its way passes."""


# As the published worlds are shared out: 5 to 14, 14 to 19 and 18 to 24 discs; mean speeds of
# 0.5 to 0.9, 1.0 to 1.4 and 1.5 to 1.9 m/s.
LEVELS = (
    Level((5, 14), (0.5, 0.9), (0, 1)),
    Level((14, 19), (1.0, 1.4), (0, 4)),
    Level((18, 24), (1.5, 1.9), (0, 4)),
)


@suite(frozen="0d883dc4b57f7e8fe52791ae82399822651940b65f6471b4a4ccfb4bbcbd5419")
def dynabarn_like(rng: np.random.Generator) -> World:
    """Draw a hall of 20 m x 20 m that discs cross from wall to wall, over and over."""
    level = LEVELS[rng.integers(len(LEVELS))]
    count = rng.integers(*level.movers, endpoint=True)
    walls = (
        rectangle(-HALF, 0.0, 2.0 * WALL, 2.0 * HALF),
        rectangle(0.0, HALF, 2.0 * HALF, 2.0 * WALL),
        rectangle(0.0, -HALF, 2.0 * HALF, 2.0 * WALL),
    )
    return World(
        "dynabarn_like",
        BOUNDS,
        polygons=walls,
        movers=tuple(_mover(level, rng) for _ in range(count)),
        start=START,
        goal_area=(*GOAL, *GOAL),
    )


def _mover(level: Level, rng: np.random.Generator) -> Mover:
    """Draw a disc that follows a spline from one edge of the hall to another, then begins anew."""
    bends = rng.uniform(-HALF, HALF, (rng.integers(*level.bends, endpoint=True), 2))
    ends = [_on_edge(side, rng) for side in rng.choice(4, 2, replace=False)]
    corners = np.vstack([ends[0], bends, ends[1]])
    points = np.vstack([*_pieces(corners, rng), corners[-1:]])
    way = np.hypot(*np.diff(points, axis=0).T)
    # Each piece at up to a tenth more or less than the disc's own speed.
    speed = rng.uniform(*level.speed) * rng.uniform(0.9, 1.1, len(way))
    times = np.concatenate([[0.0], np.cumsum(way / speed)])
    return Mover("spline", RADIUS, points, times=times)


def _on_edge(side: int, rng: np.random.Generator) -> FloatArray:
    """Draw a place on one of the hall's four sides."""
    along, across = rng.uniform(-HALF, HALF), HALF if side % 2 else -HALF
    return np.array([along, across] if side < 2 else [across, along])


def _pieces(corners: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Divide each straight line between corners into 1 to 4 pieces; return where they begin."""
    pieces = []
    for begin, end in pairwise(corners):
        # Uneven pieces make a disc's speed change abruptly, as in the published worlds.
        cuts = np.sort(rng.uniform(0.05, 0.95, rng.integers(0, 4)))
        pieces.append(begin + np.concatenate([[0.0], cuts])[:, None] * (end - begin))
    return pieces
