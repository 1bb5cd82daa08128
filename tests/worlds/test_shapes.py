# SPDX-License-Identifier: Apache-2.0
"""Boxes and convex pieces that stand for polygons and grids."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds import shapes
from pm01_nav.worlds.shapes import as_box, convex_pieces, grid_boxes, is_convex
from pm01_nav.worlds.world import OccupancyGrid, World


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def test_rectangle_is_a_box() -> None:
    box = as_box(rectangle(1.0, 2.0, 3.0, 0.5, 0.4))
    assert box == pytest.approx((1.0, 2.0, 3.0, 0.5, 0.4))


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0], [1, 0], [1, 1]],
        [[0, 0], [2, 0], [3, 1], [1, 1]],  # A parallelogram.
        [[0, 0], [2, 0], [2, 1], [0, 1.001]],
        [[0, 0], [2, 0], [1, 0.5], [0, 1]],
    ],
)
def test_other_polygons_are_no_box(corners: list[list[float]]) -> None:
    assert as_box(np.array(corners, dtype=np.float64)) is None


@settings(max_examples=100, deadline=None)
@given(
    cells=arrays(
        np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 1)
    )
)
def test_boxes_cover_the_solid_cells_once(cells: np.ndarray) -> None:
    covered = np.zeros_like(cells)
    for box in grid_boxes(OccupancyGrid(cells, 0.5, (-1.0, 3.0))):
        left, bottom = (box.x - box.length / 2 + 1.0) / 0.5, (box.y - box.width / 2 - 3.0) / 0.5
        column, row = round(left), round(bottom)
        assert (left, bottom) == pytest.approx((column, row), abs=1e-9)
        covered[row : row + round(box.width / 0.5), column : column + round(box.length / 0.5)] += 1
    assert covered.tolist() == cells.tolist()


def test_boxes_of_a_turned_grid() -> None:
    # Two cells of 1 m beside each other, turned left by 90 degrees about (3, 1): the row runs
    # along y, from the origin to the left, so that x is 2 to 3 and y is 1 to 3.
    cells = np.array([[1, 1]], dtype=np.uint8)
    (box,) = grid_boxes(OccupancyGrid(cells, 1.0, (3.0, 1.0), np.pi / 2))
    assert (box.x, box.y, box.length, box.width) == pytest.approx((2.5, 2.0, 2.0, 1.0))
    assert box.yaw == np.pi / 2


def test_boxes_surround_what_is_free_in_a_closed_grid() -> None:
    # 50 m of nothing around one free cell: eight cells of 0.5 m are left of it.
    cells = np.ones((100, 100), dtype=np.uint8)
    cells[40, 60] = 0
    boxes = grid_boxes(OccupancyGrid(cells, 0.5, (0.0, 0.0), closed=True))
    assert sum(box.length * box.width for box in boxes) == pytest.approx(8 * 0.25)
    assert all(abs(box.x - 30.25) < 0.6 and abs(box.y - 20.25) < 0.6 for box in boxes)


def test_too_many_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "MAX_BOXES", 2)
    with pytest.raises(InputError, match="the grid would take 3 boxes; at most 2"):
        grid_boxes(OccupancyGrid(np.eye(3, dtype=np.uint8), 0.1, (0.0, 0.0)))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_pieces_are_convex_and_fill_the_polygon(
    any_world: st.SearchStrategy[World], data: st.DataObject
) -> None:
    for polygon in data.draw(any_world).polygons:
        pieces = convex_pieces(polygon)
        assert all(is_convex(piece) for piece in pieces)
        assert sum(abs(area(p)) for p in pieces) == pytest.approx(abs(area(polygon)))


@pytest.mark.parametrize("turns", [1, -1])
def test_pieces_of_a_spiral(turns: int) -> None:
    # A band that winds inwards, 40 corners: hardly any corner is an ear at first.
    angle = np.linspace(0.0, 4.0 * np.pi, 20)
    outer = np.column_stack([np.cos(angle), np.sin(angle)]) * (3.0 - angle[:, None] / 5.0)
    spiral = np.concatenate([outer, (outer * 0.9)[::-1]])[::turns]
    pieces = convex_pieces(spiral)
    assert len(pieces) == 38
    assert sum(abs(area(p)) for p in pieces) == pytest.approx(abs(area(spiral)))


def test_too_many_corners_to_cut() -> None:
    angle = 2.0 * np.pi * np.arange(302) / 302
    star = (
        np.column_stack([np.cos(angle), np.sin(angle)])
        * np.where(np.arange(302) % 2, 1, 2)[:, None]
    )
    with pytest.raises(
        InputError, match="a polygon of 302 corners that is not convex: at most 300"
    ):
        convex_pieces(star)
