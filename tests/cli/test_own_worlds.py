# SPDX-License-Identifier: Apache-2.0
"""Driving in Gazebo worlds from the command line, and what is said of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pm01_nav.cli import pm01
from pm01_nav.errors import InputError
from tests.worlds.sdf_text import model, sdf, solid

WALLS = "".join(
    model(solid(f"<box><size>{size} 1</size></box>"), f"{place} 0.5 0 0 0", name)
    for name, size, place in (
        ("north", "8 0.2", "0 4"),
        ("south", "8 0.2", "0 -4"),
        ("east", "0.2 8", "4 0"),
        ("west", "0.2 8", "-4 0"),
    )
)
ROBOT = model(solid(), "0 0 0.5 0 0 0", "bot").replace(
    "</model>", "<plugin name='d' filename='libgazebo_ros_diff_drive.so'/></model>"
)
INCLUDE = "<include><uri>model://crate</uri><pose>2 2 0.5 0 0 0</pose></include>"


def evaluate(world: Path, *options: str) -> Result:
    arguments = ["evaluate", "goal_seeking", "--task", "map", "--map", str(world)]
    return CliRunner().invoke(pm01, [*arguments, "--episodes", "5", "--json", "-", *options])


def test_what_was_read_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "room.model").write_text("made by hand\n" + sdf(WALLS, ROBOT, INCLUDE))
    error = evaluate(tmp_path / "room.model").exception
    assert isinstance(error, InputError)
    assert "'model://crate': no such model" in str(error)
    (tmp_path / "elsewhere" / "crate").mkdir(parents=True)
    (tmp_path / "elsewhere" / "crate" / "model.sdf").write_text(f"<sdf>{model(solid())}</sdf>")
    done = evaluate(tmp_path / "room.model", "--models", str(tmp_path / "elsewhere"))
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines() == [
        "room.model: read 5 of 5 shapes",
        "warning: robot, left out: 'bot' (plugin libgazebo_ros_diff_drive.so)",
    ]
    assert '"success_rate"' in done.stdout


def test_partial_takes_the_rest(tmp_path: Path) -> None:
    (tmp_path / "room.world").write_text(sdf(WALLS, INCLUDE * 9))
    with pytest.raises(InputError, match=r"\(9 times\): no such model .* \(--partial\)"):
        raise evaluate(tmp_path / "room.world").exception or AssertionError
    done = evaluate(tmp_path / "room.world", "--partial")
    assert done.exit_code == 0, done.output
    assert done.stderr.splitlines()[0] == "room.world: read 4 of 13 shapes"
