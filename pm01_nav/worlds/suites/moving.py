# SPDX-License-Identifier: Apache-2.0
"""Places where others move: pedestrians in a room, carts between the shelves of a warehouse."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.geometry import polygon_edges, rectangle
from pm01_nav.worlds.free_space import FreeSpace, line_is_free
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.suites.layout import (
    PASSAGE,
    Box,
    Layout,
    box_points,
    points_along,
    room_walls,
    walkable,
)
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Shelf = tuple[float, float, float, float]
"""Centre x, y, length along x, width along y [m]."""

SIDE = 10.0
"""Of the room and the warehouse [m]."""
PEDESTRIAN = (0.2, 0.3)
"""Radius of a pedestrian [m]."""
APART = 0.1
"""Between pedestrians when they set out, and from walls at all places they walk to [m]."""
AISLE = (1.3, 1.8)
"""Width of an aisle [m]."""
WAY = 3.0
"""Least distance between successive places of a pedestrian [m]."""


class CrowdParams(FrozenModel):
    """What can be fixed of the worlds of ``crowd``."""

    pedestrians: Annotated[int, Field(ge=0, le=60)] = 10
    """There are fewer if they find no room. More hardly do."""
    speed_factor: Annotated[float, Field(ge=0.1, le=5.0)] = 1.0
    """They walk so many times as fast as usual."""


@suite(
    frozen="94f37fe9abb65617c7ebb4c0b34415ecf5a7a2366cfb0951642648e7edcb7b24", params=CrowdParams
)
def crowd(rng: np.random.Generator, params: CrowdParams | None = None) -> World:
    """Draw a lightly furnished room with about ten pedestrians."""
    # How many: uniform on 8 ... 12.
    params = params or CrowdParams(pedestrians=int(rng.integers(8, 13)))
    bounds = (0.0, 0.0, SIDE, SIDE)
    layout = Layout(bounds, [room_walls(*bounds)])
    # Pillars and plants: uniform on 0 ... 5; centres U(1, 9)^2 m, radii U(0.12, 0.35) m.
    for _ in range(rng.integers(0, 6)):
        x, y = rng.uniform(1.0, SIDE - 1.0, 2)
        layout.add_disc_if_clear(x, y, rng.uniform(0.12, 0.35))
    # Benches and counters: uniform on 0 ... 3; length U(0.6, 2) m, width U(0.3, 0.7) m.
    for _ in range(rng.integers(0, 4)):
        x, y = rng.uniform(1.0, SIDE - 1.0, 2)
        length, width = rng.uniform(0.6, 2.0), rng.uniform(0.3, 0.7)
        layout.add_box_if_clear((x, y, length, width, rng.uniform(-np.pi, np.pi)))
    walkers = [
        replace(walker, speed=params.speed_factor * walker.speed)
        for walker in _pedestrians(layout, params.pedestrians, rng)
    ]
    return layout.world("crowd", movers=walkers)


def _pedestrians(
    layout: Layout, count: int, rng: np.random.Generator, others: tuple[Mover, ...] = ()
) -> list[Mover]:
    """Draw pedestrians whose places are free, and who do not touch each other at first."""
    space = walkable(layout, PEDESTRIAN[1] + APART)
    pedestrians: list[Mover] = []
    # Up to 20 draws for each.
    for _ in range(20 * count):
        if len(pedestrians) == count:
            break
        walker = _pedestrian(space, rng)
        distance = [
            np.hypot(*(walker.points[0] - m.points[0])) - walker.radius - m.radius
            for m in [*pedestrians, *others]
        ]
        if min(distance, default=np.inf) >= APART:
            pedestrians.append(walker)
    return pedestrians


def _pedestrian(space: FreeSpace, rng: np.random.Generator) -> Mover:
    """Draw one pedestrian, who wanders or walks back and forth."""
    # Radius U(0.2, 0.3) m; speed U(0.4, 1.2) m/s: strolling to walking indoors.
    radius, speed = rng.uniform(*PEDESTRIAN), rng.uniform(0.4, 1.2)
    # Wandering with probability 1/2, else round 2 ... 4 places (uniform).
    num_places = 1 if rng.random() < 0.5 else int(rng.integers(2, 5))
    return Mover("pedestrian", radius, _walk(space, num_places, rng), speed=speed)


def _walk(space: FreeSpace, num_places: int, rng: np.random.Generator) -> FloatArray:
    """Draw places that can be walked to in turn on straight lines, and back, shape (n, 2) [m].

    Where no such round was found it is shorter, down to a single place.
    """
    free = np.argwhere(space.free)
    cells = [free[rng.integers(len(free))]]
    # Each further place is uniform on the free ones; up to 10 draws for each.
    for _ in range(10 * (num_places - 1)):
        if len(cells) == num_places:
            break
        cell = free[rng.integers(len(free))]
        far = np.hypot(*(cell - cells[-1])) * space.resolution >= WAY
        if far and all(line_is_free(space.free, *cell, *c) for c in (cells[0], cells[-1])):
            cells.append(cell)
    rows, columns = np.array(cells).T
    return space.centre(rows, columns)


@suite(frozen="e0e5939665fe45597e942c2e6994e2697d70f86158585ad1062f21bdb5a4810f")
def warehouse(rng: np.random.Generator) -> World:
    """Draw rows of shelves, carts that drive round them, and a few workers."""
    bounds = (0.0, 0.0, SIDE, SIDE)
    layout = Layout(bounds, [room_walls(*bounds)])
    shelves = _shelves(rng)
    # A shelf is missing with probability 0.1, but never a whole row of one.
    long = len({shelf[0] for shelf in shelves}) == 1
    standing = [shelf for shelf in shelves if rng.random() >= 0.1 or long]
    # Rows run along x or along y with equal probability.
    if rng.random() < 0.5:
        standing = [(y, x, width, length) for x, y, length, width in standing]
    for shelf in standing:
        layout.add_box((*shelf, 0.0))
    carts = _carts(layout, standing, rng)
    # Pallets of 1.2 m x 0.8 m, anywhere but in the way of a cart; yaw U(-0.2, 0.2) rad or a quarter
    # turn more. Draws: uniform on 0 ... 24, of which few find room.
    for _ in range(rng.integers(0, 25)):
        x, y = rng.uniform(0.8, SIDE - 0.8, 2)
        yaw = rng.uniform(-0.2, 0.2) + 0.5 * np.pi * rng.integers(2)
        _add_pallet(layout, (x, y, 1.2, 0.8, yaw), carts)
    # Workers: uniform on 0 ... 2.
    workers = _pedestrians(layout, int(rng.integers(0, 3)), rng, tuple(carts))
    return layout.world("warehouse", movers=[*carts, *workers])


def _shelves(rng: np.random.Generator) -> list[Shelf]:
    """Draw rows of shelves along x with aisles all around them."""
    # Aisles U(1.3, 1.8) m: a cart and a robot pass each other. Shelves per row: uniform on 1 ... 3.
    left, right = rng.uniform(*AISLE, 2)
    num_runs = int(rng.integers(1, 4))
    crossings = rng.uniform(*AISLE, num_runs - 1)
    length = (SIDE - left - right - crossings.sum()) / num_runs
    begins = left + np.concatenate([[0.0], np.cumsum(length + crossings)])
    shelves = []
    # The first row stands against the wall with probability 1/2.
    y = rng.uniform(*AISLE) * (rng.random() < 0.5)
    # Depth U(0.5, 1) m, the same in a row.
    while y + (depth := rng.uniform(0.5, 1.0)) <= SIDE - AISLE[0]:
        shelves += [(float(x) + 0.5 * length, y + 0.5 * depth, length, depth) for x in begins]
        y += depth + rng.uniform(*AISLE)
    return shelves


def _carts(layout: Layout, shelves: list[Shelf], rng: np.random.Generator) -> list[Mover]:
    """Draw carts that drive round a shelf or back and forth beside it, each on a way of its own."""
    carts: list[Mover] = []
    # How many: uniform on 2 ... 4; up to 8 draws for each.
    wanted = int(rng.integers(2, 5))
    for _ in range(8 * wanted):
        if len(carts) == wanted or not shelves:
            break
        cart = _cart(shelves[rng.integers(len(shelves))], rng)
        way = _way(cart)
        free = layout.encloses(way) and layout.clearance(way) >= cart.radius + APART
        if free and all(_ways_apart(cart, other) for other in carts):
            carts.append(cart)
    return carts


def _cart(shelf: Shelf, rng: np.random.Generator) -> Mover:
    x, y, length, width = shelf
    # Radius U(0.22, 0.32) m, speed U(0.3, 0.7) m/s, U(0.5, 0.7) m beside the shelf.
    radius, speed, beside = rng.uniform(0.22, 0.32), rng.uniform(0.3, 0.7), rng.uniform(0.5, 0.7)
    way = rectangle(x, y, length + 2.0 * beside, width + 2.0 * beside)
    # Round the shelf with probability 0.6, from any corner; else along a longer side and back.
    if rng.random() < 0.6:
        way = np.roll(way, rng.integers(4), axis=0)
    else:
        way = np.roll(way, 0 if length >= width else 1, axis=0)[2 * rng.integers(2) :][:2]
    # Either way round, or from either end.
    return Mover("loop", radius, way[:: 1 if rng.random() < 0.5 else -1], speed=speed)


def _way(mover: Mover) -> FloatArray:
    """Return points along the closed way of a loop, shape (n, 2)."""
    return points_along(polygon_edges(mover.points))


def _ways_apart(one: Mover, other: Mover) -> bool:
    apart = _way(one)[:, None] - _way(other)
    return bool(np.hypot(*apart.T).min() >= one.radius + other.radius + APART)


def _add_pallet(layout: Layout, box: Box, carts: list[Mover]) -> None:
    # Most draws fail already at the middle.
    if layout.clearance(np.array([box[:2]])) < PASSAGE:
        return
    points = box_points(box)
    for cart in carts:
        apart = points[:, None] - _way(cart)
        if np.hypot(*apart.T).min() < cart.radius + 2.0 * APART:
            return
    layout.add_box_if_clear(box)
