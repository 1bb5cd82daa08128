# SPDX-License-Identifier: Apache-2.0
"""Places where others move: pedestrians in a room, carts between the shelves of a warehouse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.suites.layout import Box, Layout, box_points, room_walls, walkable
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Generator = Callable[[np.random.Generator], World]
Shelf = tuple[float, float, float, float]
"""Centre x, y, length along x, width along y [m]."""

SIDE = 10.0
"""Of the room and the warehouse [m]."""
PEDESTRIAN = (0.2, 0.3)
"""Radius of a pedestrian [m]."""
APART = 0.1
"""Between pedestrians when they set out, and from walls at all places they walk to [m]."""
AISLE = (1.4, 2.0)
"""Width of an aisle [m]."""
WAY = 3.0
"""Least distance between successive places of a pedestrian [m]."""


def crowd(rng: np.random.Generator) -> World:
    """Draw a lightly furnished room with about ten pedestrians."""
    # How many: uniform on 8 ... 12.
    return crowd_of(int(rng.integers(8, 13)))(rng)


def crowd_of(num_pedestrians: int) -> Generator:
    """Return a generator of rooms with so many pedestrians, or fewer if they find no room."""

    def generator(rng: np.random.Generator) -> World:
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
        return layout.world("crowd", movers=_pedestrians(layout, num_pedestrians, rng))

    return generator


def _pedestrians(
    layout: Layout, count: int, rng: np.random.Generator, others: tuple[Mover, ...] = ()
) -> list[Mover]:
    """Draw pedestrians whose places are free, and who do not touch each other at first."""
    places = walkable(layout, PEDESTRIAN[1] + APART)
    pedestrians: list[Mover] = []
    # Up to 20 draws for each.
    for _ in range(20 * count):
        if len(pedestrians) == count:
            break
        walker = _pedestrian(places, rng)
        distance = [
            np.hypot(*(walker.points[0] - m.points[0])) - walker.radius - m.radius
            for m in [*pedestrians, *others]
        ]
        if min(distance, default=np.inf) >= APART:
            pedestrians.append(walker)
    return pedestrians


def _pedestrian(places: FloatArray, rng: np.random.Generator) -> Mover:
    """Draw one pedestrian, who wanders or walks to and fro."""
    # Radius U(0.2, 0.3) m; speed U(0.4, 1.2) m/s: strolling to walking indoors.
    radius, speed = rng.uniform(*PEDESTRIAN), rng.uniform(0.4, 1.2)
    # Wandering with probability 1/2, else between 2 ... 4 places (uniform).
    num_points = 1 if rng.random() < 0.5 else rng.integers(2, 5)
    # Each place is uniform on the free ones at least 3 m from the place before.
    points = [places[rng.integers(len(places))]]
    while len(points) < num_points:
        apart = np.hypot(*(places - points[-1]).T)
        far = places[apart >= min(WAY, apart.max())]
        points.append(far[rng.integers(len(far))])
    return Mover("pedestrian", radius, np.array(points), speed=speed)


def warehouse(rng: np.random.Generator) -> World:
    """Draw rows of shelves, carts that drive round them, and a few workers."""
    bounds = (0.0, 0.0, SIDE, SIDE)
    layout = Layout(bounds, [room_walls(*bounds)])
    shelves = _shelves(rng)
    # One shelf in eight is missing.
    standing = [shelf for shelf in shelves if rng.random() >= 0.125]
    # Rows run along x or along y with equal probability.
    if rng.random() < 0.5:
        standing = [(y, x, width, length) for x, y, length, width in standing]
    for shelf in standing:
        layout.add_box((*shelf, 0.0))
    carts = _carts(layout, standing, rng)
    # Pallets: 1.2 m x 0.8 m, uniform on 0 ... 3, anywhere; yaw U(-0.2, 0.2) rad or a quarter turn
    # more; they do not stand in the way of a cart.
    for _ in range(rng.integers(0, 4)):
        x, y = rng.uniform(0.8, SIDE - 0.8, 2)
        yaw = rng.uniform(-0.2, 0.2) + 0.5 * np.pi * rng.integers(2)
        _add_pallet(layout, (x, y, 1.2, 0.8, yaw), carts)
    # Workers: uniform on 0 ... 2.
    workers = _pedestrians(layout, int(rng.integers(0, 3)), rng, tuple(carts))
    return layout.world("warehouse", movers=[*carts, *workers])


def _shelves(rng: np.random.Generator) -> list[Shelf]:
    """Draw rows of shelves along x with aisles all around them."""
    # Aisles U(1.4, 2) m: a cart and a robot pass each other. Shelves per row: uniform on 1 ... 3.
    left, right = rng.uniform(*AISLE, 2)
    num_runs = int(rng.integers(1, 4))
    crossings = rng.uniform(*AISLE, num_runs - 1)
    length = (SIDE - left - right - crossings.sum()) / num_runs
    begins = left + np.concatenate([[0.0], np.cumsum(length + crossings)])
    shelves = []
    y = rng.uniform(*AISLE)
    # Depth U(0.5, 1) m, the same in a row.
    while y + (depth := rng.uniform(0.5, 1.0)) <= SIDE - AISLE[0]:
        shelves += [(float(x) + 0.5 * length, y + 0.5 * depth, length, depth) for x in begins]
        y += depth + rng.uniform(*AISLE)
    return shelves


def _carts(layout: Layout, shelves: list[Shelf], rng: np.random.Generator) -> list[Mover]:
    """Draw carts that drive round a shelf or to and fro beside it, each on a way of its own."""
    carts: list[Mover] = []
    # How many: uniform on 2 ... 4; up to 8 draws for each.
    wanted = int(rng.integers(2, 5))
    for _ in range(8 * wanted):
        if len(carts) == wanted or not shelves:
            break
        cart = _cart(shelves[rng.integers(len(shelves))], rng)
        way = way_points(cart)
        free = layout.clearance(way) >= cart.radius + APART
        if free and all(_ways_apart(cart, other) for other in carts):
            carts.append(cart)
    return carts


def _cart(shelf: Shelf, rng: np.random.Generator) -> Mover:
    x, y, length, width = shelf
    # Radius U(0.22, 0.32) m, speed U(0.3, 0.7) m/s, U(0.5, 0.7) m beside the shelf.
    radius, speed, beside = rng.uniform(0.22, 0.32), rng.uniform(0.3, 0.7), rng.uniform(0.5, 0.7)
    way = rectangle(x, y, length + 2.0 * beside, width + 2.0 * beside)
    # Any corner is the first, either way round.
    way = np.roll(way, rng.integers(4), axis=0)[:: 1 if rng.random() < 0.5 else -1]
    # To and fro on the side that begins there with probability 0.4.
    return Mover("loop", radius, way[:2] if rng.random() < 0.4 else way, speed=speed)


def way_points(mover: Mover) -> FloatArray:
    """Return points along the closed way of a loop, 0.1 m apart or less, shape (n, 2)."""
    pieces = []
    for begin, end in zip(mover.points, np.roll(mover.points, -1, axis=0), strict=True):
        num = 1 + int(np.ceil(np.hypot(*(end - begin)) / 0.1))
        pieces.append(np.linspace(begin, end, num))
    return np.concatenate(pieces)


def _ways_apart(one: Mover, other: Mover) -> bool:
    apart = way_points(one)[:, None] - way_points(other)
    return bool(np.hypot(*apart.T).min() >= one.radius + other.radius + APART)


def _add_pallet(layout: Layout, box: Box, carts: list[Mover]) -> None:
    points = box_points(box)
    for cart in carts:
        apart = points[:, None] - way_points(cart)
        if np.hypot(*apart.T).min() < cart.radius + 2.0 * APART:
            return
    layout.add_box_if_clear(box)
