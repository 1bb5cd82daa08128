# SPDX-License-Identifier: Apache-2.0
"""Corridors and rooms follow their laws."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.suites import indoor
from pm01_nav.worlds.suites.indoor import corridors, rooms
from pm01_nav.worlds.suites.layout import turned

COUNT = 40


def test_buildings_are_about_ten_metres_wide() -> None:
    for generator in (corridors, rooms):
        bounds = np.array([generator(np.random.default_rng(k)).bounds for k in range(COUNT)])
        assert (bounds[:, :2] == 0.0).all()
        assert ((bounds[:, 2:] >= 9.0) & (bounds[:, 2:] <= 11.0)).all()


def test_corridors_are_as_wide_as_they_say() -> None:
    widths = []
    for seed in range(COUNT):
        world = corridors(np.random.default_rng(seed))
        boxes = [(*p.min(axis=0), *p.max(axis=0)) for p in world.polygons]
        for a, b in combinations(boxes, 2):
            for axis in (0, 1):
                facing = min(a[3 - axis], b[3 - axis]) - max(a[1 - axis], b[1 - axis])
                gap = max(a[axis], b[axis]) - min(a[axis + 2], b[axis + 2])
                if facing > 0.0:
                    widths.append(gap)
    # U(0.8, 1.6) m between neighbours, more across a third one.
    assert min(widths) >= 0.8 - 1e-9
    assert np.mean([0.8 <= width <= 1.6 for width in widths]) > 0.4


def test_closed_corridors_cut_nothing_off() -> None:
    for seed in range(COUNT):
        world = corridors(np.random.default_rng(seed))
        regions = free_space(world, 0.3).regions()
        sizes = np.bincount(regions.ravel())[1:]
        # Pockets behind things left standing are small.
        assert sizes.max() >= 0.9 * sizes.sum()


def test_things_left_standing_touch_a_block_or_stand_in_an_open_place(distance) -> None:
    for seed in range(COUNT):
        world = corridors(np.random.default_rng(seed))
        blocks = replace(world, discs=np.zeros((0, 3)))
        gaps = distance(blocks, world.discs[:, :2]) - world.discs[:, 2]
        # Pillars of an open place keep 0.65 m to all sides. A wall that closes a corridor may end
        # at a block where later something is put.
        assert ((np.abs(gaps) < 1e-5) | (gaps >= 0.65 - 1e-9)).all()
        assert ((world.discs[:, 2] >= 0.08) & (world.discs[:, 2] <= 0.3)).all()


def plans(count: int):
    """Yield the areas, the hall and the doors of buildings."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        hall, areas = indoor._plan((0.0, 0.0, 10.0, 10.0), rng)
        borders = indoor._borders(areas)
        yield hall, areas, borders, indoor._choose_doors(borders, hall, rng)


def test_rooms_cover_the_building() -> None:
    halls = 0
    for hall, areas, borders, _ in plans(100):
        sides = np.array(areas)[:, 2:] - np.array(areas)[:, :2]
        assert sides.prod(axis=1).sum() == pytest.approx(100.0)
        halls += hall is not None
        # Twice the borders and the outer walls make up all circumferences.
        inner = sum(border.high - border.low for border in borders)
        assert 2.0 * inner + 40.0 == pytest.approx(2.0 * sides.sum())
    # Binomial with 1/2: 50 +- 5.
    assert abs(halls - 50) < 4 * 5


def test_doors_connect_all_rooms() -> None:
    connected = 0
    for _, areas, _, doors in plans(100):
        pairs = np.array([door.border.rooms for door in doors]).reshape(-1, 2)
        graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(areas), len(areas)))
        connected += connected_components(graph, directed=False)[0] == 1
        for door in doors:
            assert 0.8 - 1e-9 <= door.width <= 1.2 + 1e-9
            assert door.low >= door.border.low + 0.1 - 1e-9
            assert door.high <= door.border.high - 0.1 + 1e-9
    # Only where two rooms touch along less than a door is there none.
    assert connected >= 95


def test_rooms_have_doors_of_their_width() -> None:
    """Independent of the plan: what is missing in the inner walls' lines."""
    for seed in range(COUNT):
        world = rooms(np.random.default_rng(seed))
        for axis in (0, 1):
            straight = world.segments[world.segments[:, axis] == world.segments[:, axis + 2]]
            for place in np.unique(straight[:, axis]):
                ends = np.sort(
                    straight[straight[:, axis] == place][:, [1 - axis, 3 - axis]], axis=1
                )
                ends = ends[ends[:, 0].argsort()]
                gaps = ends[1:, 0] - ends[:-1, 1]
                assert (gaps >= 0.8 - 1e-9).all()


def test_most_of_the_floor_can_be_reached() -> None:
    shares = []
    for seed in range(COUNT):
        space = free_space(rooms(np.random.default_rng(seed)), 0.27)
        sizes = np.bincount(space.regions().ravel())[1:]
        shares.append(sizes.max() / sizes.sum())
    assert np.mean(shares) > 0.97


def test_furniture_leaves_the_doors_free() -> None:
    rng = np.random.default_rng(0)
    doors = [door for *_, doors in plans(COUNT) for door in doors]
    verdicts = []
    for door in doors:
        length, width = rng.uniform(0.3, 1.5, 2)
        yaw = rng.uniform(-np.pi, np.pi)
        centre = door.centre + rng.uniform(-2.0, 2.0, 2)
        grid = np.stack(np.meshgrid(*(np.linspace(-s / 2, s / 2, 60) for s in (length, width))), -1)
        points = turned(grid.reshape(-1, 2), tuple(centre), yaw)
        nearest = np.linalg.norm(points - door.centre, axis=1).min()
        allowed = 0.5 * door.width + 0.6
        # The points are up to 1.5 / 59 m apart.
        if abs(nearest - allowed) > 0.02:
            free = indoor._keeps_doors_free((*centre, length, width, yaw), [door])
            assert free == (nearest > allowed)
            verdicts.append(free)
    assert 0.2 < np.mean(verdicts) < 0.8
    assert len(verdicts) > 100


def _least_side(corners: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).min())


def test_furniture_is_varied() -> None:
    worlds = [rooms(np.random.default_rng(seed)) for seed in range(COUNT)]
    # Walls are 0.1 m thick and door leaves less, furniture is not.
    thin = 0.1 + 1e-6
    boxes = [sum(_least_side(p) > thin for p in world.polygons) for world in worlds]
    discs = [len(world.discs) for world in worlds]
    assert np.mean(boxes) > 3
    assert np.mean(discs) > 2
    assert max(boxes) <= 14
    assert ((np.concatenate([w.discs for w in worlds])[:, 2]) <= 0.45).all()
