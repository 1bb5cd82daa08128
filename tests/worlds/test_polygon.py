# SPDX-License-Identifier: Apache-2.0
"""Simple polygons, against exact arithmetic on all pairs of edges."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.polygon import has_area, is_simple

Corner = tuple[Fraction, Fraction]


def side(a: Corner, b: Corner, c: Corner) -> int:
    cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (cross > 0) - (cross < 0)


def on(a: Corner, b: Corner, c: Corner) -> bool:
    """Tell whether c lies on the segment from a to b."""
    box = all(min(a[k], b[k]) <= c[k] <= max(a[k], b[k]) for k in range(2))
    return side(a, b, c) == 0 and box


def meet(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    crosses = side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
    return crosses or on(a, b, c) or on(a, b, d) or on(c, d, a) or on(c, d, b)


def simple_exactly(corners: list[tuple[int, int]]) -> bool:
    """Say the same as ``is_simple``, with fractions and without sorting."""
    ring = [(Fraction(x), Fraction(y)) for x, y in corners]
    n = len(ring)
    edges = [(ring[k], ring[(k + 1) % n]) for k in range(n)]
    for i in range(n):
        for j in range(i + 1, n):
            (a, b), (c, d) = edges[i], edges[j]
            if j == i + 1 or (i == 0 and j == n - 1):
                one, shared, other = (a, b, d) if j == i + 1 else (c, a, b)
                # Neighbours share a corner; more than that means that one lies on the other.
                if one == shared or other == shared or on(one, shared, other):
                    return False
                if on(shared, other, one):
                    return False
            elif meet(a, b, c, d):
                return False
    return True


grid_points = st.tuples(st.integers(0, 5), st.integers(0, 5))


@settings(max_examples=500, deadline=None)
@given(corners=st.lists(grid_points, min_size=3, max_size=9))
@example(corners=[(0, 0), (4, 0), (4, 4), (0, 4)])
@example(corners=[(0, 0), (4, 4), (4, 0), (0, 4)])  # Crosses in the middle.
@example(corners=[(0, 0), (4, 0), (2, 0), (2, 3)])  # Runs back on itself.
@example(corners=[(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)])  # A corner on another edge.
@example(corners=[(0, 0), (2, 0), (4, 0), (4, 4)])  # Straight on at a corner is allowed.
@example(corners=[(0, 0), (0, 0), (4, 4), (0, 4)])  # A corner twice.
@example(corners=[(0, 0), (4, 4), (2, 2)])  # No area.
def test_is_simple_like_exact_arithmetic(corners: list[tuple[int, int]]) -> None:
    assert is_simple(np.array(corners, dtype=np.float64)) == simple_exactly(corners)


@settings(max_examples=200, deadline=None)
@given(yaw=st.floats(-4, 4), shift=st.floats(-1e4, 1e4), corners=st.integers(3, 200))
def test_star_is_simple_and_its_second_turn_is_not(yaw: float, shift: float, corners: int) -> None:
    angle = yaw + 2.0 * np.pi * np.arange(corners) / corners
    radius = np.where(np.arange(corners) % 2, 0.5, 1.0)
    star = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]) + shift
    assert is_simple(star)
    # Twice around cuts itself, or repeats its corners.
    assert not is_simple(np.concatenate([star, star]))


def test_five_pointed_star_crosses_itself() -> None:
    # Every second corner of a pentagon: it turns left everywhere, and twice around.
    angle = 4.0 * np.pi * np.arange(5) / 5
    assert not is_simple(np.column_stack([np.cos(angle), np.sin(angle)]))


def test_area() -> None:
    assert has_area(rectangle(0, 0, 1e-3, 1e-3, 0.3))
    # A sliver of 1 m by 1 nm: 1e-9 of the square of its extent.
    assert has_area(np.array([[0, 0], [1, 0], [1, 1e-9], [0, 1e-9]]))
    assert not has_area(np.array([[0.0, 0.0], [0.1, 0.3], [0.2, 0.6]]))
    assert not has_area(np.zeros((3, 2)))


def test_comb_of_ten_thousand_corners() -> None:
    # Up and down along x, two corners at each x, closed by one far below.
    x = np.repeat(np.arange(4999.0), 2)
    y = np.where(np.arange(len(x)) % 4 % 3 == 0, 0.0, 1.0)
    comb = np.concatenate([np.column_stack([x, y])[:-1], [[2499.0, -5000.0]]])
    assert is_simple(comb)
    # One tooth so long that it crosses the closing edges.
    comb[101, 1] = -6000.0
    assert not is_simple(comb)
