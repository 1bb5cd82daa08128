# SPDX-License-Identifier: Apache-2.0
"""Tell a world's own robot, and what plugins may move, from what stands still."""

from __future__ import annotations

from collections.abc import Iterator

from pm01_nav.worlds.sdf_model import Model

DRIVES = (
    "diff_drive",
    "diffdrive",
    "differentialdrive",
    "skid_steer",
    "skidsteer",
    "planar_move",
    "planarmove",
    "ackermann",
    "mecanum",
    "omni",
    "tricycle",
    "trackedvehicle",
    "trackcontroller",
    "velocitycontrol",
    "ros_control",
    "ros2_control",
    "rossteering",
    "cmd_vel",
    "multicopter",
    "ardupilot",
)
"""In the name or file of a plugin that drives a model, in small letters."""
LIDARS = ("gpu_lidar", "lidar", "gpu_ray", "ray")
HINGES = ("revolute", "continuous")
HARMLESS = (
    "state_publisher",
    "statepublisher",
    "p3d",
    "posepublisher",
    "jointstatepublisher",
    "ros_init",
    "ros_factory",
    "imu",
    "camera",
    "bumper",
    "contact",
    "touch",
    "performer",
    "label",
    "wheelslip",
    "buoyancy",
)
"""In the name or file of a plugin that moves nothing."""


def robot_reason(model: Model) -> str:
    """Say what makes a model a robot: a drive, or a lidar on wheels; empty where it is none."""
    if model.is_static:
        return ""
    for name in _plugins(model):
        if any(drive in name.lower() for drive in DRIVES):
            return f"plugin {name}"
    elements = [inner.element for inner in model.walk()]
    hinges = sum(j.get("type") in HINGES for e in elements for j in e.findall("joint"))
    for element in elements:
        for sensor in element.iterfind("link/sensor"):
            if sensor.get("type") in LIDARS and hinges >= 2:
                return f"lidar {(sensor.get('name') or '')[:60]}".rstrip()
    return ""


def moving_plugins(model: Model) -> list[str]:
    """Name the plugins that may move a model."""
    names = [n for n in _plugins(model) if not any(word in n.lower() for word in HARMLESS)]
    return list(dict.fromkeys(names))


def _plugins(model: Model) -> Iterator[str]:
    """Yield the file or, without one, the name of each plugin of a model, and of those in it."""
    for inner in model.walk():
        for plugin in inner.element.findall("plugin"):
            yield (plugin.get("filename") or plugin.get("name") or "")[:60]
