# SPDX-License-Identifier: Apache-2.0
"""Sheets of worlds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pm01_nav.errors import InputError
from pm01_nav.rendering.canvas import GOAL, OBSTACLE, ROBOT
from pm01_nav.rendering.scene import fit
from pm01_nav.rendering.sheet import (
    MOVER,
    PANEL_WIDTH,
    _panel_size,
    draw_sheet,
    first_direction,
    sample_episodes,
    save_sheet,
)
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.world import World

BOUNDS = (0.0, 0.0, 10.0, 10.0)
WALL = np.array([[5.0, 0.0, 5.0, 8.0]])
WORLD = World(
    "room",
    BOUNDS,
    discs=np.array([[2.0, 8.0, 0.8]]),
    segments=WALL,
    movers=(Mover("loop", 0.5, np.array([[8.0, 6.0], [8.0, 9.0]]), speed=0.5),),
    start=(2.0, 2.0, 0.0),
    goal_area=(8.0, 2.0, 8.0, 2.0),
)


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return build_pool([WORLD] * 5, 0.27)


def color(sheet: Image.Image, column: int, row: int, x: float, y: float) -> np.ndarray:
    """Return the colour at a point [m] of a world in the sheet."""
    width, height = _panel_size(WORLD)
    corner = np.array([column * width, row * height])
    at = fit(BOUNDS, (width, height)).pixels([x, y]) + corner
    return np.array(sheet.convert("RGB").getpixel((int(at[0]), int(at[1]))))


@pytest.mark.parametrize(("column", "row"), [(0, 0), (3, 0), (0, 1)])
def test_sheet_shows_what_stands_moves_and_where_to_go(pool, column: int, row: int) -> None:
    sheet = draw_sheet(pool)
    for x, y, expected in (
        (2.0, 8.0, OBSTACLE),
        (7.7, 6.0, MOVER),
        (2.0, 2.0, ROBOT),
        # On the goal's ring, which is 5 px wide and at 28 px/m reaches 0.17 m.
        (8.13, 2.0, GOAL),
    ):
        # A palette may shift a colour a little.
        assert np.abs(color(sheet, column, row, x, y) - expected).max() < 24


def test_sheet_has_four_worlds_in_a_row_and_few_colours(pool) -> None:
    width, height = _panel_size(WORLD)
    sheet = draw_sheet(pool)
    assert width == PANEL_WIDTH
    assert sheet.size == (4 * width, 2 * height)
    assert sheet.mode == "P"
    assert draw_sheet(build_pool([WORLD], 0.27)).size == (width, height)


def test_seed_chooses_the_episodes() -> None:
    free = build_pool([World("free", BOUNDS, segments=WALL)], 0.27)
    one, again, other = (
        sample_episodes(free, 0, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    assert [p.tolist() for p in one] == [p.tolist() for p in again]
    assert [p.tolist() for p in one] != [p.tolist() for p in other]
    for path in one:
        assert np.linalg.norm(path[-1] - path[0]) >= 2.0


def test_near_goals_are_drawn_where_there_are_no_others() -> None:
    area = (1.0, 1.0, 2.0, 2.0)
    near = build_pool([World("near", BOUNDS, start_area=area, goal_area=area)], 0.27)
    for path in sample_episodes(near, 0, np.random.default_rng(0)):
        # The farthest of 100 pairs in a square of 1 m; its diagonal is 1.41 m.
        assert 0.8 < np.linalg.norm(path[-1] - path[0]) <= 1.42


@pytest.mark.parametrize(
    ("mover", "expected"),
    [
        (Mover("bounce", 0.2, np.array([[1.0, 1.0]]), speed=1.0, heading=np.pi / 2), (0.0, 1.0)),
        (Mover("loop", 0.2, np.array([[1.0, 1.0], [4.0, 5.0]]), speed=1.0), (0.6, 0.8)),
        (Mover("pedestrian", 0.2, np.array([[1.0, 1.0]]), speed=1.0), None),
        (Mover("loop", 0.2, np.array([[1.0, 1.0], [1.0, 1.0]]), speed=1.0), None),
    ],
)
def test_first_direction(mover: Mover, expected) -> None:
    direction = first_direction(mover)
    if expected is None:
        assert direction is None
    else:
        assert direction == pytest.approx(np.array(expected), abs=1e-12)


def test_sheet_is_written_as_png(pool, tmp_path: Path) -> None:
    save_sheet(draw_sheet(pool), tmp_path / "sheet.PNG")
    with Image.open(tmp_path / "sheet.PNG") as picture:
        assert picture.format == "PNG"
    assert [file.name for file in tmp_path.iterdir()] == ["sheet.PNG"]


@pytest.mark.parametrize(
    ("name", "message"),
    [("sheet.jpg", "unknown suffix; allowed: .png"), ("none/sheet.png", "its folder does not")],
)
def test_wrong_output_is_refused(pool, tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        save_sheet(draw_sheet(pool), tmp_path / name)
    assert list(tmp_path.iterdir()) == []
