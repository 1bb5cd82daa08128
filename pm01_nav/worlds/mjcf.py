# SPDX-License-Identifier: Apache-2.0
"""Write a world as MJCF for MuJoCo: geoms on a floor."""

from __future__ import annotations

from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.sdf_writer import text_of, xml_name
from pm01_nav.worlds.shapes import WALL_THICKNESS, as_box, convex_pieces, obstacle_boxes
from pm01_nav.worlds.world import World

HEIGHT = 1.0
"""Of all obstacles [m]."""
MARGIN = 5.0
"""The floor reaches this far beyond the bounds [m]."""
ABOUT = (
    " Written by pm01. Geoms only: no robot, no actuators. Movers are mocap bodies that stand at "
    "their first point: set data.mocap_pos to move them. "
)


def world_to_mjcf(world: World) -> str:
    """Return the text of an MJCF model with a floor, a light and all obstacles.

    Raises:
        InputError: the grid would take too many boxes, or a polygon too many pieces.
    """
    root = world_model(world)
    root.insert(0, Comment(ABOUT))
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def world_model(world: World, wall_thickness: float = WALL_THICKNESS) -> Element:
    """Return the same model as an element, its obstacles in ``worldbody``, to add a robot to.

    Discs become cylinders; rectangles, thin walls and groups of solid cells boxes; other polygons
    meshes, which MuJoCo takes for their hulls, cut into convex pieces where they are not convex.

    Raises:
        InputError: the grid would take too many boxes, or a polygon too many pieces.
    """
    root = Element("mujoco", model=xml_name(world.name))
    assets, body = SubElement(root, "asset"), SubElement(root, "worldbody")
    _add_floor(body, world)
    for index, (x, y, radius) in enumerate(world.discs):
        _add_cylinder(body, f"disc_{index}", (x, y), radius)
    for name, box in obstacle_boxes(world, wall_thickness):
        geom = _add_geom(body, name, "box", (box.length / 2.0, box.width / 2.0, HEIGHT / 2.0))
        geom.set("pos", text_of((box.x, box.y, HEIGHT / 2.0)))
        # As a quaternion, because a compiler option decides the unit of angles.
        geom.set("quat", text_of((np.cos(box.yaw / 2.0), 0, 0, np.sin(box.yaw / 2.0))))
    for index, polygon in enumerate(world.polygons):
        if as_box(polygon) is None:
            for part, piece in enumerate(convex_pieces(polygon)):
                _add_prism(assets, body, f"polygon_{index}_{part}", piece)
    for index, mover in enumerate(world.movers):
        mocap = SubElement(body, "body", name=f"mover_{index}_{mover.motion}", mocap="true")
        mocap.set("pos", text_of((*mover.points[0], 0)))
        _add_cylinder(mocap, f"mover_{index}", (0.0, 0.0), mover.radius)
    return root


def _add_floor(body: Element, world: World) -> None:
    x_min, y_min, x_max, y_max = world.bounds
    size = ((x_max - x_min) / 2.0 + MARGIN, (y_max - y_min) / 2.0 + MARGIN, 0.1)
    floor = _add_geom(body, "floor", "plane", size)
    floor.set("pos", text_of(((x_min + x_max) / 2.0, (y_min + y_max) / 2.0, 0)))
    SubElement(body, "light", name="sun", directional="true", pos="0 0 10", dir="-0.5 0.1 -0.9")


def _add_geom(body: Element, name: str, kind: str, size: tuple[float, ...]) -> Element:
    return SubElement(body, "geom", name=name, type=kind, size=text_of(size))


def _add_cylinder(body: Element, name: str, place: tuple[float, float], radius: float) -> None:
    geom = _add_geom(body, name, "cylinder", (radius, HEIGHT / 2.0))
    geom.set("pos", text_of((*place, HEIGHT / 2.0)))


def _add_prism(assets: Element, body: Element, name: str, outline: NDArray[np.float64]) -> None:
    """Add an upright prism over a convex outline (n, 2) as a mesh of its corners."""
    # Around its own centre, because MuJoCo stores corners with seven digits.
    centre = outline.mean(axis=0)
    corners = [(*point, z) for z in (0.0, HEIGHT) for point in outline - centre]
    SubElement(assets, "mesh", name=name, vertex=text_of(np.ravel(corners)))
    geom = SubElement(body, "geom", name=name, type="mesh", mesh=name)
    geom.set("pos", text_of((*centre, 0)))
