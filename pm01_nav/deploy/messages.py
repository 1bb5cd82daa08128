# SPDX-License-Identifier: Apache-2.0
"""What comes from a robot, as plain arrays: ROS, DDS and rosbridge all translate into these."""

from __future__ import annotations

from dataclasses import dataclass

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
