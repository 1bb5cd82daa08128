# SPDX-License-Identifier: Apache-2.0
"""All obstacles of a world that stand still as one mesh, which a renderer draws at a stroke."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.shapes import (
    WALL_THICKNESS,
    as_box,
    convex_pieces,
    counter_clockwise,
    obstacle_boxes,
)
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

DEVIATION = 0.001
"""Of a disc's outline from a circle [m]; lidars of this kind are a centimetre wrong."""
UPWARD = np.array([0.0, 0.0, 1.0])


def obstacles_obj(world: World, height: float, wall_thickness: float = WALL_THICKNESS) -> str:
    """Return a Wavefront OBJ of upright prisms on the floor, empty for a world without obstacles.

    Raises:
        InputError: the grid would take too many boxes, or a polygon too many pieces.
    """
    lines: list[str] = []
    for corners, normal in _faces(world, height, wall_thickness):
        lines += (f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners.tolist())
        lines.append("vn {:.6f} {:.6f} {:.6f}".format(*normal.tolist()))
        # Counted from the end.
        last = len(corners)
        lines.append("f " + " ".join(f"{k - last}//-1" for k in range(last)))
    return "\n".join(lines)


def _faces(
    world: World, height: float, wall_thickness: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield corners (n, 3) [m], counter-clockwise from outside, and outward normals (3,)."""
    for outline in _outlines(world, wall_thickness):
        low = np.column_stack([outline, np.zeros(len(outline))])
        high = low + height * UPWARD
        yield high, UPWARD
        for k in range(len(low)):
            wall = np.stack([low[k - 1], low[k], high[k], high[k - 1]])
            normal = np.cross(low[k] - low[k - 1], UPWARD)
            yield wall, normal / np.linalg.norm(normal)


def _outlines(world: World, wall_thickness: float) -> Iterator[FloatArray]:
    """Yield convex outlines (n, 2), counter-clockwise [m]."""
    for x, y, radius in world.discs.tolist():
        yield np.array([x, y]) + _circle(radius)
    for _, box in obstacle_boxes(world, wall_thickness):
        cos, sin = np.cos(box.yaw), np.sin(box.yaw)
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (box.length / 2, box.width / 2)
        yield np.array([box.x, box.y]) + half @ np.array([[cos, sin], [-sin, cos]])
    for polygon in world.polygons:
        if as_box(polygon) is None:
            yield from map(counter_clockwise, convex_pieces(polygon))


def _circle(radius: float) -> FloatArray:
    """Return a polygon whose edges lie as far within the circle as its corners outside."""
    deviation = min(DEVIATION, 0.02 * radius)
    reach = radius + deviation
    corners = int(np.ceil(np.pi / np.arccos((radius - deviation) / reach)))
    angles = 2.0 * np.pi / corners * np.arange(corners)
    return reach * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
