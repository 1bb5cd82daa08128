# SPDX-License-Identifier: Apache-2.0
"""Ours as ROS messages; the other way is ``pm01_nav.deploy.messages``."""

from __future__ import annotations

import math
from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import LaserScan

from pm01_nav.deploy.messages import Odometry, Scan, ros_twist
from pm01_nav.deploy.safety import Command


def time_message(seconds: float) -> Time:
    """Return a time [s] as ROS has it."""
    nanoseconds = round(seconds * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def quaternion(yaw: float, *, upside_down: bool = False) -> Quaternion:
    """Return a heading on the floor [rad], of what may hang upside down, turned about its x."""
    sine, cosine = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    if upside_down:
        return Quaternion(x=cosine, y=sine, z=0.0, w=0.0)
    return Quaternion(x=0.0, y=0.0, z=sine, w=cosine)


def twist_message(command: Command | np.ndarray) -> Twist:
    """Return a command or a twist of any drive [m/s, rad/s]."""
    twist = Twist()
    twist.linear.x, twist.linear.y, twist.angular.z = ros_twist(command)
    return twist


def command_message(
    kind: type[Twist] | type[TwistStamped], command: Command, stamp: Time, frame: str
) -> Twist | TwistStamped:
    """Return a command [m/s, rad/s]; a ``TwistStamped`` with the time and the frame it is for."""
    if kind is Twist:
        return twist_message(command)
    message = TwistStamped(twist=twist_message(command))
    message.header.stamp, message.header.frame_id = stamp, frame
    return message


def scan_message(scan: Scan, frame: str, period: float) -> LaserScan:
    """Return a scan that took ``period`` [s]."""
    message = LaserScan(
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
        angle_increment=scan.angle_increment,
        scan_time=period,
        range_min=scan.range_min,
        range_max=scan.range_max,
        # An array of the message's own type is taken as it is; a list is checked item by item.
        ranges=array("f", np.asarray(scan.ranges, dtype=np.float32).tobytes()),
    )
    message.header.stamp, message.header.frame_id = time_message(scan.stamp), frame
    return message


def odometry_message(odometry: Odometry, frame: str, base_frame: str) -> OdometryMessage:
    """Return odometry between two frames."""
    message = OdometryMessage(child_frame_id=base_frame)
    message.header.stamp, message.header.frame_id = time_message(odometry.stamp), frame
    pose = message.pose.pose
    pose.position.x, pose.position.y = float(odometry.pose[0]), float(odometry.pose[1])
    pose.orientation = quaternion(float(odometry.pose[2]))
    message.twist.twist = twist_message(odometry.twist)
    return message


def transform_message(
    pose: np.ndarray, stamp: float, frame: str, child_frame: str
) -> TransformStamped:
    """Return the place of ``child_frame`` in ``frame``: x, y, yaw [m, m, rad]."""
    message = TransformStamped(child_frame_id=child_frame)
    message.header.stamp, message.header.frame_id = time_message(stamp), frame
    place = message.transform.translation
    place.x, place.y = float(pose[0]), float(pose[1])
    message.transform.rotation = quaternion(float(pose[2]))
    return message
