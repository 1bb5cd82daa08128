# SPDX-License-Identifier: Apache-2.0
"""A robot in a world as one MJCF model."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from pm01_nav.backends.body import WHEEL_FRICTION, BodyModel
from pm01_nav.backends.engine import WALL_THICKNESS
from pm01_nav.worlds.mjcf import world_model
from pm01_nav.worlds.sdf_writer import text_of
from pm01_nav.worlds.world import World

SERVO_TIME = 0.01
"""Time constant of the wheels' speed control, as long as nothing slips [s]."""
FLOOR, OBSTACLES = "1", "2"
"""Collision bits: wheels and casters meet the floor, the hull meets obstacles."""
ROBOT_GROUP = 3
"""Geom group of the robot, which its lidar does not see."""
SPARE_GEOMS = 16
"""Models are filled up to a multiple of so many geoms; see ``_fill``."""
SHELL = "0.16 0.32 0.55 1"
DARK = "0.12 0.12 0.13 1"


def robot_in_world(body: BodyModel, world: World, physics_dt: float) -> str:
    """Return the text of an MJCF model with a robot in a world; ``physics_dt`` in [s].

    Raises:
        InputError: MuJoCo cannot have the world; see ``world_model``.
    """
    root = world_model(world, WALL_THICKNESS)
    _add_settings(root, physics_dt)
    for geom in root.iter("geom"):
        _colour(geom)
    _add_robot(root, body)
    _fill(root)
    return tostring(root, encoding="unicode")


def _add_settings(root: Element, physics_dt: float) -> None:
    SubElement(root, "compiler", angle="radian")
    SubElement(root, "size", memory="2M")
    option = SubElement(root, "option", integrator="implicitfast")
    option.set("timestep", text_of([physics_dt]))
    # Islands and bounding volumes cost more than they save with one robot. A state that diverged
    # must be seen, not replaced by the initial one.
    SubElement(option, "flag", island="disable", midphase="disable", autoreset="disable")
    defaults = SubElement(root, "default")
    SubElement(defaults, "geom", contype=OBSTACLES, conaffinity=OBSTACLES)
    visual = SubElement(root, "visual")
    SubElement(visual, "global", offwidth="1920", offheight="1080")
    SubElement(visual, "headlight", ambient="0.45 0.45 0.45", diffuse="0.45 0.45 0.45")
    assets = root.find("asset")
    assert assets is not None
    # Small: each world's model has its own.
    checker = {"type": "2d", "builtin": "checker", "width": "32", "height": "32"}
    colours = {"rgb1": "0.80 0.82 0.84", "rgb2": "0.74 0.76 0.79"}
    SubElement(assets, "texture", {"name": "floor"} | checker | colours)
    SubElement(
        assets, "material", name="floor", texture="floor", texrepeat="1 1", texuniform="true"
    )
    sky = {"type": "skybox", "builtin": "gradient", "width": "32", "height": "32"}
    SubElement(assets, "texture", sky | {"rgb1": "0.86 0.90 0.95", "rgb2": "0.55 0.65 0.78"})


def _colour(geom: Element) -> None:
    name = geom.get("name", "")
    if name == "floor":
        geom.set("material", "floor")
        geom.set("contype", FLOOR)
        geom.set("conaffinity", FLOOR)
        geom.set("friction", text_of((WHEEL_FRICTION, 0.005, 0.0001)))
    else:
        geom.set("rgba", "0.80 0.36 0.22 1" if name.startswith("mover") else "0.72 0.75 0.80 1")


def _add_robot(root: Element, body: BodyModel) -> None:
    assets, world = root.find("asset"), root.find("worldbody")
    assert assets is not None
    assert world is not None
    base = SubElement(world, "body", name="base_link")
    base.set("pos", text_of((0, 0, body.wheel_radius)))
    SubElement(base, "freejoint", name="base")
    inertial = SubElement(base, "inertial", pos=text_of(body.hull_centre))
    inertial.set("mass", text_of([body.hull_mass]))
    inertial.set("diaginertia", text_of(body.hull_inertia))
    _add_hull(assets, base, body)
    for name, x in zip(("caster_front", "caster_rear"), body.casters, strict=True):
        caster = _add_part(base, name, "sphere", [body.caster_radius], rgba=DARK)
        caster.set("pos", text_of((x, 0, body.caster_height)))
        _stand(caster)
        # Whichever geom has priority decides; one dimension means no friction at all.
        caster.set("priority", "1")
        caster.set("condim", "1")
    lidar = _add_part(base, "lidar", "cylinder", (0.25 * body.radius, 0.02), rgba=DARK)
    lidar.set("pos", text_of(body.lidar))
    _show_only(lidar)
    actuators = SubElement(root, "actuator")
    for name, side in (("wheel_left", 1), ("wheel_right", -1)):
        _add_wheel(base, actuators, name, side * body.wheel_separation / 2.0, body)
    sensors = SubElement(root, "sensor")
    SubElement(sensors, "contact", name="touch", geom1="hull", num="1", data="found")


def _add_hull(assets: Element, base: Element, body: BodyModel) -> None:
    height, middle = body.top - body.bottom, (body.top + body.bottom) / 2.0
    if len(body.outline) == 0:
        hull = _add_part(base, "hull", "cylinder", (body.radius, height / 2.0), rgba=SHELL)
        hull.set("pos", text_of((0, 0, middle)))
        return
    corners = [(x, y, z) for z in (body.bottom, body.top) for x, y in body.outline]
    # The vertices are meant as they stand, not about their own centre of mass.
    mesh = SubElement(assets, "mesh", name="hull", vertex=text_of(np.ravel(corners)))
    mesh.set("inertia", "convex")
    hull = _add_part(base, "hull", "mesh", (), rgba=SHELL)
    hull.set("mesh", "hull")


def _add_wheel(base: Element, actuators: Element, name: str, y: float, body: BodyModel) -> None:
    link = SubElement(base, "body", name=name, pos=text_of((0, y, 0)))
    joint = SubElement(link, "joint", name=name, type="hinge", axis="0 1 0")
    radius = body.wheel_radius
    across = body.wheel_mass * radius**2 / 4.0
    inertial = SubElement(link, "inertial", pos="0 0 0", mass=text_of([body.wheel_mass]))
    inertial.set("diaginertia", text_of((across, 2.0 * across, across)))
    # Rolls as a ball, looks like a wheel.
    ball = _add_part(link, f"{name}_contact", "sphere", [radius], rgba="0 0 0 0")
    _stand(ball)
    ball.set("friction", text_of((WHEEL_FRICTION, 0.005, 0.0001)))
    tyre = _add_part(link, name, "cylinder", (radius, 0.3 * radius), rgba=DARK)
    tyre.set("euler", text_of((np.pi / 2.0, 0, 0)))
    _show_only(tyre)
    # Half of the robot hangs on each wheel: the torque that takes a speed error away in that time.
    load = 0.5 * body.mass * radius**2
    # A geared motor's rotor is as heavy as that, or the integrator, which damps wheels after the
    # contacts were solved, would let the robot slide.
    joint.set("armature", text_of([load]))
    servo = SubElement(actuators, "velocity", name=name, joint=name)
    servo.set("kv", text_of([2.0 * load / SERVO_TIME]))


def _fill(root: Element) -> None:
    """Add geoms that nothing meets, so that most models have one and the same size.

    Only models of one size can be stepped together.
    """
    world = root.find("worldbody")
    assert world is not None
    for index in range(-len(list(root.iter("geom"))) % SPARE_GEOMS):
        spare = _add_part(world, f"spare_{index}", "sphere", [0.001], rgba="0 0 0 0")
        spare.set("pos", "0 0 -1")
        # A bit of its own: what nothing could ever meet would not count.
        spare.set("contype", "4")
        spare.set("conaffinity", "0")


def _add_part(
    body: Element, name: str, kind: str, size: Sequence[float], **attributes: str
) -> Element:
    part = SubElement(body, "geom", name=name, type=kind, group=str(ROBOT_GROUP), mass="0")
    if size:
        part.set("size", text_of(size))
    for key, value in attributes.items():
        part.set(key, value)
    return part


def _stand(geom: Element) -> None:
    geom.set("contype", FLOOR)
    geom.set("conaffinity", FLOOR)


def _show_only(geom: Element) -> None:
    geom.set("contype", "0")
    geom.set("conaffinity", "0")
