# SPDX-License-Identifier: Apache-2.0
"""Rooms to cross: nothing in the way, or discs and boxes."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.suites.layout import room_walls
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]


@suite(frozen="a0e178d46efa40e2633f7335eebde67bf97229793f74c1c2909aa84919258784")
def empty(rng: np.random.Generator) -> World:
    """Return a square room without obstacles; ``rng`` is not used."""
    del rng
    return World("empty", (0.0, 0.0, 10.0, 10.0), segments=room_walls(0.0, 0.0, 10.0, 10.0))


class StaticParams(FrozenModel):
    """What can be fixed of the worlds of ``static``."""

    obstacles: Annotated[int, Field(ge=0, le=60)]
    """One in five is a box. More hardly find a place."""


@suite(
    frozen="48aff46f09a49f5b4c911086356f7063164f3ebd1de34a0cbc3a4e9b84ef6bc2", params=StaticParams
)
def static(rng: np.random.Generator, params: StaticParams | None = None) -> World:
    """Draw a square room with discs and turned boxes."""
    if params is not None:
        num_boxes = params.obstacles // 5
        return _furnished(params.obstacles - num_boxes, num_boxes, rng)
    # How many: uniform on 4 ... 12 and 0 ... 3.
    num_discs, num_boxes = int(rng.integers(4, 13)), int(rng.integers(0, 4))
    return _furnished(num_discs, num_boxes, rng)


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


@suite(frozen="698aed3d74a87fa78c8366822237c7a42c1533419f28dc7ae1ce4224ad927125")
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
