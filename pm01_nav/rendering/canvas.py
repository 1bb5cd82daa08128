# SPDX-License-Identifier: Apache-2.0
"""Pictures of a robot in its world, drawn with Pillow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageChops, ImageDraw, ImageFilter, ImageFont

from pm01_nav.geometry import rectangle, to_world
from pm01_nav.rendering.scene import (
    CAPTION_HEIGHT,
    MARGIN,
    Outcome,
    Scene,
    Size,
    View,
    fit,
    layout_unit,
    picture_size,
    shown_area,
)
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.grid import OccupancyGrid, coarsened
from pm01_nav.worlds.world import World

Array = NDArray[np.floating]
Color = tuple[int, int, int]
Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
Paint = tuple[int, ...] | int

PAGE: Color = (238, 241, 245)
FLOOR: Color = (255, 255, 255)
METRES: Color = (240, 243, 247)
SHADOW: Color = (120, 134, 156)
OBSTACLE: Color = (158, 170, 187)
OBSTACLE_EDGE: Color = (121, 135, 156)
WALL: Color = (84, 97, 118)
LIDAR: Color = (47, 128, 237)
MOVER: Color = (64, 156, 173)
MOVER_EDGE: Color = (38, 112, 127)
ROBOT: Color = (242, 128, 38)
GOAL: Color = (124, 92, 214)
INK: Color = (58, 68, 86)
WHITE: Color = (255, 255, 255)
SUCCESS: Color = (34, 160, 107)
COLLISION: Color = (214, 56, 62)
TIMEOUT: Color = (132, 141, 156)

OUTCOMES: dict[Outcome, tuple[str, Color]] = {
    "success": ("goal reached", SUCCESS),
    "collision": ("collision", COLLISION),
    "timeout": ("time out", TIMEOUT),
}

ARROW = np.array([[0.7, 0.0], [-0.5, 0.48], [-0.25, 0.0], [-0.5, -0.48]])
"""The heading mark (x, y), in inscribed radii of the footprint."""
SHADOW_ALPHA = 110
"""Of the soft shadow around obstacles, out of 255."""

SUPERSAMPLING = 2
"""A frame is drawn this many times as large and then averaged."""
MAX_RAYS = 120
"""Rays drawn at most; a dot marks every return."""
MAX_TRAIL_PIECES = 48
"""Shades of the trail at most."""
MAX_PIXELS = 1.0e6
"""Coordinates beyond this are cut: Pillow overflows on very large ones [px]."""


@dataclass(frozen=True)
class _Brush:
    """Draws on one picture in world coordinates; colours may carry an alpha."""

    draw: ImageDraw.ImageDraw
    view: View
    unit: float
    """One unit of the layout [px]."""

    def pixels(self, points: Array) -> list[float]:
        """Return world points (n, 2) as Pillow takes them: x, y, x, y, ..."""
        return self.view.pixels(points).clip(-MAX_PIXELS, MAX_PIXELS).ravel().tolist()

    def width(self, units: float) -> int:
        """Return the width of a line of ``units`` [px]."""
        return max(1, round(units * self.unit))

    def disc(
        self,
        centre: Array,
        radius: float,
        fill: Paint,
        outline: Paint | None = None,
        units: float = 0.0,
    ) -> None:
        """Draw a disc of ``radius`` [px] around a world point (2,), edged by ``units``."""
        x, y = self.pixels(centre)
        box = (x - radius, y - radius, x + radius, y + radius)
        self.draw.ellipse(box, fill, outline, self.width(units))


class Canvas:
    """Draws scenes in one world; what stands still is drawn once."""

    def __init__(self, world: World, robot: RobotSpec, size: Size | None = None) -> None:
        """Draw the world; ``size`` is (width, height) [px], by default one that the world fills."""
        area = shown_area(world)
        self.size = size or picture_size(area)
        self.view = fit(area, self.size)
        self._robot = robot
        self._unit = layout_unit(self.size)
        self._font = ImageFont.load_default(max(9.0, 15 * self._unit))
        self._background = draw_world(world, self.view, self.size)

    def draw(self, scene: Scene) -> NDArray[np.uint8]:
        """Return one picture, RGB, shape (height, width, 3)."""
        picture = self._background.copy()
        brush = _Brush(
            ImageDraw.Draw(picture, "RGBA"),
            self.view.magnified(SUPERSAMPLING),
            self._unit * SUPERSAMPLING,
        )
        _draw_goal(brush, scene)
        _draw_trail(brush, np.asarray(scene.trail, dtype=np.float64))
        if scene.scan is not None:
            _draw_scan(brush, self._robot, scene.pose, np.asarray(scene.scan, dtype=np.float64))
        for x, y, radius in scene.movers:
            brush.disc(np.array([x, y]), radius * brush.view.scale, MOVER, MOVER_EDGE, 1.5)
        _draw_robot(brush, self._robot, scene)
        frame = picture.reduce(SUPERSAMPLING)
        _write_caption(frame, scene, self._unit, self._font)
        return np.array(frame)


def draw_world(world: World, view: View, size: Size) -> Image.Image:
    """Draw what stands still, ``SUPERSAMPLING`` times as large as the picture."""
    view, unit = view.magnified(SUPERSAMPLING), layout_unit(size) * SUPERSAMPLING
    picture = Image.new("RGB", (size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING), PAGE)
    _draw_floor(_Brush(ImageDraw.Draw(picture), view, unit), _floor(world))
    shadow = Image.new("L", picture.size, 0)
    _draw_obstacles(shadow, view, unit, world, (SHADOW_ALPHA, SHADOW_ALPHA, SHADOW_ALPHA))
    shadow = shadow.filter(ImageFilter.GaussianBlur(2.5 * unit))
    picture.paste(SHADOW, (0, round(1.5 * unit)), shadow)
    _draw_obstacles(picture, view, unit, world, (OBSTACLE, OBSTACLE_EDGE, WALL))
    return picture


def _floor(world: World) -> tuple[float, float, float, float]:
    """Return the part of the bounds that is shown."""
    (left, low, right, high), (x_min, y_min, x_max, y_max) = shown_area(world), world.bounds
    return max(left, x_min), max(low, y_min), min(right, x_max), min(high, y_max)


def _draw_floor(brush: _Brush, bounds: tuple[float, float, float, float]) -> None:
    """Draw the area of ``bounds`` [m] with a line each metre, or each 5 m in a large world."""
    x_min, y_min, x_max, y_max = bounds
    left, top, right, bottom = brush.pixels(np.array([[x_min, y_max], [x_max, y_min]]))
    brush.draw.rectangle((left, top, right, bottom), FLOOR)
    step = 1 if brush.view.scale > 20 * brush.unit else 5
    for x in np.arange(np.ceil(x_min / step) * step, x_max + 1e-9, step):
        column, _ = brush.pixels(np.array([x, 0.0]))
        brush.draw.line((column, top, column, bottom), METRES, brush.width(1))
    for y in np.arange(np.ceil(y_min / step) * step, y_max + 1e-9, step):
        _, row = brush.pixels(np.array([0.0, y]))
        brush.draw.line((left, row, right, row), METRES, brush.width(1))


def _draw_obstacles(
    picture: Image.Image, view: View, unit: float, world: World, colors: tuple[Paint, Paint, Paint]
) -> None:
    """Draw all that is solid; ``colors`` are those of areas, their edges and thin walls."""
    fill, edge, wall = colors
    brush = _Brush(ImageDraw.Draw(picture), view, unit)
    if world.grid is not None:
        picture.paste(edge, mask=_grid_mask(world, world.grid, view, picture.size))
    for polygon in world.polygons:
        brush.draw.polygon(brush.pixels(polygon), fill, edge, brush.width(1.5))
    for x, y, radius in world.discs:
        brush.disc(np.array([x, y]), radius * view.scale, fill, edge, 1.5)
    for segment in world.segments:
        ends = segment.reshape(2, 2)
        brush.draw.line(brush.pixels(ends), wall, brush.width(3))
        for end in ends:
            brush.disc(end, 1.5 * unit, wall)


def _grid_mask(world: World, grid: OccupancyGrid, view: View, size: Size) -> Image.Image:
    """Return 255 where a cell is solid, as an 8-bit picture of (width, height) [px].

    Of a closed grid all around is solid, too, as far as the picture shows anything.
    """
    # Of cells smaller than a pixel none is lost: the pixel is solid if one of them is.
    factor = max(int(1.0 / (grid.resolution * view.scale)), 1)
    cells = coarsened(grid.occupied[::-1] != 0, factor)
    matrix = _to_image(grid, view, factor)
    picture, where = (
        Image.fromarray(values.astype(np.uint8) * 255).transform(
            size, Image.Transform.AFFINE, matrix, Image.Resampling.NEAREST
        )
        for values in (cells, np.ones_like(cells))
    )
    if not grid.closed:
        return picture
    x_min, y_min, x_max, y_max = shown_area(world)
    left, top, right, bottom = view.pixels([[x_min, y_max], [x_max, y_min]]).ravel().tolist()
    shown = Image.new("L", size)
    ImageDraw.Draw(shown).rectangle((left, top, right, bottom), 255)
    mask = Image.new("L", size, 255)
    mask.paste(picture, mask=where)
    return ImageChops.darker(mask, shown)


def _to_image(grid: OccupancyGrid, view: View, factor: int) -> tuple[float, ...]:
    """Return what maps pixels to an image of a grid's blocks, as ``Image.transform`` takes it."""
    x, y = view.pixels(grid.origin)
    scale = 1.0 / (grid.resolution * view.scale * factor)
    cos, sin = (scale * value for value in grid.direction)
    top = grid.occupied.shape[0] / factor
    return cos, -sin, sin * y - cos * x, sin, cos, top - sin * x - cos * y


def _draw_goal(brush: _Brush, scene: Scene) -> None:
    """Draw a target as large as the goal counts."""
    color = {"success": SUCCESS, "timeout": TIMEOUT}.get(scene.outcome or "", GOAL)
    radius = max(scene.goal_radius * brush.view.scale, 5 * brush.unit)
    brush.disc(scene.goal, radius, (*color, 44), color, 2)
    brush.disc(scene.goal, max(0.16 * radius, 2 * brush.unit), color)


def _draw_trail(brush: _Brush, trail: Array) -> None:
    """Draw the way driven, paler the older it is, in a few pieces of one colour each."""
    if len(trail) < 2:
        return
    # Opaque colours: translucent pieces would show a darker dot where two of them meet.
    pixels = brush.view.pixels(trail).clip(-MAX_PIXELS, MAX_PIXELS)
    cuts = np.unique(np.linspace(0, len(trail) - 1, MAX_TRAIL_PIECES + 1).round().astype(int))
    for begin, end in pairwise(cuts):
        strength = 0.15 + 0.6 * end / (len(trail) - 1)
        color = tuple(round(f + (r - f) * strength) for f, r in zip(FLOOR, ROBOT, strict=True))
        points = pixels[begin : end + 1]
        brush.draw.line(points.ravel().tolist(), color, brush.width(3), joint="curve")


def _draw_scan(brush: _Brush, robot: RobotSpec, pose: Array, scan: Array) -> None:
    """Draw the area that the lidar sees through, some of its rays and all of its returns."""
    lidar = robot.lidar
    start = to_world(np.array([lidar.x, lidar.y]), pose)
    angles = lidar.angles + lidar.yaw + pose[2]
    # REP-117: +inf is no return within range_max, -inf one nearer than range_min.
    ranges = np.nan_to_num(scan, nan=0.0, posinf=lidar.range_max, neginf=lidar.range_min)
    ends = start + ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if len(ends) > 1:
        brush.draw.polygon(brush.pixels(np.concatenate([[start], ends])), (*LIDAR, 20))
    pixels = brush.view.pixels(ends[np.isfinite(scan)]).clip(-MAX_PIXELS, MAX_PIXELS)
    origin = tuple(brush.pixels(start))
    every = max(1, -(-len(pixels) // MAX_RAYS))
    for x, y in pixels[::every].tolist():
        brush.draw.line((*origin, x, y), (*LIDAR, 56), 1)
    radius = 1.5 * brush.unit
    for x, y in pixels.tolist():
        brush.draw.ellipse((x - radius, y - radius, x + radius, y + radius), LIDAR)


def _draw_robot(brush: _Brush, robot: RobotSpec, scene: Scene) -> None:
    """Draw the outline, the wheels and where it heads, on a halo by which it is found."""
    color = {"collision": COLLISION, "timeout": TIMEOUT}.get(scene.outcome or "", ROBOT)
    dark = tuple(round(0.72 * c) for c in color)
    footprint, wheels, pose = robot.footprint, robot.wheels, scene.pose
    reach = footprint.circumscribed_radius * brush.view.scale
    brush.disc(scene.pose[:2], reach + 4 * brush.unit, (*color, 50))
    if footprint.shape == "circle":
        brush.disc(pose[:2], reach, color, dark, 1.5)
    else:
        corners = brush.pixels(to_world(np.array(footprint.vertices), pose))
        brush.draw.polygon(corners, color, dark, brush.width(1.5))
    if wheels is not None:
        for y in (-0.5 * wheels.separation, 0.5 * wheels.separation):
            wheel = rectangle(0.0, y, 2 * wheels.radius, 0.4 * wheels.radius)
            brush.draw.polygon(brush.pixels(to_world(wheel, pose)), INK)
    arrow = footprint.inscribed_radius * ARROW
    brush.draw.polygon(brush.pixels(to_world(arrow, pose)), WHITE)


def _write_caption(frame: Image.Image, scene: Scene, unit: float, font: Font) -> None:
    """Write the caption and the outcome into the strip at the bottom, over what reached it."""
    draw = ImageDraw.Draw(frame)
    height, margin = CAPTION_HEIGHT * unit, MARGIN * unit
    middle, right = frame.height - 0.5 * height - 0.25 * margin, frame.width - margin
    draw.rectangle((0, frame.height - height, frame.width, frame.height), PAGE)
    if scene.outcome is not None:
        word, color = OUTCOMES[scene.outcome]
        draw.text((right, middle), word, color, font, "rm")
        right -= font.getlength(word) + 0.5 * margin
        radius = 4 * unit
        draw.ellipse((right - 2 * radius, middle - radius, right, middle + radius), color)
        right -= 2 * radius + margin
    text = scene.caption
    if font.getlength(text) > right - margin:
        while text and font.getlength(text + "\u2026") > right - margin:
            text = text[:-1]
        text += "\u2026"
    draw.text((margin, middle), text, INK, font, "lm")
