# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds export``: the world that evaluation drives in, in every format."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from pm01_nav.cli.worlds import command
from pm01_nav.errors import InputError
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
