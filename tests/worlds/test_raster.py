# SPDX-License-Identifier: Apache-2.0
"""Rasterised worlds: hand-made cells, and a twin that looks at every cell by itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pm01_nav.errors import InputError
from pm01_nav.geometry import points_in_polygon, polygon_edges
from pm01_nav.worlds.raster import rasterise
from pm01_nav.worlds.world import OccupancyGrid, World

BOUNDS = (0.0, 0.0, 2.0, 1.0)


def drawn(grid: OccupancyGrid) -> list[str]:
    """The cells as text, the highest row first."""
    return ["".join(".#"[cell] for cell in row) for row in grid.occupied[::-1]]


def test_lines_lie_half_a_cell_beside_the_bounds() -> None:
    grid = rasterise(World("w", BOUNDS), 0.5)
    assert grid.origin == (-0.25, -0.25)
    # 2.25 m / 0.5 m = 4.5 and 1.25 / 0.5 = 2.5 cells, rounded up.
    assert drawn(grid) == [".....", ".....", "....."]


def test_wall_on_the_bounds_takes_one_row() -> None:
    walls = np.array([[0.0, 0.0, 2.0, 0.0], [2.0, 0.0, 2.0, 1.0]])
    assert drawn(rasterise(World("w", BOUNDS, segments=walls), 0.5)) == ["....#", "....#", "#####"]


def test_slanted_segment() -> None:
    # From (0, 0) to (2, 1), cells from -0.25 on: in cells from (0.5, 0.5) to (4.5, 2.5), so y = 1
    # is crossed at x = 1.5 and y = 2 at x = 3.5.
    wall = np.array([[0.0, 0.0, 2.0, 1.0]])
    assert drawn(rasterise(World("w", BOUNDS, segments=wall), 0.5)) == ["...##", ".###.", "##..."]


def test_disc() -> None:
    # Centre (2.5, 1.5) and radius 1.2 in cells: columns 1 to 3 and half of the corner cells, whose
    # nearest points are hypot(0.5, 0.5) = 0.71 away; (0, 1) is 1.5 away, (2, -1) 1.5.
    disc = np.array([[1.0, 0.5, 0.6]])
    assert drawn(rasterise(World("w", BOUNDS, discs=disc), 0.5)) == [".###.", ".###.", ".###."]


def test_polygon_is_filled() -> None:
    # A frame of cells around the bounds' middle would stay hollow if only edges were drawn.
    square = np.array([[-1.0, -1.0], [3.0, -1.0], [3.0, 2.0], [-1.0, 2.0]])
    grid = rasterise(World("w", BOUNDS, polygons=(square,)), 0.5)
    assert grid.occupied.all()


def test_obstacles_beyond_the_bounds_are_covered() -> None:
    grid = rasterise(World("w", BOUNDS, discs=np.array([[4.0, 0.5, 0.5]])), 0.5)
    # Up to 4.5 m: (4.5 + 0.25) / 0.5 = 9.5 cells.
    assert grid.occupied.shape == (3, 10)
    assert grid.occupied[1, 9]


def test_grid_of_the_same_resolution_is_copied() -> None:
    cells = np.zeros((4, 6), dtype=np.uint8)
    cells[1, 2] = cells[3, 5] = 1
    own = OccupancyGrid(cells, 0.1, (0.3, -0.7))
    bounds = (0.3, -0.7, 0.9, -0.3)
    copy = rasterise(World("w", bounds, grid=own), 0.1)
    assert copy.origin == pytest.approx(own.origin, abs=1e-12)
    assert copy.occupied.tolist() == cells.tolist()


def test_coarser_cells_hold_the_solid_ones() -> None:
    cells = np.zeros((4, 4), dtype=np.uint8)
    cells[0, 0] = cells[2, 3] = 1
    world = World("w", (0.0, 0.0, 2.0, 2.0), grid=OccupancyGrid(cells, 0.5, (0.0, 0.0)))
    # Cells of 1 m from -0.5 on. (0, 0) reaches from 0 to 0.5: column and row 0. (2, 3) reaches
    # from x = 1.5 to 2 and y = 1 to 1.5: column 2, row 1.
    assert drawn(rasterise(world, 1.0)) == ["...", "..#", "#.."]


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("resolution", [0.2, 0.31])
def test_turned_grid(resolution: float, closed: bool) -> None:
    rng = np.random.default_rng(0)
    cells = (rng.random((9, 12)) < 0.2).astype(np.uint8)
    own = OccupancyGrid(cells, 0.25, (-1.0, 0.5), 0.6, closed)
    grid = rasterise(World("w", (-3.0, 0.0, 3.0, 4.0), grid=own), resolution)
    assert (grid.yaw, grid.closed) == (0.0, closed)
    # A cell is solid if any of 15 x 15 points within it lies in a solid cell of the grid, and free
    # if none does of those a hair outside of it: points lie 14 mm or 22 mm apart, so that only
    # overlaps of that size can be missed.
    missed = 0
    for row, column in np.ndindex(grid.occupied.shape):
        low = np.array(grid.origin) + resolution * np.array([column, row])
        steps = resolution * np.linspace(1e-4, 1.0 - 1e-4, 15)
        points = low + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        touched = any(own.is_solid(x, y) for x, y in points.tolist())
        if touched:
            assert grid.occupied[row, column] == 1
        else:
            missed += int(grid.occupied[row, column])
    assert missed <= 0.03 * grid.occupied.size


@pytest.mark.parametrize("resolution", [0.0, -0.1, float("nan"), float("inf")])
def test_resolution_must_be_positive(resolution: float) -> None:
    with pytest.raises(InputError, match=r"resolution = .*: must be above 0"):
        rasterise(World("w", BOUNDS), resolution)


def test_too_many_cells() -> None:
    with pytest.raises(InputError, match=r"resolution = 1e-05: gives 2e\+10 cells; at most"):
        rasterise(World("w", BOUNDS), 1e-5)


def clipped(segment: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Tell whether a segment meets a box, by clipping it at each side (Liang and Barsky)."""
    first, last = 0.0, 1.0
    start, step = segment[:2], segment[2:] - segment[:2]
    for k in range(2):
        if step[k] == 0.0:
            if not low[k] <= start[k] <= high[k]:
                return False
            continue
        ends = sorted([(low[k] - start[k]) / step[k], (high[k] - start[k]) / step[k]])
        first, last = max(first, ends[0]), min(last, ends[1])
    return first <= last


def touched(world: World, low: np.ndarray, high: np.ndarray) -> bool:
    """Tell whether any obstacle meets a box: the twin of ``rasterise`` for one cell."""
    for x, y, radius in world.discs:
        nearest = np.clip((x, y), low, high)
        if np.hypot(*(nearest - (x, y))) <= radius:
            return True
    edges = [world.segments, *(polygon_edges(polygon) for polygon in world.polygons)]
    if any(clipped(edge, low, high) for edge in np.concatenate(edges)):
        return True
    middle = ((low + high) / 2.0)[None]
    return any(points_in_polygon(middle, polygon)[0] for polygon in world.polygons)


@settings(max_examples=12, deadline=None)
@given(data=st.data(), resolution=st.sampled_from([0.31, 0.5, 1.0]))
def test_like_the_twin(
    any_world: st.SearchStrategy[World], data: st.DataObject, resolution: float
) -> None:
    world = data.draw(any_world)
    grid = rasterise(world, resolution)
    # Whatever meets a cell a little smaller must fill it, whatever misses one a little larger
    # must not; in between rounding decides.
    little = 1e-4 * resolution
    for row, column in np.ndindex(grid.occupied.shape):
        low = np.array(grid.origin) + resolution * np.array([column, row])
        if grid.occupied[row, column]:
            assert touched(world, low - little, low + resolution + little)
        else:
            assert not touched(world, low + little, low + resolution - little)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), resolution=st.floats(0.05, 0.7))
def test_every_point_of_an_obstacle_is_in_a_solid_cell(
    any_world: st.SearchStrategy[World], data: st.DataObject, resolution: float
) -> None:
    world = data.draw(any_world)
    grid = rasterise(world, resolution)
    angle, part = np.linspace(0.0, 7.0, 50), np.linspace(0.0, 1.0, 51)[:, None]
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    points = [disc[:2] + disc[2] * share * circle for disc in world.discs for share in (0.5, 1.0)]
    points += [edge[:2] + part * (edge[2:] - edge[:2]) for edge in world.all_segments]
    for polygon in world.polygons:
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        mesh = np.stack(np.meshgrid(*np.linspace(low, high, 12).T), axis=-1).reshape(-1, 2)
        points.append(mesh[points_in_polygon(mesh, polygon)])
    for x, y in np.concatenate([np.zeros((0, 2)), *points]):
        column = int(np.floor((x - grid.origin[0]) / resolution))
        row = int(np.floor((y - grid.origin[1]) / resolution))
        assert grid.occupied[row, column] == 1
