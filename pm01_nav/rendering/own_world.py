# SPDX-License-Identifier: Apache-2.0
"""One world of a person's own, large: where episodes start and end in it, and where they cannot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pm01_nav.rendering.canvas import GOAL, INK, ROBOT, SUPERSAMPLING, Color, draw_world
from pm01_nav.rendering.scene import Size, View, fit, picture_size, shown_area
from pm01_nav.rendering.sheet import Pen, draw_episodes, draw_movers, sample_episodes
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.pool import WorldPool

LONGEST = 1200
"""Longer side of the picture [px]."""
EPISODES = 6
REACHED: Color = (222, 242, 226)
"""Where the robot's centre may be."""
LEFT_OUT: Color = (250, 218, 214)
"""Where it would fit, but does not get to from the starts."""
LEGEND = "green: starts and goals; red: free, but not connected to them; grey: not free"


def draw_own_world(pool: WorldPool, seed: int = 0) -> Image.Image:
    """Draw the first world of a pool, with a few episodes that ``seed`` chooses."""
    world, area = pool.worlds[0], shown_area(pool.worlds[0])
    size = picture_size(area, LONGEST)
    view = fit(area, size)
    picture = draw_world(world, view, size)
    space = pool.free_space(0)
    for cells, color in zip(split_free(pool), (REACHED, LEFT_OUT), strict=True):
        picture.paste(color, mask=_mask(space, cells, view.magnified(SUPERSAMPLING), picture.size))
    pen = Pen(picture, view.magnified(SUPERSAMPLING))
    for name, color in (("start_area", ROBOT), ("goal_area", GOAL)):
        if (rectangle := getattr(world, name)) is not None:
            x_min, y_min, x_max, y_max = rectangle
            corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
            pen.line(np.array([*corners, corners[0]]), color, 2)
    draw_movers(pen, world)
    draw_episodes(pen, sample_episodes(pool, 0, np.random.default_rng([seed, 0]), EPISODES))
    sheet = picture.reduce(SUPERSAMPLING)
    font = ImageFont.load_default(16)
    text = f"{world.name} \u00b7 {LEGEND}"
    ImageDraw.Draw(sheet).text((size[0] / 2, size[1] - 24), text, INK, font, "mm")
    return sheet


def split_free(pool: WorldPool) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the free cells of the first world that starts reach, and the others.

    Both have the shape of its ``free_space``.
    """
    space = pool.free_space(0)
    regions = space.regions()
    # By a goal: a fixed start may lie in a cell that is not free.
    cell = space.nearest_free(*pool.arrays.goals[0].tolist(), within=0.5)
    assert cell is not None
    reached = regions == regions[cell]
    return reached, space.free & ~reached


def _mask(space: FreeSpace, cells: NDArray[np.bool_], view: View, size: Size) -> Image.Image:
    """Return 255 where a cell is true, as an 8-bit picture of (width, height) [px]."""
    image = Image.fromarray(cells[::-1].astype(np.uint8) * 255)
    top = space.origin[1] + cells.shape[0] * space.resolution
    left, upper = view.pixels([space.origin[0], top])
    scale = 1.0 / (space.resolution * view.scale)
    matrix = (scale, 0.0, -left * scale, 0.0, scale, -upper * scale)
    return image.transform(size, Image.Transform.AFFINE, matrix, Image.Resampling.NEAREST)
