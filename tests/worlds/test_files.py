# SPDX-License-Identifier: Apache-2.0
"""One entry to all kinds of world files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.files import WORLD_FORMATS, read_world, write_world
from pm01_nav.worlds.world import OccupancyGrid, World

WORLD = World("lab", (0.0, 0.0, 4.0, 3.0), discs=np.array([[1.0, 2.0, 0.3]]))


@pytest.mark.parametrize(
    ("format_", "name"),
    [("yaml", "a.yaml"), ("yaml", "a.yml"), ("sdf", "a.sdf"), ("sdf", "a.WORLD")],
)
def test_written_and_read(tmp_path: Path, format_: str, name: str) -> None:
    write_world(WORLD, tmp_path / name, format_)
    world = read_world(tmp_path / name)
    assert world.discs.tolist() == WORLD.discs.tolist()
    assert (world.name, world.bounds) == (WORLD.name, WORLD.bounds)


def test_yaml_with_an_image_is_a_map(tmp_path: Path) -> None:
    write_world(WORLD, tmp_path / "a.yaml", "map", resolution=0.5)
    world = read_world(tmp_path / "a.yaml")
    assert world.grid is not None
    assert world.grid.resolution == 0.5


def test_options_reach_the_sdf_reader(tmp_path: Path) -> None:
    write_world(WORLD, tmp_path / "a.sdf", "sdf")
    # All is 1 m high.
    assert len(read_world(tmp_path / "a.sdf", z_min=1.1, z_max=1.2).discs) == 0
    with pytest.raises(InputError, match="model folder"):
        read_world(tmp_path / "a.sdf", model_folders=["nowhere"])


@pytest.mark.parametrize("text", [b"", b"solid cube\n", b'{"a": 1}', b"\0\1\xff", b"a: 1\n"])
def test_unknown_kind_of_file(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "a.world").write_bytes(text)
    with pytest.raises(InputError, match=r"a\.world: unknown kind of world; allowed: a world or a"):
        read_world(tmp_path / "a.world")


@pytest.mark.parametrize("name", ["burger.model", "a.yaml", "a"])
def test_content_counts_and_not_the_name(tmp_path: Path, name: str) -> None:
    for format_ in ("sdf", "yaml"):
        write_world(WORLD, tmp_path / "w", format_)
        (tmp_path / "w").rename(tmp_path / name)
        assert read_world(tmp_path / name).discs.tolist() == WORLD.discs.tolist()
    np.save(tmp_path / "grid_1.npy", np.ones((30, 30), dtype=np.int64))
    assert read_world(tmp_path / "grid_1.npy").name == "barn_1"


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    for format_ in WORLD_FORMATS:
        with pytest.raises(InputError, match="its folder does not exist"):
            write_world(WORLD, tmp_path / "nowhere" / "a.yaml", format_)
        with pytest.raises(InputError, match="is a folder"):
            write_world(WORLD, tmp_path, format_)
    with pytest.raises(InputError, match="format = 'stl': unknown; allowed: yaml, map, sdf, mjcf"):
        write_world(WORLD, tmp_path / "a.stl", "stl")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        # Even a post that the raster of places does not see.
        ({"discs": np.array([[3.0, 1.0, 0.1], [1.0, 1.0, 0.05]])}, r"lies in discs\[1\]"),
        ({"polygons": (rectangle(1.0, 1.0, 0.2, 0.2),)}, r"lies in polygons\[0\]"),
        ({"grid": OccupancyGrid(np.eye(2, dtype=np.uint8), 0.8, (0.0, 0.0))}, "lies in a solid"),
    ],
)
def test_obstacle_on_the_start(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    world = World("lab", (0.0, 0.0, 4.0, 3.0), start=(1.0, 1.0, 0.0), **changes)
    write_world(world, tmp_path / "a.yaml", "yaml")
    with pytest.raises(InputError, match=words) as problem:
        read_world(tmp_path / "a.yaml")
    assert "a.yaml: start = (1.0, 1.0, 0.0)" in str(problem.value)


def test_free_start_in_a_map(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.eye(2, dtype=np.uint8), 0.8, (0.0, 0.0))
    world = World("lab", (0.0, 0.0, 4.0, 3.0), start=(1.0, 0.5, 0.0), grid=grid)
    write_world(world, tmp_path / "a.yaml", "yaml")
    assert read_world(tmp_path / "a.yaml").start == (1.0, 0.5, 0.0)
