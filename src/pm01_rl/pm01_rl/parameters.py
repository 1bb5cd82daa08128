# SPDX-License-Identifier: Apache-2.0
"""Parameters with descriptions and ranges, and the supervisor's settings among them."""

from __future__ import annotations

from dataclasses import asdict

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node

from pm01_nav.deploy.safety import SafetyConfig

SAFETY_RANGES = {
    "scan_timeout_s": (0.01, 5.0, "A scan older than this stops the robot [s]."),
    "odometry_timeout_s": (0.01, 5.0, "Odometry older than this stops the robot [s]."),
    "transform_timeout_s": (0.01, 60.0, "A transform older than this stops the robot [s]."),
    "clock_jump_s": (0.1, 60.0, "Stamps that are off by more than this are a jump [s]."),
    "valid_share_min": (0.0, 1.0, "A scan with a smaller share of valid beams stops the robot."),
    "frozen_scan_s": (0.1, 1e9, "A lidar that repeats one scan while moving is broken [s]."),
    "padding": (0.0, 1.0, "The outline is larger by this to every side [m]."),
    "reaction_s": (0.001, 2.0, "From a command until the base takes it up [s]."),
    "time_to_collision_s": (0.01, 10.0, "Kept to obstacles in the slow-down zone [s]."),
    "obstacle_speed": (0.0, 5.0, "Obstacles may come nearer at this speed [m/s]."),
}


def described(text: str, *, read_only: bool = False) -> ParameterDescriptor:
    """Return a parameter's description."""
    return ParameterDescriptor(description=text, read_only=read_only)


def positive(text: str, highest: float) -> ParameterDescriptor:
    """Return the description of a number above 0."""
    return bounded(text, 1e-6, highest)


def bounded(text: str, low: float, high: float) -> ParameterDescriptor:
    """Return the description of a number from a range."""
    limits = FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
    return ParameterDescriptor(description=text, floating_point_range=[limits])


def declare_safety(node: Node) -> None:
    """Declare ``safety.*`` with the defaults of ``SafetyConfig``."""
    for name, default in asdict(SafetyConfig()).items():
        low, high, text = SAFETY_RANGES[name]
        node.declare_parameter(f"safety.{name}", default, bounded(text, low, high))


def read_safety(node: Node) -> SafetyConfig:
    """Return the supervisor's settings as they are now."""
    names = asdict(SafetyConfig())
    return SafetyConfig(**{n: float(node.get_parameter(f"safety.{n}").value) for n in names})
