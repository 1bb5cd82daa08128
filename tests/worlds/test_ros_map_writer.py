# SPDX-License-Identifier: Apache-2.0
"""Worlds as maps of the ROS map server, read back; and one as large as a building."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from pm01_nav.errors import InputError
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.raster import rasterise
from pm01_nav.worlds.ros_map import read_ros_map
from pm01_nav.worlds.ros_map_writer import write_grid, write_ros_map
from pm01_nav.worlds.world import OccupancyGrid, World


def test_pixels_and_keys(tmp_path: Path) -> None:
    cells = np.array([[1, 0, 0], [0, 0, 1]], dtype=np.uint8)
    image = write_grid(OccupancyGrid(cells, 0.5, (-1.0, 2.25)), tmp_path / "lab.yaml")
    assert image == tmp_path / "lab.pgm"
    # The highest row comes first in an image; 0 is black, 254 what the map saver calls free.
    assert image.read_bytes() == b"P5\n3 2\n255\n" + bytes([254, 254, 0, 0, 254, 254])
    assert np.asarray(Image.open(image)).tolist() == [[254, 254, 0], [0, 254, 254]]
    assert (tmp_path / "lab.yaml").read_text().splitlines() == [
        *("image: lab.pgm", "mode: trinary", "resolution: 0.5"),
        *("origin:", "- -1.0", "- 2.25", "- 0.0"),
        *("negate: 0", "occupied_thresh: 0.65", "free_thresh: 0.25"),
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lab.pgm", "lab.yaml"]


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), resolution=st.floats(0.02, 0.5))
def test_what_is_read_is_what_was_rasterised(
    any_world: st.SearchStrategy[World], tmp_path: Path, data: st.DataObject, resolution: float
) -> None:
    world = data.draw(any_world)
    expected = rasterise(world, resolution)
    write_ros_map(world, tmp_path / "w.yaml", resolution)
    grid = read_ros_map(tmp_path / "w.yaml").grid
    assert grid is not None
    assert grid.occupied.tolist() == expected.occupied.tolist()
    # Not nearly: the numbers are written so that the same ones are read.
    assert (grid.origin, grid.resolution) == (expected.origin, expected.resolution)


def test_map_without_a_free_cell(tmp_path: Path) -> None:
    world = World("w", (0.0, 0.0, 1.0, 1.0), discs=np.array([[0.5, 0.5, 3.0]]))
    with pytest.raises(InputError, match=r"w\.yaml: resolution = 3.0: leaves no cell free"):
        write_ros_map(world, tmp_path / "w.yaml", 3.0)
    assert not list(tmp_path.iterdir())


def test_map_must_be_named_yaml(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"w\.pgm: a map must be named \*\.yaml"):
        write_ros_map(World("w", (0.0, 0.0, 1.0, 1.0)), tmp_path / "w.pgm")


@pytest.mark.slow
def test_map_of_a_building_makes_a_pool(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    # 100 m x 100 m, 5 cm: 2001 x 2001 cells; 400 discs U(0, 100)^2 m, radius U(0.2, 1.5) m.
    discs = np.column_stack([rng.uniform(0, 100, (400, 2)), rng.uniform(0.2, 1.5, 400)])
    world = World("building", (0.0, 0.0, 100.0, 100.0), discs=discs)
    write_ros_map(world, tmp_path / "building.yaml", 0.05)
    read = read_ros_map(tmp_path / "building.yaml")
    pool = build_pool([read], radius=0.27)
    assert read.grid is not None
    assert read.grid.occupied.size > 2000 * 2000
    starts = pool.arrays.starts
    # Starts are free of the discs themselves, too, by the radius.
    for x, y in rng.choice(starts, 1000):
        gaps = np.hypot(discs[:, 0] - x, discs[:, 1] - y) - discs[:, 2]
        assert gaps.min() >= 0.27 - 1e-9
