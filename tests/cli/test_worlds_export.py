# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds export``: the world that evaluation drives in, in every format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pm01_nav.cli.worlds import command
from pm01_nav.errors import InputError
from pm01_nav.geometry import points_in_polygon
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.files import read_world


def export(*arguments: str) -> str:
    done = CliRunner().invoke(command, ["export", *arguments], catch_exceptions=True)
    if isinstance(done.exception, InputError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


def test_is_the_held_out_world(tmp_path: Path) -> None:
    path = tmp_path / "w.yaml"
    assert export("static", "--seed", "3", "--format", "yaml", "-o", str(path)) == f"wrote {path}\n"
    world = read_world(path)
    fourth = world_pool(task_config("static"), "held_out", 4).worlds[3]
    assert world.discs.tolist() == fourth.discs.tolist()
    assert [p.tolist() for p in world.polygons] == [p.tolist() for p in fourth.polygons]


@pytest.mark.parametrize(
    ("format_", "names"),
    [
        ("yaml", ["w.yaml"]),
        ("map", ["w.pgm", "w.yaml"]),
        ("sdf", ["w.yaml"]),
        ("mjcf", ["w.yaml"]),
    ],
)
def test_formats(tmp_path: Path, format_: str, names: list[str]) -> None:
    export("empty", "--format", format_, "-o", str(tmp_path / "w.yaml"))
    assert sorted(path.name for path in tmp_path.iterdir()) == names


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["moon", "--format", "sdf", "-o", "w"], "suite = 'moon': unknown; allowed: .*static"),
        (["empty", "--format", "stl", "-o", "w"], "format = 'stl': unknown; allowed: yaml, map"),
        (
            ["empty", "--seed", "-1", "--format", "sdf", "-o", "w"],
            "seed = -1: must be 0 to 1048575",
        ),
        (["empty", "--format", "sdf", "-o", "no/w"], "no/w: its folder does not exist"),
        (
            ["empty", "--resolution", "0", "--format", "map", "-o", "w.yaml"],
            "resolution = 0.0: must be above 0",
        ),
        (["empty", "--format", "map", "-o", "w"], r"w: a map must be named \*\.yaml"),
    ],
)
def test_wrong_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        export(*arguments)
    assert not list(tmp_path.iterdir())


MAP = "image: m.pgm\nresolution: 0.5\norigin: [1, 2, 0.7]\nnegate: 0\noccupied_thresh: 0.65\n"


@pytest.fixture
def turned(tmp_path: Path) -> Path:
    """A turned map of 8 x 6 cells, two of them solid, one unknown."""
    pixels = bytearray([254] * 48)
    pixels[10] = pixels[11] = 0
    pixels[47] = 205
    (tmp_path / "m.pgm").write_bytes(b"P5 8 6 255\n" + bytes(pixels))
    path = tmp_path / "m.yaml"
    path.write_text(MAP + "free_thresh: 0.25\n")
    return path


@pytest.mark.parametrize("region", [(), ("--region", "0 2 3 5")])
def test_own_map_comes_back_from_yaml_as_it_was(turned: Path, region: tuple[str, ...]) -> None:
    copy = turned.with_name("copy.yaml")
    export(str(turned), *region, "--format", "yaml", "-o", str(copy))
    before, after = read_world(turned), read_world(copy)
    assert after.bounds == ((0.0, 2.0, 3.0, 5.0) if region else before.bounds)
    assert before.grid is not None
    assert after.grid is not None
    assert after.grid.occupied.tolist() == before.grid.occupied.tolist()
    assert (after.grid.origin, after.grid.yaw) == (before.grid.origin, before.grid.yaw)


def test_own_map_as_sdf_and_as_a_map_that_is_not_turned(turned: Path) -> None:
    export(str(turned), "--format", "sdf", "-o", str(turned.with_name("m.sdf")))
    # Wherever the SDF world has a wall, the map does.
    boxes = read_world(turned.with_name("m.sdf")).polygons
    export(
        str(turned),
        *("--format", "map", "--resolution", "0.1", "-o", str(turned.with_name("raster.yaml"))),
    )
    before, raster = read_world(turned).grid, read_world(turned.with_name("raster.yaml")).grid
    assert before is not None
    assert raster is not None
    assert raster.yaw == 0.0
    for x, y in np.random.default_rng(0).uniform([-3, 1], [5, 8], (300, 2)).tolist():
        boxed = any(points_in_polygon(np.array([[x, y]]), box)[0] for box in boxes)
        assert before.is_solid(x, y) or not boxed
        assert raster.is_solid(x, y) or not before.is_solid(x, y)


def test_the_file_itself_is_not_written_over(turned: Path) -> None:
    before = turned.read_bytes()
    with pytest.raises(InputError, match=r"output = .*m\.yaml: is the file that is read"):
        export(str(turned), "--format", "map", "-o", str(turned))
    assert turned.read_bytes() == before
