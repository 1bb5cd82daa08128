# SPDX-License-Identifier: Apache-2.0
"""Buildings: corridors between solid blocks, and furnished rooms with doors."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.suites.layout import (
    PASSAGE,
    Area,
    Box,
    Layout,
    divide,
    merge_walls,
    room_walls,
    turned,
)
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

CORRIDOR = (0.8, 1.6)
"""Width of a corridor [m]."""
HAIR = 1e-6
"""For comparisons of what touches [m]."""
LEAST_CLOSED = 0.5
"""Narrower gaps are not worth closing [m]."""
DOOR = (0.8, 1.2)
"""Width of a door [m]."""
LEAF_THICKNESS = 0.04
"""Of a door leaf [m]."""
DOOR_MARGIN = 0.1
"""Wall left at least on either side of a door [m]."""
BEFORE_DOOR = 0.6
"""Free of furniture from either end of a door on [m]."""


@suite(frozen="227249e33609d86c497da562594e9c11333c7d9e7aecbd97a512ac37eb876896")
def corridors(rng: np.random.Generator) -> World:
    """Draw corridors between solid blocks, with open places and things left standing there."""
    # Sides U(9, 11) m.
    width, height = rng.uniform(9.0, 11.0, 2)
    layout = Layout((0.0, 0.0, width, height), [room_walls(0.0, 0.0, width, height)])
    # Each outer wall has a corridor along it with probability 1/2, of width U(0.8, 1.6) m.
    ring = rng.uniform(*CORRIDOR, 4) * (rng.random(4) < 0.5)
    inner = (ring[0], ring[1], width - ring[2], height - ring[3])
    # Blocks: longer side at most U(3, 5) m; corridors between them U(0.8, 1.6) m wide.
    for block in divide(inner, rng, (3.0, 5.0), CORRIDOR, (0.3, 0.7)):
        # A block of up to 5 m^2 is left out with probability 0.2: an open place.
        small = (block[2] - block[0]) * (block[3] - block[1]) <= 5.0
        if rng.random() < 0.2 and small:
            _open_place(layout, block, rng)
        else:
            layout.polygons.append(_block(block, rng))
    # Corridors to try to close: uniform on 1 ... 6.
    for _ in range(rng.integers(1, 7)):
        _close_corridor(layout, rng)
    # Things in the way: uniform on 0 ... 6.
    for _ in range(rng.integers(0, 7)):
        _leave_standing(layout, rng)
    return layout.world("corridors")


def _block(block: Area, rng: np.random.Generator) -> FloatArray:
    """Return a block's outline; some corners are cut off."""
    x_min, y_min, x_max, y_max = block
    corners = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
    room = 0.4 * min(x_max - x_min, y_max - y_min)
    outline: list[FloatArray] = []
    for k in range(4):
        # A corner is cut with probability 0.2, by U(0.2, 0.8) m but not more than the block has.
        cut = min(rng.uniform(0.2, 0.8), room) if rng.random() < 0.2 else 0.0
        if cut > 0.0:
            for neighbour in (corners[k - 1], corners[(k + 1) % 4]):
                side = neighbour - corners[k]
                outline.append(corners[k] + cut * side / np.linalg.norm(side))
        else:
            outline.append(corners[k])
    return np.array(outline)


def _open_place(layout: Layout, area: Area, rng: np.random.Generator) -> None:
    # Pillars: uniform on 0 ... 2, anywhere; radii U(0.1, 0.3) m.
    for _ in range(rng.integers(0, 3)):
        x, y = rng.uniform(area[:2], area[2:])
        layout.add_disc_if_clear(x, y, rng.uniform(0.1, 0.3))


def _close_corridor(layout: Layout, rng: np.random.Generator) -> None:
    """Put a wall across a corridor where that leaves a dead end but no place cut off."""
    beside = _beside_block(layout, rng)
    if beside is None:
        return
    place, outward = beside
    width = layout.ray(place + HAIR * outward, outward)
    if not LEAST_CLOSED <= width <= CORRIDOR[1]:
        return
    # Not where another obstacle is nearer than the corridor's two sides.
    middle = place + 0.5 * width * outward
    if layout.clearance(middle[None]) < 0.45 * width:
        return
    wall = np.concatenate([place, place + width * outward])[None]
    closed = replace(layout, segments=[*layout.segments, wall])
    if _num_regions(closed) <= _num_regions(layout):
        layout.segments.append(wall)


def _num_regions(layout: Layout) -> int:
    return int(free_space(layout.world("corridors"), 0.5 * PASSAGE).regions().max())


def _leave_standing(layout: Layout, rng: np.random.Generator) -> None:
    """Put a disc at the side of a corridor where it leaves a passage."""
    beside = _beside_block(layout, rng)
    if beside is None:
        return
    place, outward = beside
    # Radius U(0.08, 0.2) m.
    radius = rng.uniform(0.08, 0.2)
    width = layout.ray(place + HAIR * outward, outward)
    x, y = place + radius * outward
    # It touches the block, and nothing else may be nearer.
    alone = layout.clearance(np.array([[x, y]])) >= radius - HAIR
    if alone and 2.0 * radius + PASSAGE <= width < np.inf:
        layout.discs.append((x, y, radius))


def _beside_block(layout: Layout, rng: np.random.Generator) -> tuple[FloatArray, FloatArray] | None:
    """Draw a place on the outline of a block; return it and the direction away from the block."""
    if not layout.polygons:
        return None
    # The block and its side are uniform; the place is at U(0.1, 0.9) of the side.
    outline = layout.polygons[rng.integers(len(layout.polygons))]
    side = rng.integers(len(outline))
    begin, end = outline[side], outline[(side + 1) % len(outline)]
    outward = np.array([end[1] - begin[1], begin[0] - end[0]]) / np.linalg.norm(end - begin)
    return begin + rng.uniform(0.1, 0.9) * (end - begin), outward


class _Border(NamedTuple):
    """Where two rooms touch: a piece of a wall."""

    rooms: tuple[int, int]
    upright: bool
    """Whether it runs along y."""
    place: float
    """Its x if it is upright, else its y [m]."""
    low: float
    high: float

    def wall(self, low: float, high: float) -> Area:
        if self.upright:
            return self.place, low, self.place, high
        return low, self.place, high, self.place

    def point(self, along: float) -> FloatArray:
        return np.array([self.place, along] if self.upright else [along, self.place])


class _Door(NamedTuple):
    border: _Border
    low: float
    high: float

    @property
    def width(self) -> float:
        return self.high - self.low

    @property
    def centre(self) -> FloatArray:
        return self.border.point(0.5 * (self.low + self.high))


@suite(frozen="3993ade670af5fd404fcdaeea26fa58e551f71cc38d00c9cb4120cf46ddab771")
def rooms(rng: np.random.Generator) -> World:
    """Draw a flat or an office: rooms with doors and furniture, some along a hall."""
    # Sides U(9, 11) m.
    width, height = rng.uniform(9.0, 11.0, 2)
    bounds = (0.0, 0.0, float(width), float(height))
    hall, areas = _plan(bounds, rng)
    borders = _borders(areas)
    doors = _choose_doors(borders, hall, rng)
    layout = Layout(bounds, [room_walls(*bounds)])
    layout.add_walls(_walls(borders, doors))
    for door in doors:
        # A door leaf stands open with probability 0.3.
        if rng.random() < 0.3:
            _add_leaf(layout, door, rng)
    for index, area in enumerate(areas):
        if index != hall:
            _furnish(layout, area, [d for d in doors if index in d.border.rooms], rng)
    return layout.world("rooms")


def _plan(bounds: Area, rng: np.random.Generator) -> tuple[int | None, list[Area]]:
    """Return which area is a hall, if any, and all areas.

    A room's longer side is at most U(3.8, 6) m; a wall stands at U(0.4, 0.6) of the longer side.
    """
    x_min, y_min, x_max, y_max = bounds
    parts = [bounds]
    halls: list[Area] = []
    # With probability 1/2 a hall of width U(1.1, 1.8) m runs through, its middle at U(0.35, 0.65)
    # of the building; along x or along y with equal probability.
    if rng.random() < 0.5:
        half = rng.uniform(1.1, 1.8) / 2.0
        place = rng.uniform(0.35, 0.65)
        if rng.random() < 0.5:
            low, high = (y_min + place * (y_max - y_min) + side for side in (-half, half))
            halls = [(x_min, low, x_max, high)]
            parts = [(x_min, y_min, x_max, low), (x_min, high, x_max, y_max)]
        else:
            low, high = (x_min + place * (x_max - x_min) + side for side in (-half, half))
            halls = [(low, y_min, high, y_max)]
            parts = [(x_min, y_min, low, y_max), (high, y_min, x_max, y_max)]
    areas = [a for part in parts for a in divide(part, rng, (3.8, 6.0), (0.0, 0.0), (0.4, 0.6))]
    return (0 if halls else None), [*halls, *areas]


def _borders(areas: list[Area]) -> list[_Border]:
    """Return where areas touch each other."""
    borders = []
    for (i, a), (j, b) in combinations(enumerate(areas), 2):
        for axis in (0, 1):
            low, high = max(a[1 - axis], b[1 - axis]), min(a[3 - axis], b[3 - axis])
            for place, other in ((a[axis + 2], b[axis]), (a[axis], b[axis + 2])):
                if abs(place - other) < 1e-9 and high - low > 1e-9:
                    borders.append(_Border((i, j), axis == 0, place, low, high))
    return borders


def _choose_doors(
    borders: list[_Border], hall: int | None, rng: np.random.Generator
) -> list[_Door]:
    """Open a door in enough borders that all rooms are connected, and in some more."""
    # In random order, those of the hall first.
    order = np.argsort(rng.random(len(borders)) - [hall in b.rooms for b in borders])
    group = {room: room for border in borders for room in border.rooms}
    doors = []
    for border in (borders[k] for k in order):
        # Width U(0.8, 1.2) m, as far as the wall is long enough; anywhere in it.
        width = min(rng.uniform(*DOOR), border.high - border.low - 2.0 * DOOR_MARGIN)
        low = border.low + DOOR_MARGIN
        low += rng.uniform(0.0, 1.0) * (border.high - DOOR_MARGIN - width - low)
        one, two = (group[room] for room in border.rooms)
        # A second way round with probability 0.25.
        wanted = one != two or rng.random() < 0.25
        if width >= DOOR[0] and wanted:
            doors.append(_Door(border, low, low + width))
            group = {room: one if g == two else g for room, g in group.items()}
    return doors


def _walls(borders: list[_Border], doors: list[_Door]) -> FloatArray:
    """Return the borders without the doors."""
    opened = {door.border: door for door in doors}
    walls = []
    for border in borders:
        door = opened.get(border)
        if door is None:
            walls.append(border.wall(border.low, border.high))
        else:
            walls.append(border.wall(border.low, door.low))
            walls.append(border.wall(door.high, border.high))
    return merge_walls(walls)


def _add_leaf(layout: Layout, door: _Door, rng: np.random.Generator) -> None:
    # Hinge at either end, opened to either side with equal probability, by U(80, 115) degrees.
    at_low, to_left = rng.random(2) < 0.5
    opened = np.deg2rad(rng.uniform(80.0, 115.0))
    hinge, other = door.border.point(door.low), door.border.point(door.high)
    if not at_low:
        hinge, other = other, hinge
    yaw = opened if to_left else -opened
    cos, sin = np.cos(yaw), np.sin(yaw)
    tip = hinge + (other - hinge) @ np.array([[cos, sin], [-sin, cos]])
    if layout.clearance(tip[None]) >= 0.3:
        layout.add_walls(np.concatenate([hinge, tip])[None], LEAF_THICKNESS)


def _furnish(layout: Layout, room: Area, doors: list[_Door], rng: np.random.Generator) -> None:
    """Put furniture against the walls and, in large rooms, into the middle."""
    size = (room[2] - room[0]) * (room[3] - room[1])
    # Pieces to try: uniform on 1 ... 3, and one more for each 6 m^2.
    for _ in range(int(rng.integers(1, 4)) + int(size / 6.0)):
        # Against a wall with probability 0.45, a plant or bin in a corner 0.2, a table 0.35.
        kind = rng.choice(3, p=(0.45, 0.2, 0.35))
        if kind == 0:
            box = _against_wall(room, rng)
            # The wall it stands against does not count.
            if _keeps_doors_free(box, doors):
                layout.add_box_if_clear(box, walls=False)
        elif kind == 1:
            _put_in_corner(layout, room, doors, rng)
        else:
            _put_table(layout, room, doors, rng)


def _against_wall(room: Area, rng: np.random.Generator) -> Box:
    """Draw a cupboard, bed or desk against one of the four walls."""
    # Length U(0.5, 1.8) m, depth U(0.3, 0.8) m; the wall and the place along it are uniform.
    length, depth = rng.uniform(0.5, 1.8), rng.uniform(0.3, 0.8)
    side = rng.integers(4)
    along, across = (0, 1) if side < 2 else (1, 0)
    length = min(length, 0.8 * (room[along + 2] - room[along]))
    depth = min(depth, room[across + 2] - room[across] - PASSAGE)
    centre = np.zeros(2)
    centre[along] = rng.uniform(room[along] + 0.5 * length, room[along + 2] - 0.5 * length)
    near = side % 2 == 0
    centre[across] = room[across] + 0.5 * depth if near else room[across + 2] - 0.5 * depth
    sides = (length, depth) if along == 0 else (depth, length)
    return float(centre[0]), float(centre[1]), *sides, 0.0


def _put_in_corner(
    layout: Layout, room: Area, doors: list[_Door], rng: np.random.Generator
) -> None:
    # Radius U(0.12, 0.25) m; the corner is uniform.
    radius = rng.uniform(0.12, 0.25)
    right, up = rng.integers(2, size=2)
    x = room[2] - radius if right else room[0] + radius
    y = room[3] - radius if up else room[1] + radius
    # It touches two walls, which do not count.
    gap = layout.clearance(np.array([[x, y]]), walls=False) - radius
    if gap >= PASSAGE and _keeps_doors_free((x, y, 2.0 * radius, 2.0 * radius, 0.0), doors):
        layout.discs.append((x, y, radius))


def _put_table(layout: Layout, room: Area, doors: list[_Door], rng: np.random.Generator) -> None:
    """Put a table anywhere in a room, with chairs around it."""
    # Centre uniform; length U(0.6, 1.4) m, width U(0.5, 0.9) m; yaw U(-0.3, 0.3) rad. Round with
    # probability 0.5, as large as it is wide.
    x, y = rng.uniform(room[:2], room[2:])
    length, width = rng.uniform(0.6, 1.4), rng.uniform(0.5, 0.9)
    yaw = rng.uniform(-0.3, 0.3)
    is_round = rng.random() < 0.5
    length = width if is_round else length
    if not _keeps_doors_free((x, y, length, width, yaw), doors):
        return
    table = (x, y, length, width, yaw)
    chairs = [
        (cx, cy, radius)
        for cx, cy, radius in _chairs(table, rng)
        if layout.clearance(np.array([[cx, cy]])) - radius >= PASSAGE
        and _keeps_doors_free((cx, cy, 2.0 * radius, 2.0 * radius, 0.0), doors)
    ]
    if is_round:
        placed = layout.add_disc_if_clear(x, y, 0.5 * width)
    else:
        placed = layout.add_box_if_clear(table)
    if placed:
        layout.discs += chairs


def _chairs(table: Box, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Draw chairs at the four sides of a table, each half under it: x, y, radius [m]."""
    x, y, length, width, yaw = table
    sides = np.array(
        [[0.5 * length, 0.0], [-0.5 * length, 0.0], [0.0, 0.5 * width], [0.0, -0.5 * width]]
    )
    places = turned(sides, (x, y), yaw)
    # A chair stands at each side with probability 1/2; radius U(0.15, 0.22) m.
    there = rng.random(4) < 0.5
    return [(*place, rng.uniform(0.15, 0.22)) for place in places[there].tolist()]


def _keeps_doors_free(box: Box, doors: list[_Door]) -> bool:
    x, y, length, width, yaw = box
    cos, sin = np.cos(yaw), np.sin(yaw)
    for door in doors:
        dx, dy = door.centre - (x, y)
        # The door's middle in the box's frame, then its distance to the box.
        across = max(abs(cos * dx + sin * dy) - 0.5 * length, 0.0)
        up = max(abs(cos * dy - sin * dx) - 0.5 * width, 0.0)
        if np.hypot(across, up) < 0.5 * door.width + BEFORE_DOOR:
            return False
    return True
