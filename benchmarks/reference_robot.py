# SPDX-License-Identifier: Apache-2.0
"""A robot among discs by other means than the package's, for judges that share no code with it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pm01_nav.robot import RobotSpec, full_circle, load_robot

FloatArray = NDArray[np.float64]


def robot_with(name: str, num_beams: int) -> RobotSpec:
    """Return a robot with a lidar of so many beams: few are quick to cast."""
    robot = load_robot(name)
    lidar = robot.lidar.model_copy(update=full_circle(num_beams))
    return robot.model_copy(update={"lidar": lidar})


class Base:
    """The true robot: first-order lag, limits of acceleration, an arc in small steps."""

    def __init__(self, robot: RobotSpec, pose: FloatArray, twist: FloatArray) -> None:
        """Begin at a pose and a twist."""
        self._limits = robot.limits
        self._keep = math.exp(-0.01 / max(robot.actuator.lag_s, 1e-9))
        self._x, self._y, self._yaw = map(float, pose)
        self._v, *side, self._w = map(float, twist)
        self._goes_sideways, self._u = bool(side), sum(side)

    @property
    def pose(self) -> FloatArray:
        """x, y, yaw [m, m, rad]."""
        return np.array([self._x, self._y, self._yaw])

    @property
    def twist(self) -> FloatArray:
        """v, w or vx, vy, w [m/s, rad/s]."""
        side = [self._u] if self._goes_sideways else []
        return np.array([self._v, *side, self._w])

    def move(self, command: tuple[float, ...], seconds: float) -> None:
        """Follow ``command`` for a while, in steps of 10 ms."""
        dt, keep = 0.01, self._keep
        du = getattr(self._limits, "lateral_acceleration", 0.0) * dt
        to_the_side = command[1] if self._goes_sideways else 0.0
        dv = self._limits.linear_acceleration * dt
        dw = self._limits.angular_acceleration * dt
        for _ in range(round(seconds / dt)):
            self._v += min(max((command[0] - self._v) * (1.0 - keep), -dv), dv)
            self._w += min(max((command[-1] - self._w) * (1.0 - keep), -dw), dw)
            self._u += min(max((to_the_side - self._u) * (1.0 - keep), -du), du)
            heading = self._yaw + 0.5 * self._w * dt
            self._x += self._v * dt * math.cos(heading)
            self._y += self._v * dt * math.sin(heading)
            self._x -= self._u * dt * math.sin(heading)
            self._y += self._u * dt * math.cos(heading)
            self._yaw += self._w * dt


def cast(discs: FloatArray, pose: FloatArray, robot: RobotSpec) -> NDArray[np.float32]:
    """Return the ranges (num_beams,) that a robot at ``pose`` sees among discs (n, 3)."""
    cos, sin, mount = math.cos(pose[2]), math.sin(pose[2]), robot.lidar
    offset = (cos * mount.x - sin * mount.y, sin * mount.x + cos * mount.y, mount.yaw)
    pose = pose + np.array(offset)
    angles = robot.lidar.angles + pose[2]
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    offset = discs[:, :2] - pose[:2]
    along = direction @ offset.T
    apart = (offset**2).sum(axis=1) - along**2
    half = np.sqrt(np.maximum(discs[:, 2] ** 2 - apart, 0.0))
    hit = (apart < discs[:, 2] ** 2) & (along - half > 0.0)
    ranges = np.where(hit, along - half, np.inf).min(axis=1, initial=np.inf)
    ranges[ranges > robot.lidar.range_max] = np.inf
    ranges[ranges < robot.lidar.range_min] = -np.inf
    return ranges.astype(np.float32)


def outside(robot: RobotSpec, points: FloatArray, pose: FloatArray) -> FloatArray:
    """Return how far points (n, 2) are from the outline at ``pose`` [m]; negative inside."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = points[:, 0] - pose[0], points[:, 1] - pose[1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    if robot.footprint.shape == "circle":
        return np.hypot(x, y) - robot.footprint.radius
    corners = np.array(robot.footprint.vertices)
    distance, inside = np.full(len(points), np.inf), np.ones(len(points), dtype=bool)
    for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        ex, ey = x2 - x1, y2 - y1
        share = np.clip(((x - x1) * ex + (y - y1) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
        distance = np.minimum(distance, np.hypot(x - x1 - share * ex, y - y1 - share * ey))
        inside &= ex * (y - y1) - ey * (x - x1) >= 0.0
    return np.where(inside, -distance, distance)
