# SPDX-License-Identifier: Apache-2.0
"""What comes from a robot, as plain arrays, and how ROS's messages become that.

rclpy's classes, DDS's and rosbridge's JSON all have ROS's field names, so one function serves them.
Nothing here imports ROS.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    """By REP-117 [m], shape (num_beams,)."""
    frame_id: str = ""
    """The frame that directions are in."""


@dataclass(frozen=True)
class Odometry:
    """Where the robot believes to be and how it moves, as in ``nav_msgs/Odometry``."""

    stamp: float
    """By the robot's clock [s]."""
    pose: NDArray[np.float64]
    """x, y, yaw in the odometry frame [m, m, rad], shape (3,)."""
    twist: NDArray[np.float64]
    """v and w in base_link [m/s, rad/s], shape (2,)."""


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
        frame_id=str(message.header.frame_id),
    )


def odometry_from_ros(message: Any) -> Odometry:
    """Return a ``nav_msgs/Odometry`` as ours."""
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    twist = message.twist.twist
    yaw = yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)
    return Odometry(
        stamp=seconds(message.header.stamp),
        pose=np.array([place.x, place.y, yaw], dtype=np.float64),
        twist=np.array([twist.linear.x, twist.angular.z], dtype=np.float64),
    )


def seconds(stamp: Any) -> float:
    """Return a ``builtin_interfaces/Time`` in seconds."""
    nanoseconds = getattr(stamp, "nanosec", None)
    # rosbridge for ROS 1 says secs and nsecs.
    if nanoseconds is None:
        return float(stamp.secs) + 1e-9 * float(stamp.nsecs)
    return float(stamp.sec) + 1e-9 * float(nanoseconds)


def from_json(value: Any) -> Any:
    """Return rosbridge's JSON with fields instead of keys.

    JSON has no number for what is not finite, and rosbridge writes null. In a list, as in a scan's
    ranges, that is no return, as most lidars' drivers mean it; alone it is NaN.
    """
    if value is None:
        return math.nan
    if isinstance(value, Mapping):
        return SimpleNamespace(**{str(key): from_json(item) for key, item in value.items()})
    if isinstance(value, list):
        return [math.inf if item is None else from_json(item) for item in value]
    return value
