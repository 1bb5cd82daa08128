# SPDX-License-Identifier: Apache-2.0
"""What Gazebo's messages say, in our terms; nothing of Gazebo is imported for it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, to_world, wrap_angle

FloatArray = NDArray[np.float64]


def nanoseconds(time: Any) -> int:
    """Return a ``gz.msgs.Time`` [ns]."""
    return int(time.sec) * 1_000_000_000 + int(time.nsec)


def stamp_of(message: Any) -> int:
    """Return the simulation time of a message with a header [ns]."""
    return nanoseconds(message.header.stamp)


def ranges_of(scan: Any, num_beams: int, topic: str) -> NDArray[np.float32]:
    """Return the ranges of a ``gz.msgs.LaserScan`` [m], infinity where nothing is hit.

    Raises:
        InputError: it has another number of beams than the robot.
    """
    ranges = np.array(scan.ranges, dtype=np.float32)
    if len(ranges) != num_beams:
        raise InputError(
            f"{topic}: {len(ranges)} beams, the robot has {num_beams}; give the --robot that drives"
        )
    # Nearer than the sensor can see, where nothing of the robot's own is.
    ranges[np.isneginf(ranges) | np.isnan(ranges)] = 0.0
    return ranges


def pose_of(odometry: Any) -> FloatArray:
    """Return x, y, yaw of a ``gz.msgs.Odometry`` [m, m, rad], shape (3,)."""
    place, turn = odometry.pose.position, odometry.pose.orientation
    return np.array([place.x, place.y, 2.0 * np.arctan2(turn.z, turn.w)])


def twist_of(odometry: Any) -> FloatArray:
    """Return v, w of a ``gz.msgs.Odometry`` [m/s, rad/s], shape (2,)."""
    return np.array([odometry.twist.linear.x, odometry.twist.angular.z])


def pose_since(start: FloatArray, origin: FloatArray, odometry: FloatArray) -> FloatArray:
    """Return an odometry pose as one in the world: ``start`` where odometry was ``origin``.

    All are x, y, yaw [m, m, rad], shape (3,).
    """
    place = to_world(to_frame(odometry[:2], origin), start)
    return np.array([*place, float(wrap_angle(start[2] + odometry[2] - origin[2]))])
