# SPDX-License-Identifier: Apache-2.0
"""Discs that are thrown back: by hand, against the slow twin, and for a long time."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.geometry import rectangle
from pm01_nav.sim.bounce import bounce, first_hit
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference_movers import reference_first_hit, reference_gap

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
DIAGONAL = np.sqrt(0.5)
WALL = World("wall", BOUNDS, segments=np.array([[2.0, -4.0, 2.0, 4.0]]))
DISC = World("disc", BOUNDS, discs=np.array([[0.0, 0.0, 0.5]]))
CELLS = World("cells", BOUNDS, grid=OccupancyGrid(np.ones((20, 5), np.uint8), 0.1, (2.0, -1.0)))


def flight(world: World, place, heading: float, length: float, radius: float):
    """Return x, y and the direction of a disc after ``length`` [m]."""
    arrays = build_pool([world], 0.01).arrays
    return bounce(*place, np.cos(heading), np.sin(heading), length, radius, arrays, 0)


@pytest.mark.parametrize("world", [WALL, CELLS], ids=["wall", "cells"])
def test_head_on(world: World) -> None:
    # The surfaces meet when the centre is at 1.7, after 0.7 m; the other 0.3 m lead back.
    assert flight(world, (1.0, 0.03), 0.0, 1.0, 0.3) == pytest.approx((1.4, 0.03, -1.0, 0.0))


@pytest.mark.parametrize("world", [WALL, CELLS], ids=["wall", "cells"])
def test_at_45_degrees_off_a_wall(world: World) -> None:
    # x reaches 1.7 after 0.7 sqrt(2) m and is mirrored there; y goes on.
    length = 1.2
    x, y = 1.7 - (length * DIAGONAL - 0.7), -0.5 + length * DIAGONAL
    expected = (x, y, -DIAGONAL, DIAGONAL)
    assert flight(world, (1.0, -0.5), np.pi / 4, length, 0.3) == pytest.approx(expected)


def test_off_a_disc() -> None:
    # Both radii are 0.5 m. A disc that comes along y = sqrt(1/2) touches at x = -sqrt(1/2), where
    # the normal points up and back at 45 degrees: it leaves straight up.
    expected = (-DIAGONAL, DIAGONAL + 1.0, 0.0, 1.0)
    assert flight(DISC, (-2.0, DIAGONAL), 0.0, 3.0 - DIAGONAL, 0.5) == pytest.approx(expected)


def test_off_the_end_of_a_wall() -> None:
    # The wall's upper end is at (2, 4): the same figure as the disc's, with a point for a disc.
    half = 0.3 * DIAGONAL
    expected = (2.0 - half, 4.0 + half + 0.1, 0.0, 1.0)
    assert flight(WALL, (1.0, 4.0 + half), 0.0, 1.1 - half, 0.3) == pytest.approx(expected)


def test_off_the_bounds_in_a_corner() -> None:
    # 0.3 m to each bound, met at once: straight back.
    expected = (4.3, 4.3, -DIAGONAL, -DIAGONAL)
    place = (4.3, 4.3)
    found = flight(World("open", BOUNDS), place, np.pi / 4, 0.6 / DIAGONAL, 0.4)
    assert found == pytest.approx(expected)


def test_out_of_an_obstacle_it_flies_on() -> None:
    # It overlaps the wall by 0.1 m: on its way out nothing stops it, on its way in the wall does.
    assert flight(WALL, (1.8, 0.0), np.pi, 1.0, 0.3) == pytest.approx((0.8, 0.0, -1.0, 0.0))
    assert flight(WALL, (1.8, 0.0), 0.0, 1.0, 0.3) == pytest.approx((0.8, 0.0, -1.0, 0.0))


def random_world(rng: np.random.Generator) -> World:
    """Draw discs, a box, a wall and a grid."""
    cells = (rng.random((12, 15)) < 0.1).astype(np.uint8)
    return World(
        "random",
        BOUNDS,
        discs=np.column_stack([rng.uniform(-4, 4, (5, 2)), rng.uniform(0.1, 0.6, 5)]),
        polygons=(rectangle(*rng.uniform(-4, 4, 2), 1.0, 0.5, rng.uniform(-3, 3)),),
        segments=rng.uniform(-5, 5, (1, 4)),
        grid=OccupancyGrid(
            cells,
            0.2,
            (float(rng.uniform(-4, 1)), float(rng.uniform(-4, 1))),
            float(rng.choice([0.0, rng.uniform(-np.pi, np.pi)])),
        ),
    )


def test_first_hit_equals_the_slow_twin() -> None:
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(60):
        world, radius = random_world(rng), float(rng.uniform(0.1, 0.4))
        arrays = build_pool([world], 0.01).arrays
        place = rng.uniform(-4.5, 4.5, 2)
        while reference_gap(world, place, radius) <= 0.01:
            place = rng.uniform(-4.5, 4.5, 2)
        heading = rng.uniform(-np.pi, np.pi)
        direction = np.array([np.cos(heading), np.sin(heading)])
        distance, nx, ny = first_hit(*place, *direction, 1.5, radius, arrays, 0)
        expected, normal = reference_first_hit(world, place, direction, 1.5, radius)
        assert distance == pytest.approx(expected, abs=1e-9)
        # The twin's normal is a difference over 2e-6 m.
        assert (nx, ny) == pytest.approx(tuple(normal), abs=1e-4)
        hits += expected < 1.5
    assert 20 < hits < 60


def test_in_a_box_it_never_escapes() -> None:
    box = rectangle(0.0, 0.0, 4.0, 3.0)
    world = World("box", BOUNDS, discs=np.array([[0.5, 0.2, 0.4]]), polygons=(box,))
    arrays = build_pool([world], 0.01).arrays
    rng = np.random.default_rng(4)
    for _ in range(10):
        x, y, heading = -1.2, -0.4, rng.uniform(-np.pi, np.pi)
        ux, uy = np.cos(heading), np.sin(heading)
        for _ in range(2000):
            x, y, ux, uy = bounce(x, y, ux, uy, 0.13, 0.25, arrays, 0)
            # Rounding moves a disc into a wall by 1e-16 m at a time.
            assert reference_gap(world, np.array([x, y]), 0.25) > -1e-9
            assert abs(x) < 1.75 + 1e-9
            assert abs(y) < 1.25 + 1e-9
        assert np.hypot(ux, uy) == pytest.approx(1.0, abs=1e-9)
