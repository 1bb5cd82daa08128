# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds``."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner
from PIL import Image

from pm01_nav.cli.worlds import command
from pm01_nav.errors import InputError
from pm01_nav.task.tasks import TASKS, task_config
from pm01_nav.worlds.suites import SUITES


def show(*arguments: str) -> None:
    CliRunner().invoke(command, ["show", *arguments], catch_exceptions=False)


def test_show_draws_a_sheet(tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.png"
    show("u_traps", "--seed", "5", "--count", "3", "-o", str(sheet))
    with Image.open(sheet) as picture:
        assert picture.width == 3 * 300


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["moon", "-o", "x.png"], "suite = 'moon': unknown; allowed: empty, .*mixed"),
        (["map", "-o", "x.png"], "suite = 'map': unknown"),
        (["empty", "-o", "x.gif"], "output = x.gif: unknown suffix; allowed: .png"),
    ],
)
def test_wrong_input_is_refused(arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        show(*arguments)


def test_every_suite_has_a_task_and_help_names_it() -> None:
    from pm01_nav.cli.train import command as train

    text = CliRunner().invoke(train, ["--help"]).output
    group = CliRunner().invoke(command, ["--help"]).output
    for name in SUITES:
        assert task_config(name).suite == name
        assert name in text
        assert name in group
    assert set(SUITES) < set(TASKS)
