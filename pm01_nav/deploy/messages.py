# SPDX-License-Identifier: Apache-2.0
"""What comes from a robot, as plain arrays, and how ROS's messages become that.

rclpy's classes, DDS's and rosbridge's JSON all have ROS's field names, so one function serves them.
Nothing here imports ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.drives import AxisName


@dataclass(frozen=True)
class Scan:
    """One turn of a lidar, as in ``sensor_msgs/LaserScan``."""

    stamp: float
    """When it was taken, by the robot's clock [s]."""
    angle_min: float
    """Direction of beam 0 in the lidar frame [rad]."""
    angle_increment: float
    """[rad]"""
    range_min: float
    """[m]"""
    range_max: float
    """[m]"""
    ranges: NDArray[np.float32]
    """As the driver sends them [m], shape (num_beams,)."""
    frame_id: str = ""
    """The lidar's frame; empty if unknown."""

    def mirrored(self) -> Scan:
        """Return the scan of a lidar that hangs upside down as seen from above, or back."""
        last = self.angle_min + self.angle_increment * (len(self.ranges) - 1)
        return replace(self, angle_min=-last, ranges=self.ranges[::-1])


@dataclass(frozen=True)
class Odometry:
    """Where the robot believes to be and how it moves, as in ``nav_msgs/Odometry``."""

    stamp: float
    """By the robot's clock [s]."""
    pose: NDArray[np.float64]
    """x, y, yaw in the odometry frame [m, m, rad], shape (3,)."""
    twist: NDArray[np.float64]
    """In base_link [m/s, rad/s], a number for each axis of the drive, such as v and w."""
    frame_id: str = ""
    """In which the pose is; empty if unknown."""


def yaw_of_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Return the heading that a rotation leaves on the floor [rad]; NaN stays NaN."""
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def heading_of(pose: Any) -> float | None:
    """Return the heading that a ``geometry_msgs/Pose`` asks for [rad]; None if it asks for none.

    It asks for none where the rotation is all zeros, which is no rotation.
    """
    turn = getattr(pose, "orientation", None)
    if turn is None or not any((turn.x, turn.y, turn.z, turn.w)):
        return None
    return yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)


def scan_from_ros(message: Any) -> Scan:
    """Return a ``sensor_msgs/LaserScan`` as ours."""
    return Scan(
        stamp=seconds(message.header.stamp),
        angle_min=float(message.angle_min),
        angle_increment=float(message.angle_increment),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
        ranges=np.asarray(message.ranges, dtype=np.float32),
        frame_id=str(getattr(message.header, "frame_id", "")),
    )


def odometry_from_ros(message: Any, axes: Sequence[AxisName] = ("x", "yaw")) -> Odometry:
    """Return a ``nav_msgs/Odometry`` as ours, with the speeds of a drive's ``axes``."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    twist = message.twist.twist
    yaw = yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Odometry(
        stamp=seconds(message.header.stamp),
        pose=np.array([place.x, place.y, yaw], dtype=np.float64),
        twist=np.array([_speed(twist, axis) for axis in axes], dtype=np.float64),
        frame_id=str(getattr(message.header, "frame_id", "")),
    )


def _speed(twist: Any, axis: AxisName) -> float:
    return twist.angular.z if axis == "yaw" else getattr(twist.linear, axis)


def ros_twist(command: Sequence[float] | NDArray[np.floating]) -> tuple[float, float, float]:
    """Return linear.x, linear.y and angular.z of a command or a twist: v, w or vx, vy, w."""
    x, *y, yaw = map(float, command)
    return x, y[0] if y else 0.0, yaw


def seconds(stamp: Any) -> float:
    """Return a ``builtin_interfaces/Time`` in seconds."""
    nanoseconds = getattr(stamp, "nanosec", None)
    # rosbridge for ROS 1 says secs and nsecs.
    if nanoseconds is None:
        return float(stamp.secs) + 1e-9 * float(stamp.nsecs)
    return float(stamp.sec) + 1e-9 * float(nanoseconds)


def from_json(value: Any) -> Any:
    """Return rosbridge's JSON with fields instead of keys.

    JSON has no number for what is not finite, and rosbridge writes null. Alone that is NaN. Among
    a scan's ranges it is no return, as most lidars' drivers mean it; but a list of nothing but
    null may as well be a lidar that is blind, and is NaN.
    """
    if value is None:
        return math.nan
    if isinstance(value, Mapping):
        return SimpleNamespace(**{str(key): from_json(item) for key, item in value.items()})
    if isinstance(value, list):
        blind = all(item is None for item in value)
        none = math.nan if blind else math.inf
        return [none if item is None else from_json(item) for item in value]
    return value
