# SPDX-License-Identifier: Apache-2.0
"""Rooms to cross: nothing in the way, or discs and boxes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.suites.layout import room_walls
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Generator = Callable[[np.random.Generator], World]


def empty(rng: np.random.Generator) -> World:
    """Return a square room without obstacles; ``rng`` is not used."""
    del rng
    return World("empty", (0.0, 0.0, 10.0, 10.0), segments=room_walls(0.0, 0.0, 10.0, 10.0))


def static(rng: np.random.Generator) -> World:
    """Draw a square room with discs and turned boxes."""
    # How many: uniform on 4 ... 12 and 0 ... 3.
    num_discs, num_boxes = int(rng.integers(4, 13)), int(rng.integers(0, 4))
    return _furnished(num_discs, num_boxes, rng)


def static_of(obstacles: int) -> Generator:
    """Return a generator of such rooms with so many obstacles, one in five of them a box."""

    def generator(rng: np.random.Generator) -> World:
        num_boxes = obstacles // 5
        return _furnished(obstacles - num_boxes, num_boxes, rng)

    return generator


def _furnished(num_discs: int, num_boxes: int, rng: np.random.Generator) -> World:
    # Centres U(0.5, 9.5)^2 m; radii U(0.15, 0.5) m.
    discs = np.column_stack(
        [rng.uniform(0.5, 9.5, (num_discs, 2)), rng.uniform(0.15, 0.5, num_discs)]
    )
    boxes = tuple(_draw_box(rng) for _ in range(num_boxes))
    walls = room_walls(0.0, 0.0, 10.0, 10.0)
    return World("static", (0.0, 0.0, 10.0, 10.0), discs=discs, polygons=boxes, segments=walls)


def _draw_box(rng: np.random.Generator) -> FloatArray:
    # Centre U(0.5, 9.5)^2 m; sides U(0.3, 1.2) m; yaw U(-pi, pi).
    x, y = rng.uniform(0.5, 9.5, 2)
    length, width = rng.uniform(0.3, 1.2, 2)
    return rectangle(x, y, length, width, rng.uniform(-np.pi, np.pi))


def article(rng: np.random.Generator) -> World:
    """Draw a room to cross from a fixed start, with a few discs on the way."""
    bounds = (-1.5, -3.5, 8.5, 3.5)
    # How many: uniform on 0 ... 6.
    num_discs = rng.integers(0, 7)
    discs: list[tuple[float, float, float]] = []
    while len(discs) < num_discs:
        # Centre uniform in the room, radius U(0.15, 0.4) m; drawn again near the start.
        x, y = rng.uniform(bounds[:2], bounds[2:])
        radius = rng.uniform(0.15, 0.4)
        if np.hypot(x, y) - radius >= 0.8:
            discs.append((x, y, radius))
    return World(
        "article",
        bounds,
        discs=np.array(discs).reshape(-1, 3),
        segments=room_walls(*bounds),
        start=(0.0, 0.0, 0.0),
        goal_area=(3.0, -2.0, 7.0, 2.0),
    )
