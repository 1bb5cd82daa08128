# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from pm01_nav.cli.worlds import command
from pm01_nav.errors import InputError
from pm01_nav.task.tasks import TASKS, task_config
from pm01_nav.worlds.suites import suites


def show(*arguments: str) -> str:
    return CliRunner().invoke(command, ["show", *arguments], catch_exceptions=False).output


@pytest.fixture
def office(tmp_path: Path) -> Path:
    """A map of 10 m x 10 m: a room of 6 m x 6 m and a closet of 2 m x 2 m, unknown around them."""
    cells = np.full((100, 100), 205, dtype=np.uint8)
    cells[19:81, 19:81] = cells[19:41, 80:102] = 0
    cells[20:80, 20:80] = cells[20:40, 81:] = 254
    Image.fromarray(cells).save(tmp_path / "office.pgm")
    path = tmp_path / "office.yaml"
    path.write_text(
        "image: office.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    return path


def test_show_draws_a_file_and_says_where_the_robot_gets_to(office: Path) -> None:
    sheet = office.with_suffix(".png")
    said = show(str(office), "-o", str(sheet)).splitlines()
    # A disc of 0.17 m and a margin of 0.1 m: centres of cells of 0.1 m lie 0.05 m, 0.15 m, ...
    # from a wall, the first that fit 0.35 m: (60 - 6)^2 cells and in the closet, of which 19
    # columns are inside the image, (20 - 6) x (19 - 6), from (8.1 + 0.3, 6 + 0.3) m on.
    assert said == [
        "drives in x 0 to 10 m, y 0 to 10 m",
        "holds a map",
        "pm01 needs 0.27 m around its centre: starts and goals lie in 29.2 m²",
        'not connected: 1.8 m², pieces: 1; the largest, 1.8 m², lies within "8.4 6.3 9.7 7.7"',
        f"wrote {sheet}",
    ]
    with Image.open(sheet) as picture:
        # 8.0 m of free cells across and 6 m up, each and half a metre around it.
        assert picture.width == 1200
        assert picture.height < 1000


def test_show_a_region_of_a_file(office: Path) -> None:
    said = show(str(office), "--region", "8.4,6.3 9.7 7.7", "-o", str(office.with_suffix(".png")))
    assert "drives in x 8.4 to 9.7 m, y 6.3 to 7.7 m" in said
    assert "starts and goals lie in 1.8 m²" in said
    assert "not connected" not in said


def test_show_draws_a_sheet(tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.png"
    show("u_traps", "--seed", "5", "--count", "3", "-o", str(sheet))
    with Image.open(sheet) as picture:
        assert picture.width == 3 * 300


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["moon", "-o", "x.png"],
            "suite = 'moon': unknown; allowed: article, .*, or a world",
        ),
        (["moon.yaml", "-o", "x.png"], "moon.yaml: cannot be read"),
        (["empty", "--region", "0 0 1 1", "-o", "x.png"], "--region: is for a file"),
        (["moon.yaml", "--region", "0 0 1", "-o", "x.png"], "--region '0 0 1': must be four"),
        (["moon.yaml", "--region", "0 0 1 x", "-o", "x.png"], "--region '0 0 1 x': must be four"),
        (["moon.yaml", "--region", "0 0 1 nan", "-o", "x.png"], "region.3 = nan: .*finite"),
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
    for name in suites():
        assert task_config(name).suite == name
        assert name in text
        assert name in group
    assert set(suites()) < set(TASKS)
