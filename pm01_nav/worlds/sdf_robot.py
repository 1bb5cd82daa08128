# SPDX-License-Identifier: Apache-2.0
"""Tell a world's own robot, and what plugins may move, from what stands still."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pm01_nav.worlds.sdf_model import Model

DRIVES = (
    "diffdrive",
    "differentialdrive",
    "skidsteer",
    "planarmove",
    "ackermann",
    "mecanum",
    "omni",
    "tricycle",
    "trackedvehicle",
    "trackcontroller",
    "velocitycontrol",
    "roscontrol",
    "ros2control",
    "steering",
    "cmdvel",
    "multicopter",
    "ardupilot",
)
"""In the file or the name of a plugin that drives a model; letters and digits alone count."""
LIDARS = ("gpu_lidar", "lidar", "gpu_ray", "ray")
HINGES = ("revolute", "continuous")
HARMLESS = (
    "publisher",
    "p3d",
    "rosinit",
    "rosfactory",
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
"""The same of a plugin that moves nothing."""


def robot_reason(model: Model) -> str:
    """Say what makes a model a robot: a drive, or a lidar on wheels; empty where it is none."""
    if model.is_static:
        return ""
    for name, letters in _plugins(model):
        if any(drive in letters for drive in DRIVES):
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
    plugins = _plugins(model)
    moving = [name for name, text in plugins if not any(word in text for word in HARMLESS)]
    return list(dict.fromkeys(moving))


def _plugins(model: Model) -> Iterator[tuple[str, str]]:
    """Yield what to call each plugin of a model, or of those in it, and its letters and digits."""
    for inner in model.walk():
        for plugin in inner.element.findall("plugin"):
            file, name = plugin.get("filename") or "", plugin.get("name") or ""
            yield (file or name)[:60], re.sub(r"[^a-z0-9]", "", f"{file} {name}".lower())
