# SPDX-License-Identifier: Apache-2.0
"""Angles, frames and polygons."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.geometry import (
    is_convex_counter_clockwise,
    points_in_polygon,
    polygon_edges,
    rectangle,
    to_frame,
    wrap_angle,
)

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
PI = np.pi


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, 0.0), (PI, -PI), (-PI, -PI), (3 * PI, -PI), (1.5 * PI, -PI / 2), (-7.0, 2 * PI - 7.0)],
)
def test_wrap_angle(angle: float, expected: float) -> None:
    # 1e-12: some turns of 2 pi, each rounded to 1e-15.
    assert wrap_angle(angle) == pytest.approx(expected, abs=1e-12)


def test_wrapped_angles_mean_the_same_direction() -> None:
    angles = np.random.default_rng(0).uniform(-50, 50, 1000)
    wrapped = wrap_angle(angles)
    assert ((wrapped >= -PI) & (wrapped < PI)).all()
    assert np.cos(wrapped) == pytest.approx(np.cos(angles), abs=1e-12)
    assert np.sin(wrapped) == pytest.approx(np.sin(angles), abs=1e-12)


def test_wrapped_angle_is_below_pi_however_it_is_rounded() -> None:
    assert wrap_angle(np.nextafter(-PI, -4.0)) < PI


def test_to_frame() -> None:
    # A robot at (1, 2) that looks along +y: a point 3 m further up lies ahead, one to the east on
    # its right.
    pose = np.array([1.0, 2.0, PI / 2])
    points = np.array([[1.0, 5.0], [2.0, 2.0], [1.0, 2.0]])
    expected = np.array([[3.0, 0.0], [0.0, -1.0], [0.0, 0.0]])
    assert to_frame(points, pose) == pytest.approx(expected, abs=1e-12)


def test_to_frame_broadcasts_over_poses() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, PI]])
    expected = np.array([[1.0, 1.0], [-1.0, -1.0]])
    assert to_frame(np.array([1.0, 1.0]), poses) == pytest.approx(expected, abs=1e-12)


def test_rectangle_is_counter_clockwise_and_turned() -> None:
    assert rectangle(1.0, 2.0, 4.0, 2.0).tolist() == [[-1, 1], [3, 1], [3, 3], [-1, 3]]
    turned = rectangle(0.0, 0.0, 4.0, 2.0, PI / 2)
    assert turned == pytest.approx(np.array([[1, -2], [1, 2], [-1, 2], [-1, -2]]), abs=1e-12)


def test_polygon_edges_close_the_outline() -> None:
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert polygon_edges(triangle).tolist() == [[0, 0, 1, 0], [1, 0, 0, 1], [0, 1, 0, 0]]


@pytest.mark.parametrize(
    ("vertices", "expected"),
    [
        (SQUARE, True),
        (SQUARE[::-1], False),  # Clockwise.
        (SQUARE + 2.0, False),  # The origin is outside.
        (SQUARE + 1.0, False),  # The origin is a corner.
        (SQUARE[:2], False),
        (np.zeros((0, 2)), False),
        (np.zeros(4), False),
        (np.zeros((4, 2)), False),
        # A dent at the top.
        (np.array([[-1, -1], [1, -1], [1, 1], [0, 0.5], [-1, 1]]), False),
        # Three corners in one line.
        (np.array([[-1, -1], [0, -1], [1, -1], [1, 1], [-1, 1]]), False),
        # A five-pointed star drawn in one stroke turns left at each point, twice around.
        (np.array([[np.cos(a), np.sin(a)] for a in 4 * PI / 5 * np.arange(5)]), False),
        (np.array([[np.cos(a), np.sin(a)] for a in 2 * PI / 5 * np.arange(5)]), True),
    ],
)
def test_is_convex_counter_clockwise(vertices, expected: bool) -> None:
    assert is_convex_counter_clockwise(np.asarray(vertices, dtype=float)) is expected


def test_points_in_polygon() -> None:
    # A "U": 3 x 2 with a slot of 1 x 1 from the top.
    outline = np.array([[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    points = np.array([[0.5, 1.5], [1.5, 1.5], [1.5, 0.5], [2.5, 1.5], [3.5, 1.0], [-0.1, 1.0]])
    expected = [True, False, True, True, False, False]
    assert points_in_polygon(points, outline).tolist() == expected
    assert points_in_polygon(points, outline[::-1]).tolist() == expected
