# SPDX-License-Identifier: Apache-2.0
"""Follow the gap: steer between the middle of the widest gap and the goal.

V. Sezer, M. Gokasan, "A novel obstacle avoidance algorithm: 'Follow the Gap Method'", Robotics and
Autonomous Systems 60 (9), 2012. It needs neither a map nor a memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.planners.polar import PolarView, turn_to
from pm01_nav.planners.registry import planner
from pm01_nav.planners.scan_planner import ScanPlanner, clean_ranges
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]
SECTORS = 180
"""Sectors that are looked at, evenly around the robot."""
SIZE = 2.0 * np.pi / SECTORS
AHEAD = 8
"""So many sectors to either side lie ahead."""


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


@planner("gap_following", GapFollowingParams)
class GapFollowing(ScanPlanner):
    """Steer into gaps, by the present scan alone."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: GapFollowingParams) -> None:
        """Drive a robot; ``control_dt`` [s] does not matter."""
        super().__init__(robot)
        self.params = params
        self._view = PolarView(robot, SECTORS, params.safety)

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Do nothing: there is no memory."""

    def plan(self, scan: NDArray[np.float32], goal: FloatArray, velocity: FloatArray) -> FloatArray:
        """Turn to the gap; slower the less is free ahead."""
        params, limits = self.params, self.robot.limits
        free = self._view(clean_ranges(scan, self.geometry))
        direction = np.zeros(len(goal))
        _choose(free, goal, (params.reach, params.gap_weight, params.field_of_view), direction)
        middle = SECTORS // 2
        ahead = free[:, middle - AHEAD : middle + AHEAD].min(axis=1) - self._view.radius
        speed = limits.linear_max * np.clip(ahead / params.slow_distance, params.least_speed, 1.0)
        return turn_to(direction, speed, limits, params.turn_gain, params.rotate_angle)


@compiled
def _choose(free, goals, settings, direction):
    """Write each robot's direction [rad]: between the widest gap's middle and the goal's (eq. 13).

    Without a gap it turns to the left.
    """
    reach, weight, view = settings
    for i in range(free.shape[0]):
        away = np.sqrt(goals[i, 0] ** 2 + goals[i, 1] ** 2)
        bearing = np.arctan2(goals[i, 1], goals[i, 0])
        limit = min(reach, away)
        straight = int((bearing + np.pi) / SIZE) % SECTORS
        length, middle = _widest_gap(free, i, limit, view)
        if free[i, straight] >= limit:
            direction[i] = bearing
        elif length == 0:
            direction[i] = np.pi / 2.0
        elif abs(bearing) > view:
            direction[i] = middle
        else:
            nearest = np.inf
            for s in range(SECTORS):
                nearest = min(nearest, free[i, s])
            ratio = weight / max(nearest, 1e-3)
            direction[i] = (ratio * middle + bearing) / (ratio + 1.0)


@compiled
def _widest_gap(free, i, limit, view):
    """Return the widest gap within ``view`` [rad] of the heading: its sectors, its middle [rad]."""
    begin, end = int((np.pi - view) / SIZE), int((np.pi + view) / SIZE)
    best, middle, length = 0, 0.0, 0
    for k in range(max(begin, 0), min(end, SECTORS - 1) + 1):
        length = length + 1 if free[i, k] >= limit else 0
        if length > best:
            best, middle = length, (k + 1 - 0.5 * length) * SIZE - np.pi
    return best, middle
