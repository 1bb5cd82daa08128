# SPDX-License-Identifier: Apache-2.0
"""Pedestrians and carts follow their laws and keep clear of what stands."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.suites.moving import CrowdParams, crowd, warehouse

COUNT = 60


def along(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points 0.02 m apart or less on the closed way through ``points``."""
    pieces = []
    for begin, end in zip(points, np.roll(points, -1, axis=0), strict=True):
        steps = 2 + int(np.linalg.norm(end - begin) / 0.02)
        pieces.append(begin + np.linspace(0.0, 1.0, steps)[:, None] * (end - begin))
    return np.concatenate(pieces)


def movers(generator, motion: str) -> list[Mover]:
    worlds = [generator(np.random.default_rng(seed)) for seed in range(COUNT)]
    return [m for world in worlds for m in world.movers if m.motion == motion]


def test_crowd_has_about_ten_pedestrians() -> None:
    counts = [len(crowd(np.random.default_rng(seed)).movers) for seed in range(COUNT)]
    assert set(counts) == {8, 9, 10, 11, 12}


@pytest.mark.parametrize("count", [0, 1, 5, 20])
def test_crowd_of_any_size(count: int) -> None:
    for seed in range(5):
        world = crowd(np.random.default_rng(seed), CrowdParams(pedestrians=count))
        assert len(world.movers) == count
        assert world.name == "crowd"


def test_pedestrians_follow_their_law() -> None:
    walkers = movers(crowd, "pedestrian")
    assert len(walkers) > 500
    radii, speeds = (np.array([getattr(m, key) for m in walkers]) for key in ("radius", "speed"))
    assert ((radii >= 0.2) & (radii <= 0.3)).all()
    assert ((speeds >= 0.4) & (speeds <= 1.2)).all()
    # U(0.4, 1.2) has mean 0.8 and deviation 0.8 / sqrt(12) = 0.231.
    assert speeds.mean() == pytest.approx(0.8, abs=4 * 0.231 / np.sqrt(len(walkers)))
    # Half wander; of the others a few found no second place.
    wandering = np.mean([len(m.points) == 1 for m in walkers])
    assert 0.5 - 4 * 0.5 / np.sqrt(len(walkers)) < wandering < 0.65
    assert {len(m.points) for m in walkers} == {1, 2, 3, 4}


def test_pedestrians_can_walk_straight_to_their_places(distance) -> None:
    for seed in range(20):
        world = crowd(np.random.default_rng(seed))
        for walker in world.movers:
            steps = np.linalg.norm(np.diff(walker.points, axis=0), axis=1)
            assert (steps >= 3.0 - 1e-9).all()
            # Cells 0.4 m from everything; a line between two of them cuts a corner by at most the
            # half diagonal of a cell, 0.071 m.
            assert distance(world, along(walker.points)).min() >= 0.4 - 0.071 - 1e-9


def test_crowd_is_lightly_furnished() -> None:
    worlds = [crowd(np.random.default_rng(seed)) for seed in range(COUNT)]
    assert {len(world.polygons) for world in worlds} <= set(range(4))
    assert {len(world.discs) for world in worlds} <= set(range(6))
    assert np.mean([len(world.discs) for world in worlds]) > 1


def test_carts_follow_their_law() -> None:
    carts = movers(warehouse, "loop")
    assert len(carts) > 2 * COUNT
    for cart in carts:
        assert 0.22 <= cart.radius <= 0.32
        assert 0.3 <= cart.speed <= 0.7
        assert len(cart.points) in (2, 4)
    assert 0.2 < np.mean([len(cart.points) == 2 for cart in carts]) < 0.8


def test_carts_hit_nothing_on_their_way(distance) -> None:
    for seed in range(20):
        world = warehouse(np.random.default_rng(seed))
        ways = [(along(m.points), m.radius) for m in world.movers if m.motion == "loop"]
        for k, (way, radius) in enumerate(ways):
            # 0.1 m at points 0.2 m apart, so between them a corner may be 0.015 m nearer.
            assert distance(world, way).min() >= radius + 0.1 - 0.016
            assert ((way >= radius) & (way <= 10.0 - radius)).all()
            for other, other_radius in ways[:k]:
                between = np.hypot(*(way[::5, None] - other[::5]).T).min()
                assert between >= radius + other_radius


def test_warehouse_follows_its_law() -> None:
    workers, shelves = [], []
    for seed in range(COUNT):
        world = warehouse(np.random.default_rng(seed))
        workers.append(sum(m.motion == "pedestrian" for m in world.movers))
        shelves.append(len(world.polygons))
        assert len(world.movers) - workers[-1] <= 4
        assert len(world.discs) == 0
    assert set(workers) == {0, 1, 2}
    assert min(shelves) >= 2
    assert max(shelves) <= 15 + 3
