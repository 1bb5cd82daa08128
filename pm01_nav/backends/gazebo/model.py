# SPDX-License-Identifier: Apache-2.0
"""A robot, its obstacles, a camera and the world around them as SDF for Gazebo's server.

The world holds the robot alone. Obstacles are models that come and go with the episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pm01_nav.backends.body import WHEEL_FRICTION, BodyModel, body_model
from pm01_nav.backends.engine import WALL_THICKNESS, View
from pm01_nav.robot import Limits, RobotSpec
from pm01_nav.worlds.obj_writer import obstacles_obj
from pm01_nav.worlds.sdf_writer import GREY, HEIGHT, add_obstacles, paint, text_of
from pm01_nav.worlds.shapes import as_box
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

WORLD, ROBOT = "pm01", "robot"
"""Names of the world and of its models."""
CMD_VEL, ODOM, SCAN, TOUCH, PICTURE = "/cmd_vel", "/odom", "/scan", "/touch", "/picture"
"""Topics; each server has a partition of its own."""
SYSTEMS = (
    ("physics", "Physics"),
    ("user-commands", "UserCommands"),
    ("sensors", "Sensors"),
    ("contact", "Contact"),
)
ODOM_RATE = 1000
"""More often than the physics steps [Hz]: after each step there is odometry of that step."""
MOVER_MASS = 1000.0
"""Of a mover that a robot shall not push away [kg]."""
MOVER_GAP = 0.02
"""Between a mover and the floor [m]."""
NEAREST = 0.02
"""A lidar is drawn from here on [m], or from its least range if that is nearer."""
ROBOT_FLAG, ALL_BUT_ROBOT = "1", str(0xFFFFFFFE)
"""Visibility: the lidar does not see its own robot."""
FIELD_OF_VIEW = np.radians(45.0)
"""Of the camera from top to bottom, as MuJoCo has it [rad]."""
NEAR, FAR = 0.05, 60.0
"""The camera draws nothing that is nearer or farther [m]."""
SHELL, DARK, GREEN = "0.16 0.32 0.55 1", "0.12 0.12 0.13 1", "0.18 0.68 0.36 1"


def server_world(robot: RobotSpec, physics_dt: float, control_dt: float) -> str:
    """Return an SDF world with a floor and the robot at the origin; both times in [s]."""
    root = Element("sdf", version="1.9")
    world = SubElement(root, "world", name=WORLD)
    physics = SubElement(world, "physics", name="step", type="ignored")
    fill(physics, max_step_size=text_of([physics_dt]), real_time_factor="0")
    for library, name in SYSTEMS:
        plugin = SubElement(world, "plugin", filename=f"gz-sim-{library}-system")
        plugin.set("name", f"gz::sim::systems::{name}")
        if name == "Sensors":
            fill(plugin, render_engine="ogre2", background_color="0.86 0.90 0.95")
    fill(SubElement(world, "scene"), ambient="0.6 0.6 0.6 1", grid="false", shadows="false")
    _add_sun(world)
    _add_floor(world)
    _add_robot(world, robot, 1.0 / control_dt)
    return tostring(root, encoding="unicode")


def obstacles_model(world: World, mesh: Path) -> str:
    """Return an SDF file's text with one static model: what stands still in a world.

    What lidars and cameras see of it is written as a Wavefront OBJ ``mesh``: hundreds of
    cylinders are drawn several times faster so than one by one.

    Raises:
        InputError: the grid would take too many boxes, or a polygon too many pieces.
    """
    root = Element("sdf", version="1.9")
    link = add_obstacles(root, world, WALL_THICKNESS, kinds=["collision"])
    content = obstacles_obj(world, HEIGHT, WALL_THICKNESS)
    if content:
        mesh.write_text(content, encoding="utf-8")
        visual = SubElement(link, "visual", name="obstacles")
        shape = SubElement(SubElement(visual, "geometry"), "mesh")
        fill(shape, uri=mesh.absolute().as_uri())
        paint(visual, GREY)
    return tostring(root, encoding="unicode")


def mover_model(radius: float) -> str:
    """Return an SDF file's text with one model: a pillar that others move; ``radius`` in [m]."""
    root = Element("sdf", version="1.9")
    link = SubElement(SubElement(root, "model", name="mover"), "link", name="link")
    moment = MOVER_MASS * (radius**2 / 4.0 + HEIGHT**2 / 12.0)
    add_inertial(link, MOVER_MASS, (0, 0, 0), (moment, moment, MOVER_MASS * radius**2 / 2.0))
    fill(link, gravity="false")
    for kind in ("collision", "visual"):
        part = SubElement(link, kind, name=kind)
        add_cylinder(part, radius, HEIGHT)
        if kind == "visual":
            paint(part, "0.80 0.36 0.22 1")
    return tostring(root, encoding="unicode")


def camera_model(size: tuple[int, int], rate: float) -> str:
    """Return an SDF file's text with a camera that hangs in the air; ``rate`` in [Hz]."""
    root = Element("sdf", version="1.9")
    link = SubElement(SubElement(root, "model", name="camera"), "link", name="link")
    add_inertial(link, 1.0, (0, 0, 0), (1.0, 1.0, 1.0))
    fill(link, gravity="false")
    sensor = SubElement(link, "sensor", name="camera", type="camera")
    fill(sensor, topic=PICTURE, update_rate=text_of([rate]), always_on="true")
    camera = SubElement(sensor, "camera")
    width, height = size
    across = 2.0 * np.arctan(np.tan(FIELD_OF_VIEW / 2.0) * width / height)
    fill(camera, horizontal_fov=text_of([across]))
    fill(SubElement(camera, "image"), width=str(width), height=str(height), format="R8G8B8")
    fill(SubElement(camera, "clip"), near=str(NEAR), far=str(FAR))
    return tostring(root, encoding="unicode")


def goal_model(view: View) -> str:
    """Return an SDF file's text with a marker on the floor that nothing can touch."""
    root = Element("sdf", version="1.9")
    model = SubElement(root, "model", name="goal")
    fill(model, static="true", pose=text_of((*view.goal, 0.005, 0, 0, 0)))
    visual = SubElement(SubElement(model, "link", name="link"), "visual", name="goal")
    add_cylinder(visual, view.goal_radius, 0.01)
    paint(visual, GREEN)
    return tostring(root, encoding="unicode")


def towards(view: View) -> NDArray[np.float64]:
    """Return the direction of a camera that looks along x, as a quaternion x, y, z, w, (4,)."""
    x, y, z = np.subtract(view.target, view.eye)
    turn = Rotation.from_euler("ZYX", [np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y)), 0.0])
    return turn.as_quat()


def seam_shift(robot: RobotSpec) -> float:
    """Return by how much the sensor is turned to keep beams off the edges of its cube map [rad].

    The edges lie 45 degrees beside the sensor's axes. A beam on one may be wrong by metres.
    """
    lidar = robot.lidar
    step = lidar.angle_increment or 1.0
    edges = np.pi / 4.0 + np.pi / 2.0 * np.arange(4)
    # Where each edge lies between two beams, 0 to 1, for every shift.
    shifts = np.arange(64) / 64.0
    between = ((edges - lidar.angle_min) / step + shifts[:, None]) % 1.0
    distance = np.minimum(between, 1.0 - between).min(axis=1)
    return float(shifts[np.argmax(distance)] * step)


def fill(element: Element, **texts: str) -> None:
    """Add children by tag and text."""
    for tag, text in texts.items():
        SubElement(element, tag).text = text


def _add_sun(world: Element) -> None:
    sun = SubElement(world, "light", type="directional", name="sun")
    fill(sun, cast_shadows="false", pose="0 0 10 0 0 0", direction="-0.5 0.3 -0.8")
    fill(sun, diffuse="0.7 0.7 0.7 1", specular="0.1 0.1 0.1 1")


def _add_floor(world: Element) -> None:
    model = SubElement(world, "model", name="floor")
    fill(model, static="true")
    link = SubElement(model, "link", name="link")
    for kind in ("collision", "visual"):
        part = SubElement(link, kind, name=kind)
        plane = SubElement(SubElement(part, "geometry"), "plane")
        fill(plane, normal="0 0 1", size="1000 1000")
        if kind == "collision":
            _add_friction(part, WHEEL_FRICTION)
        else:
            paint(part, "0.78 0.80 0.83 1")


def _add_robot(world: Element, robot: RobotSpec, rate: float) -> None:
    body = body_model(robot)
    model = SubElement(world, "model", name=ROBOT)
    fill(model, pose=text_of((0, 0, body.wheel_radius, 0, 0, 0)))
    base = SubElement(model, "link", name="base_link")
    add_inertial(base, body.hull_mass, body.hull_centre, body.hull_inertia)
    _add_hull(base, body)
    for name, x in zip(("caster_front", "caster_rear"), body.casters, strict=True):
        caster = SubElement(base, "collision", name=name)
        fill(caster, pose=text_of((x, 0, body.caster_height, 0, 0, 0)))
        _add_ball(caster, body.caster_radius)
        _add_friction(caster, 0.0)
    _add_lidar(base, robot, body, rate)
    touch = SubElement(base, "sensor", name="touch", type="contact")
    fill(touch, always_on="true", update_rate="1000")
    fill(SubElement(touch, "contact"), collision="hull", topic=TOUCH)
    for side, y in (("left", 0.5), ("right", -0.5)):
        _add_wheel(model, f"wheel_{side}", y * body.wheel_separation, body)
    _add_drive(model, robot.limits, body)


def add_inertial(
    link: Element,
    mass: float,
    centre: Sequence[float] | FloatArray,
    moments: Sequence[float] | FloatArray,
) -> None:
    """Add mass [kg], centre of mass (3,) [m] and moments about it (3,) [kg m^2] to a link."""
    inertial = SubElement(link, "inertial")
    fill(inertial, mass=text_of([mass]), pose=text_of((*centre, 0, 0, 0)))
    x, y, z = (text_of([moment]) for moment in moments)
    fill(SubElement(inertial, "inertia"), ixx=x, iyy=y, izz=z, ixy="0", ixz="0", iyz="0")


def _add_hull(base: Element, body: BodyModel) -> None:
    height, middle = body.top - body.bottom, (body.top + body.bottom) / 2.0
    box = as_box(body.outline) if len(body.outline) else None
    for kind in ("collision", "visual"):
        part = SubElement(base, kind, name="hull")
        if box is not None:
            fill(part, pose=text_of((box.x, box.y, middle, 0, 0, box.yaw)))
            shape = SubElement(SubElement(part, "geometry"), "box")
            fill(shape, size=text_of((box.length, box.width, height)))
        elif len(body.outline) == 0:
            fill(part, pose=text_of((0, 0, middle, 0, 0, 0)))
            add_cylinder(part, body.radius, height)
        else:
            # A polyline stands on its origin.
            fill(part, pose=text_of((0, 0, body.bottom, 0, 0, 0)))
            shape = SubElement(SubElement(part, "geometry"), "polyline")
            for corner in body.outline:
                SubElement(shape, "point").text = text_of(corner)
            fill(shape, height=text_of([height]))
        if kind == "visual":
            _show(part, SHELL)


def _add_lidar(base: Element, robot: RobotSpec, body: BodyModel, rate: float) -> None:
    lidar, shift = robot.lidar, seam_shift(robot)
    # Another name than the sensor's: in the scene both are one kind of thing.
    look = SubElement(base, "visual", name="lidar_body")
    fill(look, pose=text_of((*body.lidar, 0, 0, 0)))
    add_cylinder(look, 0.25 * body.radius, 0.04)
    _show(look, DARK)
    sensor = SubElement(base, "sensor", name="lidar", type="gpu_lidar")
    fill(sensor, pose=text_of((*body.lidar, 0, 0, lidar.yaw + shift)), topic=SCAN)
    fill(sensor, update_rate=text_of([rate]), always_on="true", visualize="false")
    device = SubElement(sensor, "lidar")
    horizontal = SubElement(SubElement(device, "scan"), "horizontal")
    fill(horizontal, samples=str(lidar.num_beams), resolution="1")
    fill(horizontal, min_angle=text_of([lidar.angle_min - shift]))
    fill(horizontal, max_angle=text_of([lidar.angle_max - shift]))
    nearest = min(NEAREST, lidar.range_min) or NEAREST
    fill(SubElement(device, "range"), min=text_of([nearest]), max=text_of([lidar.range_max]))
    fill(device, visibility_mask=ALL_BUT_ROBOT)


def _add_wheel(model: Element, name: str, y: float, body: BodyModel) -> None:
    radius = body.wheel_radius
    link = SubElement(model, "link", name=name)
    fill(link, pose=text_of((0, y, 0, 0, 0, 0)))
    across = body.wheel_mass * radius**2 / 4.0
    add_inertial(link, body.wheel_mass, (0, 0, 0), (across, 2.0 * across, across))
    # Rolls as a ball, looks like a wheel.
    ball = SubElement(link, "collision", name=f"{name}_contact")
    _add_ball(ball, radius)
    _add_friction(ball, WHEEL_FRICTION)
    tyre = SubElement(link, "visual", name=name)
    fill(tyre, pose=text_of((0, 0, 0, np.pi / 2.0, 0, 0)))
    add_cylinder(tyre, radius, 0.6 * radius)
    _show(tyre, DARK)
    joint = SubElement(model, "joint", name=f"{name}_joint", type="revolute")
    fill(joint, parent="base_link", child=name)
    axis = SubElement(joint, "axis")
    fill(axis, xyz="0 1 0")
    fill(SubElement(axis, "limit"), lower="-1e16", upper="1e16")


def _add_drive(model: Element, limits: Limits, body: BodyModel) -> None:
    plugin = SubElement(model, "plugin", filename="gz-sim-diff-drive-system")
    plugin.set("name", "gz::sim::systems::DiffDrive")
    fill(plugin, left_joint="wheel_left_joint", right_joint="wheel_right_joint")
    figures = {
        "wheel_separation": body.wheel_separation,
        "wheel_radius": body.wheel_radius,
        "min_linear_velocity": limits.linear_min,
        "max_linear_velocity": limits.linear_max,
        "min_angular_velocity": -limits.angular_max,
        "max_angular_velocity": limits.angular_max,
        "min_linear_acceleration": -limits.linear_acceleration,
        "max_linear_acceleration": limits.linear_acceleration,
        "min_angular_acceleration": -limits.angular_acceleration,
        "max_angular_acceleration": limits.angular_acceleration,
    }
    fill(plugin, **{tag: text_of([value]) for tag, value in figures.items()})
    fill(plugin, topic=CMD_VEL, odom_topic=ODOM, odom_publish_frequency=str(ODOM_RATE))


def add_cylinder(part: Element, radius: float, length: float) -> None:
    """Give a visual or a collision the shape of an upright cylinder [m]."""
    cylinder = SubElement(SubElement(part, "geometry"), "cylinder")
    fill(cylinder, radius=text_of([radius]), length=text_of([length]))


def _add_ball(part: Element, radius: float) -> None:
    fill(SubElement(SubElement(part, "geometry"), "sphere"), radius=text_of([radius]))


def _add_friction(collision: Element, coefficient: float) -> None:
    friction = SubElement(SubElement(collision, "surface"), "friction")
    fill(SubElement(friction, "ode"), mu=text_of([coefficient]), mu2=text_of([coefficient]))


def _show(visual: Element, colour: str) -> None:
    """Let people see a part of the robot, but not the robot itself."""
    paint(visual, colour)
    fill(visual, visibility_flags=ROBOT_FLAG)
