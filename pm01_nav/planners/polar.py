# SPDX-License-Identifier: Apache-2.0
"""How far a robot could go in each direction, and how it turns to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.robot import Limits, RobotSpec

FloatArray = NDArray[np.float64]


class PolarView:
    """The nearest return in the way of a disc, for equal sectors around the robot."""

    def __init__(self, robot: RobotSpec, sectors: int, safety: float) -> None:
        """Take the disc around the footprint, larger by ``safety`` [m]."""
        self.radius = robot.footprint.circumscribed_radius + safety
        self.sectors = sectors
        lidar = robot.lidar
        directions = lidar.angles + lidar.yaw
        self._beams = np.stack([np.cos(directions), np.sin(directions)])
        self._mount = (lidar.x, lidar.y)

    def __call__(self, scan: FloatArray) -> FloatArray:
        """Return distances between centres [m], shape (n, sectors), infinity where it is free.

        ``scan`` (n, num_beams) is clean (``clean_ranges``). Sector 0 begins straight behind the
        robot, the next ones follow counter-clockwise.
        """
        nearest = np.full((len(scan), self.sectors), np.inf)
        _enter(nearest, scan, self._beams, self._mount, self.radius)
        return nearest


@compiled
def _enter(nearest, scan, beams, mount, radius):
    """Let each return close the sectors under which a disc of ``radius`` [m] around it is seen."""
    sectors = nearest.shape[1]
    per_radian = sectors / (2.0 * np.pi)
    for i in range(scan.shape[0]):
        for k in range(scan.shape[1]):
            if scan[i, k] == np.inf:
                continue
            x = mount[0] + scan[i, k] * beams[0, k]
            y = mount[1] + scan[i, k] * beams[1, k]
            distance = np.sqrt(x * x + y * y)
            half = np.arcsin(min(radius / max(distance, 1e-6), 1.0))
            middle = np.arctan2(y, x) + np.pi
            first = int(np.floor((middle - half) * per_radian))
            last = int(np.floor((middle + half) * per_radian))
            for s in range(first, last + 1):
                nearest[i, s % sectors] = min(nearest[i, s % sectors], distance)


def turn_to(
    direction: FloatArray, speed: FloatArray, limits: Limits, gain: float, rotate_angle: float
) -> FloatArray:
    """Return commands (n, 2) that turn to directions (n,) [rad] while driving.

    The speeds (n,) [m/s] fall with the angle, to nothing at ``rotate_angle`` [rad]; ``gain`` [1/s]
    is the turn rate per radian.
    """
    angular = np.clip(gain * direction, -limits.angular_max, limits.angular_max)
    ahead = np.maximum(1.0 - np.abs(direction) / rotate_angle, 0.0)
    return np.stack([speed * ahead, angular], axis=-1)
