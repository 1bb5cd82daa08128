# SPDX-License-Identifier: Apache-2.0
"""Distances, rays, joined walls and divided areas, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.suites.layout import (
    Layout,
    box_points,
    divide,
    merge_walls,
    points_along,
    room_walls,
    thick_chain,
    turned,
    walkable,
)

BOUNDS = (0.0, 0.0, 6.0, 4.0)


def layout(**parts) -> Layout:
    return Layout(BOUNDS, **parts)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (1.0, 2.0, 1.0),  # To the left wall.
        (3.0, 3.25, 0.25),  # To the disc around (3, 2), whose edge is at y = 3.
        (3.0, 2.0, 0.0),  # Inside the disc.
        (5.25, 1.0, 0.25),  # From the box's right side at x = 5 to the right.
        (4.75, 1.0, 0.0),  # Inside the box of 0.5 m around (4.75, 1).
    ],
)
def test_clearance(x: float, y: float, expected: float) -> None:
    room = layout(segments=[room_walls(*BOUNDS)], discs=[(3.0, 2.0, 1.0)])
    room.add_box((4.75, 1.0, 0.5, 0.5, 0.0))
    assert room.clearance(np.array([[x, y]])) == pytest.approx(expected, abs=1e-9)
    both = np.array([[x, y], [2.0, 2.0]])
    assert room.clearance(both) == pytest.approx(min(expected, 0.0), abs=1e-9)


def test_clearance_of_an_empty_place_has_no_end() -> None:
    assert layout().clearance(np.array([[1.0, 1.0]])) == math.inf


def test_walls_can_be_left_out() -> None:
    room = layout(segments=[room_walls(*BOUNDS)], discs=[(3.0, 2.0, 1.0)])
    # 0.5 m from the left wall, 2.5 - 1 m from the disc.
    assert room.clearance(np.array([[0.5, 2.0]]), walls=False) == pytest.approx(1.5)


def test_things_are_put_only_where_there_is_room() -> None:
    room = layout(segments=[room_walls(*BOUNDS)])
    assert room.add_disc_if_clear(3.0, 2.0, 0.5)
    # 3 - 2 - 0.5 - 0.3 = 0.2 m between the two.
    assert not room.add_disc_if_clear(2.0, 2.0, 0.3, gap=0.21)
    assert room.add_disc_if_clear(2.0, 2.0, 0.3, gap=0.19)
    # The box's right side is 0.3 m from the right wall.
    assert not room.add_box_if_clear((5.2, 2.0, 1.0, 1.0, 0.0), gap=0.31)
    assert room.add_box_if_clear((5.2, 2.0, 1.0, 1.0, 0.0), gap=0.31, walls=False)
    assert len(room.discs) == 2
    assert len(room.polygons) == 1


@pytest.mark.parametrize(
    ("origin", "yaw", "expected"),
    [
        ((1.0, 1.0), 0.0, 5.0),  # To the right wall.
        ((1.0, 1.0), math.pi / 4, 3.0 * math.sqrt(2.0)),  # To the top wall, which is 3 m higher.
        ((1.0, 2.0), 0.0, 2.0),  # To the box's left side at x = 3.
    ],
)
def test_ray(origin: tuple[float, float], yaw: float, expected: float) -> None:
    room = layout(segments=[room_walls(*BOUNDS)], polygons=[rectangle(3.5, 2.0, 1.0, 1.0)])
    direction = np.array([math.cos(yaw), math.sin(yaw)])
    assert room.ray(np.array(origin), direction) == pytest.approx(expected)


def test_ray_that_meets_nothing() -> None:
    room = layout(segments=[np.array([[1.0, 0.0, 1.0, 1.0]])])
    for direction in ([-1.0, 0.0], [0.0, 1.0]):
        assert room.ray(np.array([0.0, 0.5]), np.array(direction)) == math.inf


def test_bounds_enclose_their_edge() -> None:
    assert layout().encloses(np.array([[0.0, 0.0], [6.0, 4.0]]))
    assert not layout().encloses(np.array([[1.0, 1.0], [6.1, 1.0]]))


def test_walls_end_to_end_are_joined() -> None:
    walls = [
        (0.0, 0.0, 1.0, 0.0),
        (2.0, 0.0, 3.0, 0.0),
        (1.0, 0.0, 2.0, 0.0),
        (4.0, 0.0, 5.0, 0.0),
        (1.0, 0.0, 1.0, 2.0),
        (1.0, 2.0, 1.0, 3.0),
        (2.0, 2.0, 2.0, 3.0),
    ]
    expected = {
        (0.0, 0.0, 3.0, 0.0),
        (4.0, 0.0, 5.0, 0.0),
        (1.0, 0.0, 1.0, 3.0),
        (2.0, 2.0, 2.0, 3.0),
    }
    merged = merge_walls(walls)
    assert set(map(tuple, merged.tolist())) == expected
    assert len(merged) == len(expected)
    assert merge_walls([]).shape == (0, 4)


def test_divided_area_is_covered_but_for_the_gaps() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        parts = np.array(divide((0.0, 0.0, 10.0, 8.0), rng, (3.0, 5.0), (0.0, 0.0), (0.4, 0.6)))
        sides = parts[:, 2:] - parts[:, :2]
        assert sides.prod(axis=1).sum() == pytest.approx(80.0)
        assert (sides.max(axis=1) <= 5.0).all()
        # A side longer than 3 m was cut at 0.4 at the least.
        assert (sides.min(axis=1) >= 0.4 * 3.0).all()


def test_box_points_cover_the_box() -> None:
    points = box_points((1.0, 2.0, 0.9, 0.3, math.pi / 2))
    # Turned by a quarter, the length runs along y.
    assert points.min(axis=0) == pytest.approx([0.85, 1.55])
    assert points.max(axis=0) == pytest.approx([1.15, 2.45])
    rng = np.random.default_rng(0)
    inside = rng.uniform([0.85, 1.55], [1.15, 2.45], (200, 2))
    nearest = np.linalg.norm(inside[:, None] - points, axis=2).min(axis=1)
    # Half the diagonal of a square of 0.2 m.
    assert nearest.max() <= 0.1 * math.sqrt(2.0)


def test_points_along_segments() -> None:
    points = points_along(np.array([[0.0, 0.0, 0.3, 0.4], [1.0, 1.0, 1.0, 1.1]]))
    assert points[0].tolist() == [0.0, 0.0]
    # 0.5 m need three steps, 0.1 m one.
    assert len(points) == 4 + 2
    assert np.linalg.norm(points[3] - points[0]) == pytest.approx(0.5)
    assert np.linalg.norm(np.diff(points[:4], axis=0), axis=1) == pytest.approx([0.5 / 3] * 3)


def test_turned_by_a_quarter() -> None:
    (point,) = turned(np.array([[1.0, 0.0]]), (2.0, 3.0), math.pi / 2)
    assert point == pytest.approx([2.0, 4.0])


def test_walkable_is_the_largest_region() -> None:
    # A wall at x = 2 parts the room of 6 m x 4 m; the right part is larger.
    room = layout(segments=[room_walls(*BOUNDS), np.array([[2.0, 0.0, 2.0, 4.0]])])
    space = walkable(room, 0.3)
    rows, columns = np.nonzero(space.free)
    places = space.centre(rows, columns)
    assert places.min(axis=0) == pytest.approx([2.35, 0.35])
    assert places.max(axis=0) == pytest.approx([5.65, 3.65])


def test_thick_chain_is_mitred_at_a_bend() -> None:
    """A wall 0.2 m thick, 1 m along x and then 1 m along y: corners worked out by hand."""
    outline = thick_chain(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), 0.2)
    expected = [(0.0, 0.1), (0.9, 0.1), (0.9, 1.0), (1.1, 1.0), (1.1, -0.1), (0.0, -0.1)]
    np.testing.assert_allclose(outline, expected, atol=1e-12)


def test_walls_have_their_thickness_and_end_at_the_bounds() -> None:
    layout = Layout((0.0, 0.0, 4.0, 4.0))
    layout.add_walls(np.array([[0.0, 2.0, 3.0, 2.0]]), 0.2, beyond=0.1)
    expected = [(0.0, 1.9), (3.1, 1.9), (3.1, 2.1), (0.0, 2.1)]
    np.testing.assert_allclose(layout.walls[0], expected, atol=1e-12)
    # From (1, 1) to its lower side.
    assert layout.clearance(np.array([[1.0, 1.0]])) == pytest.approx(0.9)
    assert layout.clearance(np.array([[1.0, 1.0]]), walls=False) == np.inf
