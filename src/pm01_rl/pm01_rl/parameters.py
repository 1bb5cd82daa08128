# SPDX-License-Identifier: Apache-2.0
"""Parameters with descriptions and ranges, and the supervisor's settings among them."""

from __future__ import annotations

import math
from dataclasses import asdict

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node

from pm01_nav.deploy.controller import PATIENCE_S, YAW_TOLERANCE
from pm01_nav.deploy.safety import SafetyConfig

SAFETY_RANGES = {
    "scan_timeout_s": (0.01, 5.0, "A scan older than this stops the robot [s]."),
    "odometry_timeout_s": (0.01, 5.0, "Odometry older than this stops the robot [s]."),
    "transform_timeout_s": (0.01, 60.0, "A transform older than this stops the robot [s]."),
    "clock_jump_s": (0.1, 60.0, "Stamps that are off by more than this are a jump [s]."),
    "valid_share_min": (0.0, 1.0, "A scan with fewer beams that are not NaN stops the robot."),
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


def declare_parameters(node: Node) -> None:
    """Declare what the policy node can be told."""
    declare, fixed = node.declare_parameter, {"read_only": True}
    declare("policy", "", described("The policy's file, policy.onnx."))
    declare("robot", "", described("A robot's name or YAML; empty: the policy's own."))
    declare("goal_radius", 0.0, bounded("Near enough to a goal [m]; 0: the policy's.", 0, 10))
    text = "Near enough to a goal's heading [rad]; from pi on any heading will do."
    declare("yaw_goal_tolerance", YAW_TOLERANCE, bounded(text, 0.01, 2.0 * math.pi))
    text = "After so long of standing, or of a frame that tf does not know, goals are given up [s]."
    declare("goal_patience_s", PATIENCE_S, bounded(text, 0.1, 3600.0))
    declare("cmd_vel_stamped", False, described("Publish TwistStamped, not Twist.", **fixed))
    declare("base_frame", "base_link", described("The robot's frame.", **fixed))
    declare("global_frame", "map", described("The frame that localisation corrects.", **fixed))
    text = "What the base listens to, where our cmd_vel is passed on: watched for others."
    declare("base_topic", "cmd_vel", described(text, **fixed))
    declare("exclusive", False, described("Stand while somebody else publishes commands, too."))
    declare("publish_markers", True, described("Whether RViz gets something to show."))
    declare("autostart", False, described("Configure and activate at once.", **fixed))
    for name, default in asdict(SafetyConfig()).items():
        low, high, text = SAFETY_RANGES[name]
        declare(f"safety.{name}", default, bounded(text, low, high))


def read_safety(node: Node) -> SafetyConfig:
    """Return the supervisor's settings as they are now."""
    names = asdict(SafetyConfig())
    return SafetyConfig(**{n: float(node.get_parameter(f"safety.{n}").value) for n in names})
