# SPDX-License-Identifier: Apache-2.0
"""Follow the gap: steer between the middle of the widest gap and the goal.

V. Sezer, M. Gokasan, "A novel obstacle avoidance algorithm: 'Follow the Gap Method'", Robotics and
Autonomous Systems 60 (9), 2012. It needs neither a map nor a memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.planners.rolling_costmap import reading
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]
DIRECTIONS = 180
"""Directions that are looked at, evenly around the robot."""


class GapFollowingParams(FrozenModel):
    """Parameters of follow the gap."""

    reach: float = Field(gt=0.0)
    """A direction is open if nothing is nearer than this, or than the goal [m]."""
    safety: float = Field(ge=0.0)
    """Obstacles are enlarged by the robot's radius and this [m]."""
    gap_weight: float = Field(ge=0.0)
    """The gap's middle counts this much by the goal, over the least clearance in metres."""
    field_of_view: float = Field(gt=0.0)
    """Only gaps no further to either side of the heading are followed [rad]."""
    turn_gain: float = Field(gt=0.0)
    """Turn rate per radian [1/s]."""
    rotate_angle: float = Field(gt=0.0)
    """A direction further to the side is turned to on the spot [rad]."""
    slow_distance: float = Field(gt=0.0)
    """Obstacles ahead that are nearer to the footprint slow down in proportion [m]."""
    least_speed: float = Field(ge=0.0, le=1.0)
    """Of the robot's greatest."""


class GapFollowing:
    """Steer into gaps, by the present scan alone."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: GapFollowingParams) -> None:
        """Drive a robot; ``control_dt`` [s] does not matter."""
        self.robot, self.params = robot, params
        lidar = robot.lidar
        self._directions = lidar.angles + lidar.yaw
        self._mount = (lidar.x, lidar.y, lidar.range_min)

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Do nothing: there is no memory."""

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> FloatArray:
        """Return (v, w) [m/s, rad/s]; see ``Policy.act``."""
        goal = np.asarray(goal, dtype=np.float64)
        goals = goal.reshape(-1, 2)
        scans = np.asarray(scan, dtype=np.float64).reshape(len(goals), -1)
        params, limits = self.params, self.robot.limits
        radius = self.robot.footprint.circumscribed_radius + params.safety
        free = np.empty((len(goals), DIRECTIONS))
        _look_around(free, scans, self._directions, self._mount, radius)
        direction = np.zeros(len(goals))
        _choose(free, goals, (params.reach, params.gap_weight, params.field_of_view), direction)
        angular = np.clip(params.turn_gain * direction, -limits.angular_max, limits.angular_max)
        middle = DIRECTIONS // 2
        ahead = free[:, middle - 8 : middle + 9].min(axis=1) - radius
        speed = np.clip(ahead / params.slow_distance, params.least_speed, 1.0)
        speed *= np.maximum(1.0 - np.abs(direction) / params.rotate_angle, 0.0)
        return np.stack([limits.linear_max * speed, angular], axis=-1).reshape(goal.shape)


@compiled
def _look_around(free, scan, directions, mount, radius):
    """Write how far the centre of a disc of ``radius`` [m] is free in each direction [m].

    Each return closes the directions in which the disc would touch it; direction 0 is behind.
    """
    count = free.shape[1]
    for i in range(scan.shape[0]):
        for k in range(count):
            free[i, k] = np.inf
        for k in range(scan.shape[1]):
            length = reading(scan[i, k], mount[2])
            if length < 0.0 or length == np.inf:
                continue
            x = mount[0] + length * np.cos(directions[k])
            y = mount[1] + length * np.sin(directions[k])
            distance = np.sqrt(x * x + y * y)
            half = np.arcsin(min(radius / max(distance, 1e-6), 1.0))
            middle = np.arctan2(y, x)
            first = int(np.ceil((middle - half + np.pi) / (2.0 * np.pi) * count))
            last = int(np.floor((middle + half + np.pi) / (2.0 * np.pi) * count))
            for s in range(first, last + 1):
                free[i, s % count] = min(free[i, s % count], distance)


@compiled
def _choose(free, goals, settings, direction):
    """Write each robot's direction [rad]: between the widest gap's middle and the goal's (eq. 13).

    Without a gap it turns to the left.
    """
    reach, weight, view = settings
    count = free.shape[1]
    size = 2.0 * np.pi / count
    for i in range(free.shape[0]):
        away = np.sqrt(goals[i, 0] ** 2 + goals[i, 1] ** 2)
        bearing = np.arctan2(goals[i, 1], goals[i, 0])
        limit = min(reach, away)
        straight = int(np.round((bearing + np.pi) / size)) % count
        nearest = np.inf
        for k in range(count):
            nearest = min(nearest, free[i, k])
        if free[i, straight] >= limit:
            direction[i] = bearing
            continue
        begin, end = int((np.pi - view) / size), int((np.pi + view) / size)
        best, middle = 0, np.pi
        length = 0
        for k in range(max(begin, 0), min(end, count - 1) + 1):
            length = length + 1 if free[i, k] >= limit else 0
            if length > best:
                best, middle = length, (k - 0.5 * (length - 1)) * size - np.pi
        if best == 0:
            direction[i] = np.pi / 2.0
        elif abs(bearing) > view:
            direction[i] = middle
        else:
            ratio = weight / max(nearest, 1e-3)
            direction[i] = (ratio * middle + bearing) / (ratio + 1.0)
