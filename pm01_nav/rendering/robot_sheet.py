# SPDX-License-Identifier: Apache-2.0
"""A picture of a robot from above: outline, wheels, lidar with its beams, and a scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pm01_nav.geometry import rectangle, to_world
from pm01_nav.rendering.canvas import INK, LIDAR, METRES, PAGE, WHITE, Color
from pm01_nav.rendering.scene import View
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]

SIZE = 640
"""Side of the picture without its caption [px]."""
CAPTION = 64
MARGIN = 40
SUPERSAMPLING = 3
COLORS = 96
"""A picture has few colours; so its file stays small."""
BEAM_LENGTH = 1.5
"""Beams are drawn up to this many times as far as the outline reaches."""
MAX_BEAMS = 180
"""Beams drawn at most."""
EDGE: Color = (196, 98, 20)
BODY: Color = (250, 208, 168)
BEAM: Color = (170, 203, 248)
MUTED: Color = (110, 121, 139)
ARROW = np.array([[1.0, 0.0], [-0.7, 0.7], [-0.4, 0.0], [-0.7, -0.7]])
"""The lidar's direction (x, y), in parts of its mark."""
AXIS = 44
"""Length of the drawn axes [px]."""
STEPS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Lengths of a scale bar [m]."""


def draw_robot(robot: RobotSpec) -> Image.Image:
    """Draw a robot from above, x to the right."""
    reach = _reach(robot)
    # A lidar that sits off the middle moves its beams.
    half = BEAM_LENGTH * reach + float(np.hypot(robot.lidar.x, robot.lidar.y))
    scale = (SIZE / 2 - MARGIN) / half * SUPERSAMPLING
    view = View(scale, (SIZE * SUPERSAMPLING / 2, SIZE * SUPERSAMPLING / 2))
    picture = Image.new("RGB", (SIZE * SUPERSAMPLING, (SIZE + CAPTION) * SUPERSAMPLING), PAGE)
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, 0, SIZE * SUPERSAMPLING, SIZE * SUPERSAMPLING), WHITE)
    bar = max((step for step in STEPS if step * scale < 0.3 * picture.width), default=STEPS[0])
    _draw_grid(draw, view, bar)
    _draw_beams(draw, view, robot, BEAM_LENGTH * reach)
    _draw_body(draw, view, robot)
    _draw_axes(draw, view)
    _draw_lidar(draw, view, robot)
    small = picture.reduce(SUPERSAMPLING)
    _write_caption(small, robot, bar, scale / SUPERSAMPLING)
    return small.quantize(COLORS, dither=Image.Dither.NONE)


def _reach(robot: RobotSpec) -> float:
    """Return how far the robot's parts reach from its origin [m]."""
    lidar, wheels = robot.lidar, robot.wheels
    wheel = float(np.hypot(0.5 * wheels.separation, wheels.radius)) if wheels else 0.0
    return max(robot.footprint.circumscribed_radius, wheel, float(np.hypot(lidar.x, lidar.y)))


def _draw_grid(draw: ImageDraw.ImageDraw, view: View, step: float) -> None:
    side = SIZE * SUPERSAMPLING
    half = side / 2 / view.scale
    for place in np.arange(-np.floor(half / step), np.floor(half / step) + 1) * step:
        x, y = view.pixels([place, place]).tolist()
        draw.line((x, 0, x, side), METRES, SUPERSAMPLING)
        draw.line((0, y, side, y), METRES, SUPERSAMPLING)


def _draw_beams(draw: ImageDraw.ImageDraw, view: View, robot: RobotSpec, far: float) -> None:
    """Draw beams from where the lidar begins to see, beam 0 thick."""
    lidar = robot.lidar
    every = max(1, -(-lidar.num_beams // MAX_BEAMS))
    angles = lidar.angles[::every] + lidar.yaw
    for index, angle in reversed(list(enumerate(angles.tolist()))):
        direction = np.array([np.cos(angle), np.sin(angle)])
        near = min(lidar.range_min, far)
        ends = np.array([lidar.x, lidar.y]) + np.outer([near, min(far, lidar.range_max)], direction)
        color, width = (LIDAR, 3 * SUPERSAMPLING) if index == 0 else (BEAM, SUPERSAMPLING)
        draw.line(view.pixels(ends).ravel().tolist(), color, width)


def _draw_body(draw: ImageDraw.ImageDraw, view: View, robot: RobotSpec) -> None:
    line = 2 * SUPERSAMPLING
    footprint, wheels = robot.footprint, robot.wheels
    if footprint.shape == "circle":
        x, y = view.origin
        reach = footprint.radius * view.scale
        draw.ellipse((x - reach, y - reach, x + reach, y + reach), BODY, EDGE, line)
    else:
        corners = view.pixels(footprint.vertices).ravel().tolist()
        draw.polygon(corners, BODY, EDGE, line)
    if wheels is None:
        return
    axle = [[0.0, -0.5 * wheels.separation], [0.0, 0.5 * wheels.separation]]
    draw.line(view.pixels(axle).ravel().tolist(), MUTED, SUPERSAMPLING)
    for side in (-0.5, 0.5):
        # The width is not known; a third of the radius looks like a wheel.
        wheel = rectangle(0.0, side * wheels.separation, 2 * wheels.radius, 0.34 * wheels.radius)
        draw.polygon(view.pixels(wheel).ravel().tolist(), INK)


def _draw_lidar(draw: ImageDraw.ImageDraw, view: View, robot: RobotSpec) -> None:
    """Mark the lidar's place and direction."""
    lidar = robot.lidar
    mark = view.pixels([lidar.x, lidar.y])
    radius = 11 * SUPERSAMPLING
    x, y = mark.tolist()
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), LIDAR, WHITE, SUPERSAMPLING)
    tip = to_world(0.65 * radius * ARROW, np.array([0.0, 0.0, lidar.yaw]))
    draw.polygon((mark + tip * np.array([1.0, -1.0])).ravel().tolist(), WHITE)


def _draw_axes(draw: ImageDraw.ImageDraw, view: View) -> None:
    """Draw base_link: an axis along x and one along y, with their names."""
    font = ImageFont.load_default(13 * SUPERSAMPLING)
    x, y = view.origin
    length, gap, dot = AXIS * SUPERSAMPLING, 9 * SUPERSAMPLING, 4 * SUPERSAMPLING
    for name, across, up in (("x", 1, 0), ("y", 0, 1)):
        draw.line((x, y, x + length * across, y - length * up), EDGE, 2 * SUPERSAMPLING)
        reach = length + gap
        draw.text((x + reach * across, y - reach * up), name, EDGE, font, "mm")
    draw.ellipse((x - dot, y - dot, x + dot, y + dot), EDGE)


def _write_caption(picture: Image.Image, robot: RobotSpec, bar: float, scale: float) -> None:
    draw = ImageDraw.Draw(picture)
    left, base = 24, SIZE + CAPTION / 2
    large, small = ImageFont.load_default(17), ImageFont.load_default(13)
    draw.text((left, base - 9), robot.name, INK, large, "lm")
    draw.text((left, base + 13), summary(robot), MUTED, small, "lm")
    right = SIZE - 24
    draw.line((right - bar * scale, base + 12, right, base + 12), INK, 3)
    for x in (right - bar * scale, right):
        draw.line((x, base + 7, x, base + 17), INK, 2)
    text = f"{bar * 100:g} cm" if bar < 1.0 else f"{bar:g} m"
    draw.text((right - bar * scale / 2, base - 6), text, INK, small, "mm")


def summary(robot: RobotSpec) -> str:
    """Return the main figures in one line."""
    lidar = robot.lidar
    # A full circle does not repeat its first beam.
    opening = np.degrees(lidar.angle_max - lidar.angle_min)
    around = opening + 1.01 * np.degrees(lidar.angle_increment) >= 360.0
    return (
        f"up to {robot.limits.linear_max:g} m/s and {robot.limits.angular_max:g} rad/s, "
        f"{lidar.num_beams} beams over {360.0 if around else opening:.0f}\u00b0"
    )
