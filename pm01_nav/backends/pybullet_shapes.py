# SPDX-License-Identifier: Apache-2.0
"""Robots and worlds as PyBullet's shapes: what they touch with, and what they look like."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from pm01_nav.backends.body import BodyModel
from pm01_nav.backends.engine import WALL_THICKNESS
from pm01_nav.worlds.mjcf import HEIGHT
from pm01_nav.worlds.shapes import as_box, convex_pieces, counter_clockwise, obstacle_boxes
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Colour = tuple[float, float, float, float]
Corners = list[list[float]]

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
"""A quaternion that turns nothing; the scalar comes last."""
AXLE = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Turns z to -y, where a wheel's axis lies."""
ROUND = 48
"""Sides of a hull that is a circle, as it is drawn."""
HULL_COLOUR: Colour = (0.16, 0.32, 0.55, 1.0)
DARK: Colour = (0.12, 0.12, 0.13, 1.0)
OBSTACLE_COLOUR: Colour = (0.56, 0.60, 0.66, 1.0)


class Shape(NamedTuple):
    """A part of a compound shape."""

    kind: int
    place: tuple[float, float, float]
    turn: tuple[float, float, float, float] = UPRIGHT
    radius: float = 0.0
    half: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Half lengths of a box [m]."""


class RobotShapes(NamedTuple):
    """Numbers of the shapes that all robots of a client share."""

    hull: int
    hull_look: int
    wheel: int
    wheel_look: int
    caster: int
    caster_look: int


def cylinder(x: float, y: float, radius: float) -> Shape:
    """Return an upright cylinder on the floor."""
    return Shape(bullet.GEOM_CYLINDER, (x, y, HEIGHT / 2.0), radius=radius)


def static_shapes(world: World) -> list[Shape]:
    """Return cylinders and boxes for what does not move in a world.

    Raises:
        InputError: its grid would take too many boxes.
    """
    shapes = [cylinder(x, y, radius) for x, y, radius in world.discs.tolist()]
    for _, box in obstacle_boxes(world, WALL_THICKNESS):
        turn = (0.0, 0.0, math.sin(box.yaw / 2.0), math.cos(box.yaw / 2.0))
        half = (box.length / 2.0, box.width / 2.0, HEIGHT / 2.0)
        shapes.append(Shape(bullet.GEOM_BOX, (box.x, box.y, HEIGHT / 2.0), turn, half=half))
    return shapes


def other_polygons(world: World) -> list[FloatArray]:
    """Return the convex pieces (n, 2) of the polygons that are no boxes.

    Raises:
        InputError: a polygon would take too many pieces.
    """
    pieces = [convex_pieces(polygon) for polygon in world.polygons if as_box(polygon) is None]
    return [piece for some in pieces for piece in some]


def prism(
    client: int, outline: FloatArray, bottom: float, top: float, colour: Colour
) -> tuple[int, int]:
    """Return the shape and the look of an upright prism over a convex outline (n, 2) [m]."""
    outline = counter_clockwise(outline)
    corners = [(x, y, z) for z in (bottom, top) for x, y in outline.tolist()]
    shape = bullet.createCollisionShape(bullet.GEOM_MESH, vertices=corners, physicsClientId=client)
    return shape, _prism_look(client, outline, bottom, top, colour)


def _prism_look(client: int, outline: FloatArray, bottom: float, top: float, colour: Colour) -> int:
    # Each face has its own corners, so that its edges stay sharp.
    faces, normals = _faces(outline, bottom, top)
    return bullet.createVisualShape(
        bullet.GEOM_MESH,
        vertices=faces,
        indices=list(range(len(faces))),
        normals=normals,
        rgbaColor=colour,
        physicsClientId=client,
    )


def _faces(outline: FloatArray, bottom: float, top: float) -> tuple[Corners, Corners]:
    """Return the corners of the triangles of a prism, counter-clockwise, and their normals."""
    triangles: Corners = []
    normals: Corners = []
    for (x1, y1), (x2, y2) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        length = max(math.hypot(x2 - x1, y2 - y1), 1e-9)
        triangles += [[x1, y1, bottom], [x2, y2, bottom], [x2, y2, top]]
        triangles += [[x1, y1, bottom], [x2, y2, top], [x1, y1, top]]
        normals += 6 * [[(y2 - y1) / length, (x1 - x2) / length, 0.0]]
    x0, y0 = outline[0]
    for (x1, y1), (x2, y2) in pairwise(outline[1:]):
        triangles += [[x0, y0, top], [x1, y1, top], [x2, y2, top]]
        normals += 3 * [[0.0, 0.0, 1.0]]
    return np.array(triangles).tolist(), np.array(normals).tolist()


def robot_shapes(client: int, body: BodyModel) -> RobotShapes:
    """Make a robot's shapes; casters look like the balls that they are."""
    hull, hull_look = _hull(client, body)
    wheel = bullet.createVisualShape(
        bullet.GEOM_CYLINDER,
        radius=body.wheel_radius,
        length=0.6 * body.wheel_radius,
        rgbaColor=DARK,
        visualFrameOrientation=AXLE,
        physicsClientId=client,
    )
    caster = bullet.createVisualShape(
        bullet.GEOM_SPHERE, radius=body.caster_radius, rgbaColor=DARK, physicsClientId=client
    )
    balls = [
        bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=radius, physicsClientId=client)
        for radius in (body.wheel_radius, body.caster_radius)
    ]
    return RobotShapes(hull, hull_look, balls[0], wheel, balls[1], caster)


def _hull(client: int, body: BodyModel) -> tuple[int, int]:
    if len(body.outline):
        return prism(client, body.outline, body.bottom, body.top, HULL_COLOUR)
    height, middle = body.top - body.bottom, (0.0, 0.0, (body.top + body.bottom) / 2.0)
    shape = bullet.createCollisionShape(
        bullet.GEOM_CYLINDER,
        radius=body.radius,
        height=height,
        collisionFramePosition=middle,
        physicsClientId=client,
    )
    # PyBullet draws cylinders with few and smoothed sides.
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    outline = body.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return shape, _prism_look(client, outline, body.bottom, body.top, HULL_COLOUR)
