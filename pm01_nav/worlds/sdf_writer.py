# SPDX-License-Identifier: Apache-2.0
"""Write a world as SDF 1.9 for gz-sim."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree.ElementTree import Comment, Element, SubElement, indent, register_namespace, tostring

import numpy as np

from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.sdf import NAMESPACE
from pm01_nav.worlds.shapes import WALL_THICKNESS, as_box, obstacle_boxes
from pm01_nav.worlds.world import World

HEIGHT = 1.0
"""Of all obstacles [m]."""
PHYSICS_STEP = 0.004
"""Of Gazebo [s]; with its default of 1 ms wheels drive no better, three times slower."""
SOLID = ("collision", "visual")
"""What bodies meet, and what lidars and cameras see."""
GREY, RED = "0.5 0.5 0.5 1", "0.7 0.2 0.2 1"
ABOUT = (
    " Written by pm01. All static obstacles are collisions of one model. A spline mover is an "
    "actor with a trajectory, the same curve as in pm01; its cylinder is drawn by Gazebo classic, "
    "while gz-sim draws actors by their skin alone. SDF has no element for bouncing, looping and "
    "walking movers: they are kinematic models that stand at their first point. "
)


def world_to_sdf(world: World) -> str:
    """Return the text of an SDF 1.9 world with sun, ground and all obstacles.

    Discs become cylinders; rectangles, thin walls (2 cm) and groups of solid cells boxes; other
    polygons polylines. Bounds, start and goal area are kept in elements of our own.

    Raises:
        InputError: the grid would take too many boxes.
    """
    register_namespace("pm01", NAMESPACE)
    root = Element("sdf", version="1.9")
    root.append(Comment(ABOUT))
    element = SubElement(root, "world", name=xml_name(world.name))
    for name in ("bounds", "start", "start_area", "goal_area"):
        values = getattr(world, name)
        if values is not None:
            SubElement(element, f"{{{NAMESPACE}}}{name}").text = text_of(values)
    _add_physics(element)
    _add_sun(element)
    _add_ground(element)
    add_obstacles(element, world)
    for index, mover in enumerate(world.movers):
        if mover.motion == "spline":
            _add_actor(element, f"mover_{index}", mover)
        else:
            _add_standing(element, f"mover_{index}_{mover.motion}", mover)
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def xml_name(name: str) -> str:
    """Return a name that XML and Gazebo's topics allow."""
    return re.sub(r"[^\w-]+", "_", name) or "world"


def text_of(numbers: Iterable[Any]) -> str:
    """Return numbers as text from which the same numbers are read."""
    return " ".join(repr(float(number)) for number in numbers)


def _add_physics(world: Element) -> None:
    physics = SubElement(world, "physics", name="step", type="ignored")
    SubElement(physics, "max_step_size").text = text_of([PHYSICS_STEP])
    SubElement(physics, "real_time_factor").text = "1"


def _add_sun(world: Element) -> None:
    sun = SubElement(world, "light", type="directional", name="sun")
    for name, text in (
        ("cast_shadows", "true"),
        ("pose", "0 0 10 0 0 0"),
        ("diffuse", "0.8 0.8 0.8 1"),
        ("specular", "0.2 0.2 0.2 1"),
        ("direction", "-0.5 0.1 -0.9"),
    ):
        SubElement(sun, name).text = text


def _add_ground(world: Element) -> None:
    link = _add_model(world, "ground_plane")
    for kind in ("collision", "visual"):
        plane = SubElement(SubElement(SubElement(link, kind, name=kind), "geometry"), "plane")
        SubElement(plane, "normal").text = "0 0 1"
        SubElement(plane, "size").text = "1000 1000"


def _add_model(world: Element, name: str) -> Element:
    """Add a static model and return its link."""
    model = SubElement(world, "model", name=name)
    SubElement(model, "static").text = "true"
    return SubElement(model, "link", name="link")


def add_obstacles(
    parent: Element,
    content: World,
    thickness: float = WALL_THICKNESS,
    kinds: Sequence[str] = SOLID,
) -> Element:
    """Add a static model of all obstacles that stand still to ``parent``, return its link.

    ``thickness`` [m] is that of walls that have none in the plane.

    Raises:
        InputError: the grid would take too many boxes.
    """
    link = _add_model(parent, "obstacles")
    for index, (x, y, radius) in enumerate(content.discs):
        place = (x, y, HEIGHT / 2.0, 0, 0, 0)
        _add_solid(link, f"disc_{index}", _cylinder(radius), place, kinds=kinds)
    for part, box in obstacle_boxes(content, thickness):
        shape = Element("box")
        SubElement(shape, "size").text = text_of((box.length, box.width, HEIGHT))
        place = (box.x, box.y, HEIGHT / 2.0, 0, 0, box.yaw)
        _add_solid(link, part, shape, place, kinds=kinds)
    for index, polygon in enumerate(content.polygons):
        if as_box(polygon) is None:
            shape = Element("polyline")
            for point in polygon:
                SubElement(shape, "point").text = text_of(point)
            SubElement(shape, "height").text = text_of([HEIGHT])
            # A polyline stands on its origin, other shapes reach half their height below it.
            _add_solid(link, f"polygon_{index}", shape, (0, 0, 0, 0, 0, 0), kinds=kinds)
    return link


def _cylinder(radius: float) -> Element:
    cylinder = Element("cylinder")
    SubElement(cylinder, "radius").text = text_of([radius])
    SubElement(cylinder, "length").text = text_of([HEIGHT])
    return cylinder


def _add_solid(
    link: Element,
    name: str,
    shape: Element,
    pose: tuple[float, ...],
    colour: str = GREY,
    kinds: Sequence[str] = SOLID,
) -> None:
    """Add a collision and a visual of the same shape, or one of them."""
    for kind in kinds:
        part = SubElement(link, kind, name=f"{name}_{kind}")
        SubElement(part, "pose").text = text_of(pose)
        SubElement(part, "geometry").append(shape)
        if kind == "visual":
            paint(part, colour)


def paint(visual: Element, colour: str) -> None:
    """Give a visual a colour, red, green, blue and opacity from 0 to 1."""
    material = SubElement(visual, "material")
    SubElement(material, "ambient").text = colour
    SubElement(material, "diffuse").text = colour


def _add_standing(world: Element, name: str, mover: Mover) -> None:
    model = SubElement(world, "model", name=name)
    SubElement(model, "pose").text = text_of((*mover.points[0], 0, 0, 0, mover.heading))
    link = SubElement(model, "link", name="link")
    SubElement(link, "kinematic").text = "true"
    SubElement(link, "gravity").text = "false"
    pose = (0, 0, HEIGHT / 2.0, 0, 0, 0)
    _add_solid(link, "disc", _cylinder(mover.radius), pose, RED)


def _add_actor(world: Element, name: str, mover: Mover) -> None:
    actor = SubElement(world, "actor", name=name)
    script = SubElement(actor, "script")
    SubElement(script, "loop").text = "true"
    SubElement(script, "auto_start").text = "true"
    trajectory = SubElement(script, "trajectory", id="0", type="drive", tension="0")
    for time, point, yaw in zip(mover.times, mover.points, _yaws(mover), strict=True):
        waypoint = SubElement(trajectory, "waypoint")
        SubElement(waypoint, "time").text = text_of([time])
        SubElement(waypoint, "pose").text = text_of((*point, 0, 0, 0, yaw))
    link = SubElement(actor, "link", name="link")
    pose = (0, 0, HEIGHT / 2.0, 0, 0, 0)
    _add_solid(link, "disc", _cylinder(mover.radius), pose, RED)


def _yaws(mover: Mover) -> np.ndarray:
    """Return headings toward the next point, the last one kept [rad], shape (n,)."""
    steps = np.diff(mover.points, axis=0)
    yaws = np.arctan2(steps[:, 1], steps[:, 0])
    return np.append(yaws, yaws[-1])
