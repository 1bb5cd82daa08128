# SPDX-License-Identifier: Apache-2.0
"""A sheet of worlds: obstacles, sampled starts and goals, the shortest paths, and what moves."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pm01_nav.config import check_output, write_atomically
from pm01_nav.errors import InputError
from pm01_nav.rendering.canvas import (
    GOAL,
    INK,
    PAGE,
    ROBOT,
    SUPERSAMPLING,
    WHITE,
    Color,
    draw_world,
)
from pm01_nav.rendering.scene import CAPTION_HEIGHT, MARGIN, View, fit, layout_unit, shown_area
from pm01_nav.worlds.free_space import shortest_path
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

PANEL_WIDTH = 300
"""Of one world's picture [px]; its height follows from the first world's shape."""
COLUMNS = 4
EPISODES = 2
"""Start, goal and shortest path drawn in each world."""
COLORS = 128
"""A sheet has few colours; so its file stays small."""
MOVER: Color = (22, 140, 156)
MOVER_WAY: Color = (150, 206, 213)
LEAST_DISTANCE = 2.0
"""Between the start and the goal of a sample, where there are such [m]."""
SPEED_SECONDS = 1.5
"""An arrow is as long as the way a mover makes in this time [s]."""
MAX_DRAWS = 100


def draw_sheet(pool: WorldPool, seed: int = 0) -> Image.Image:
    """Draw the worlds of a pool side by side, each with its name; ``seed`` chooses the episodes."""
    width, height = _panel_size(pool.worlds[0])
    columns = min(COLUMNS, len(pool))
    rows = -(-len(pool) // columns)
    sheet = Image.new("RGB", (columns * width, rows * height), PAGE)
    for index, world in enumerate(pool.worlds):
        episodes = sample_episodes(pool, index, np.random.default_rng([seed, index]))
        panel = _draw_panel(world, (width, height), episodes)
        sheet.paste(panel, (index % columns * width, index // columns * height))
    return sheet.quantize(COLORS, dither=Image.Dither.NONE)


def save_sheet(sheet: Image.Image, path: str | Path) -> None:
    """Write a sheet as a PNG.

    Raises:
        InputError: the path has another suffix, or cannot be written to.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise InputError(f"output = {path}: unknown suffix; allowed: .png")
    check_output(path)
    content = io.BytesIO()
    sheet.save(content, format="PNG", optimize=True)
    write_atomically(path, content.getvalue())


def sample_episodes(
    pool: WorldPool, index: int, rng: np.random.Generator, count: int = EPISODES
) -> list[FloatArray]:
    """Draw starts and goals of one world; return the shortest path of each, shape (n, 2) [m].

    Start and goal are ``LEAST_DISTANCE`` apart, or as far as many draws brought them.
    """
    arrays, space = pool.arrays, pool.free_space(index)
    starts = arrays.starts[arrays.start_begin[index] : arrays.start_begin[index + 1]]
    goals = arrays.goals[arrays.goal_begin[index] : arrays.goal_begin[index + 1]]
    paths = []
    for _ in range(count):
        start = starts[rng.integers(len(starts), size=MAX_DRAWS)]
        goal = goals[rng.integers(len(goals), size=MAX_DRAWS)]
        distance = np.hypot(*(goal - start).T).clip(None, LEAST_DISTANCE)
        first = int(distance.argmax())
        paths.append(shortest_path(space, tuple(start[first]), tuple(goal[first])))
    return paths


def _panel_size(world: World) -> tuple[int, int]:
    """Return width and height of a panel [px] that a world like this fills."""
    x_min, y_min, x_max, y_max = shown_area(world)
    # The layout's unit depends on the longer side, which is the height unless a world is wide.
    height = PANEL_WIDTH
    for _ in range(4):
        unit = layout_unit((PANEL_WIDTH, height))
        scale = (PANEL_WIDTH - 2 * MARGIN * unit) / (x_max - x_min)
        height = round((y_max - y_min) * scale + (2 * MARGIN + CAPTION_HEIGHT) * unit)
    return PANEL_WIDTH, height


def _draw_panel(world: World, size: tuple[int, int], paths: list[FloatArray]) -> Image.Image:
    """Draw one world with its movers, and paths from a dot to a ring."""
    view = fit(shown_area(world), size)
    picture = draw_world(world, view, size)
    pen = Pen(picture, view.magnified(SUPERSAMPLING))
    draw_movers(pen, world)
    draw_episodes(pen, paths)
    panel = picture.reduce(SUPERSAMPLING)
    lengths = ", ".join(f"{np.linalg.norm(np.diff(p, axis=0), axis=1).sum():.1f}" for p in paths)
    font = ImageFont.load_default(11)
    text = f"{world.name} \u00b7 {lengths} m"
    ImageDraw.Draw(panel).text((size[0] / 2, size[1] - 10), text, INK, font, "mm")
    return panel


def draw_movers(pen: Pen, world: World) -> None:
    """Draw what moves, each with its way."""
    for mover in world.movers:
        _draw_way(pen, mover)
    for mover in world.movers:
        _draw_mover(pen, mover)


def draw_episodes(pen: Pen, paths: list[FloatArray]) -> None:
    """Draw paths (n, 2) [m], each from a dot to a ring."""
    for path in paths:
        pen.line(path, ROBOT, 2)
    for path in paths:
        pen.disc(path[-1], 5, GOAL)
        pen.disc(path[-1], 2.5, WHITE)
        pen.disc(path[0], 4, ROBOT)


class Pen:
    """Draws on a picture in world coordinates; widths and radii are in pixels of the sheet."""

    def __init__(self, picture: Image.Image, view: View) -> None:
        """Draw on ``picture``, in which ``view`` says where the world lies."""
        self.draw = ImageDraw.Draw(picture)
        self.view = view

    def line(self, points: FloatArray, color: Color, width: float) -> None:
        """Draw a line through points (n, 2)."""
        pixels = self.view.pixels(points).ravel().tolist()
        self.draw.line(pixels, color, round(width * SUPERSAMPLING), joint="curve")

    def disc(self, centre: FloatArray, radius: float, color: Color) -> None:
        """Fill a disc around a point (2,)."""
        x, y = self.view.pixels(centre)
        reach = radius * SUPERSAMPLING
        self.draw.ellipse((x - reach, y - reach, x + reach, y + reach), color)

    def polygon(self, points: FloatArray, color: Color) -> None:
        """Fill a polygon with corners (n, 2)."""
        self.draw.polygon(self.view.pixels(points).ravel().tolist(), color)


def _draw_way(pen: Pen, mover: Mover) -> None:
    """Draw the way round the points of a mover, which closes unless there are times."""
    points = mover.points
    if len(points) > 1:
        closed = points if mover.motion == "spline" else np.concatenate([points, points[:1]])
        pen.line(closed, MOVER_WAY, 1)


def _draw_mover(pen: Pen, mover: Mover) -> None:
    """Draw a mover where it begins, and an arrow to where it is heading first."""
    begin = mover.points[0]
    pen.disc(begin, mover.radius * pen.view.scale / SUPERSAMPLING, MOVER)
    heading = first_direction(mover)
    if heading is None:
        return
    tip = begin + (mover.radius + SPEED_SECONDS * mover.speed) * heading
    side = np.array([-heading[1], heading[0]])
    back = tip - 0.25 * heading
    pen.line(np.array([begin, back]), MOVER, 1.5)
    pen.polygon(np.array([tip, back + 0.13 * side, back - 0.13 * side]), MOVER)


def first_direction(mover: Mover) -> FloatArray | None:
    """Return the unit vector along which a mover sets out, None if nothing says so."""
    if mover.motion == "bounce":
        return np.array([np.cos(mover.heading), np.sin(mover.heading)])
    if len(mover.points) < 2:
        return None
    ahead = mover.points[1] - mover.points[0]
    length = np.hypot(*ahead)
    return ahead / length if length > 0.0 else None
