# SPDX-License-Identifier: Apache-2.0
"""BARN's grid files, on tiny grids of our own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds import barn
from pm01_nav.worlds.barn_grid import read_barn_grid
from pm01_nav.worlds.ros_map import read_ros_map

WALLS = 96 + 2 * 30
"""Cylinders of the walls: before the grid, and the first and last row of 30 columns."""


def grid(*solid: tuple[int | slice, int | slice]) -> np.ndarray:
    cells = np.zeros((30, 30), dtype=np.int64)
    cells[[0, -1]] = 1
    for row, column in solid:
        cells[row, column] = 1
    return cells


def write(folder: Path, cells: object, name: str = "grid_7.npy") -> Path:
    path = folder / name
    np.save(path, np.asarray(cells))
    return path


def blobs(world_discs: np.ndarray) -> list[list[float]]:
    """The cylinders between the side walls and beyond the walls before the grid."""
    x, y = world_discs[:, 0], world_discs[:, 1]
    inner = (x > -4.4) & (x < -0.1) & (y > 5.1)
    return sorted(world_discs[inner].round(9).tolist())


def test_cells_become_cylinders_within_walls(tmp_path: Path) -> None:
    world = read_barn_grid(write(tmp_path, grid((10, 4))))
    # x = -4.425 + 0.15 * 10 = -2.925, y = 5.175 + 0.15 * 4 = 5.775.
    assert blobs(world.discs) == [[-2.925, 5.775, 0.075]]
    assert len(world.discs) == WALLS + 1
    assert world.name == "barn_7"
    assert (world.bounds, world.start) == (barn.BOUNDS, barn.START)
    assert world.goal_area == (*barn.GOAL, *barn.GOAL)
    # The back wall, and side walls up to the grid's last column: 5.175 + 0.15 * 29.
    x, y = world.discs[:, 0], world.discs[:, 1]
    assert np.sort(x[np.isclose(y, 0.075)]) == pytest.approx(-4.425 + 0.15 * np.arange(30))
    for side in (-4.425, -0.075):
        along = np.sort(y[np.isclose(x, side)])
        assert along == pytest.approx(0.075 + 0.15 * np.arange(64))


def test_blobs_are_hollow(tmp_path: Path) -> None:
    block = (slice(10, 14), slice(5, 10))
    # 4 x 5 cells, of which the inner 2 x 3 have eight solid neighbours.
    assert len(read_barn_grid(write(tmp_path, grid(block))).discs) == WALLS + 4 * 5 - 2 * 3
    # At the end of the grid a cell has a neighbour that is not there, and stays.
    block = (slice(10, 13), slice(27, 30))
    assert len(read_barn_grid(write(tmp_path, grid(block))).discs) == WALLS + 3 * 3 - 1


@pytest.mark.parametrize("kind", ["uint8", "int32", "float64", "bool"])
def test_kinds_of_numbers(tmp_path: Path, kind: str) -> None:
    assert len(read_barn_grid(write(tmp_path, grid((5, 5)).astype(kind))).discs) == WALLS + 1


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (grid()[1:], r"must have 30 rows of 1 to 1000, not \(29, 30\)"),
        (grid()[:, :0], "must have 30 rows of 1 to 1000"),
        (grid()[0], "with rows and columns"),
        (grid() * 2, r"must hold 0 \(free\) and 1 \(solid\) only"),
        (grid() * np.nan, "must hold 0"),
        (np.zeros((30, 30)), "are walls and must be 1"),
        (np.full((30, 30), "1"), "must be one array of numbers"),
        (np.array([[{}]]), "must be a whole .npy array"),
    ],
)
def test_refused(tmp_path: Path, cells: np.ndarray, words: str) -> None:
    path = write(tmp_path, cells)
    with pytest.raises(InputError, match=words) as problem:
        read_barn_grid(path)
    assert str(path) in str(problem.value)


def test_other_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must be named grid_<i>\.npy"):
        read_barn_grid(write(tmp_path, grid(), "cspace_7.npy"))


def test_cut_short_or_missing(tmp_path: Path) -> None:
    path = write(tmp_path, grid())
    path.write_bytes(path.read_bytes()[:-1])
    for name in ("grid_7.npy", "grid_8.npy"):
        with pytest.raises(InputError, match=name):
            read_barn_grid(tmp_path / name)


def test_map_of_the_dataset(tmp_path: Path) -> None:
    # As the dataset writes it: two spaces in the header, both thresholds the same, no mode.
    pixels = np.full((66, 30), 255, dtype=np.uint8)
    pixels[65] = 0  # The back wall is the lowest row.
    (tmp_path / "map_pgm_7.pgm").write_bytes(b"P5\n30  66  255\n" + pixels.tobytes())
    (tmp_path / "yaml_7.yaml").write_text(
        "image: map_pgm_7.pgm\nresolution: 0.15\norigin: [-4.5, 0.0, 0]\n"
        "occupied_thresh: 0.50\nfree_thresh: 0.50\nnegate: 0"
    )
    world = read_ros_map(tmp_path / "yaml_7.yaml")
    assert world.bounds == pytest.approx((-4.5, 0.0, 0.0, 9.9))
    assert world.grid is not None
    assert world.grid.occupied[0].all()
    assert not world.grid.occupied[1:].any()
