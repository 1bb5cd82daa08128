# SPDX-License-Identifier: Apache-2.0
"""VFH+: steer into the best opening of a polar histogram of obstacles.

I. Ulrich, J. Borenstein, "VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots", ICRA 1998. A
differential-drive robot turns on the spot, so that no direction is masked by its turning circle.
The target direction is that of a point ahead on a plan.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.planners.guided import GuidedPlanner, GuideParams, Situation
from pm01_nav.planners.rolling_costmap import reading
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]


class VFHParams(FrozenModel):
    """Parameters of VFH+."""

    guide: GuideParams = GuideParams()
    look_ahead: float = Field(gt=0.0)
    """Of the plan's point that gives the target direction [m]."""
    sectors: int = Field(ge=8)
    """Of the histogram."""
    active_range: float = Field(gt=0.0)
    """Returns further away do not count [m]."""
    safety: float = Field(ge=0.0)
    """Obstacles are enlarged by the robot's radius and this [m]."""
    free_below: float = Field(ge=0.0)
    """A sector that was blocked is free again with a density below this ..."""
    blocked_above: float = Field(ge=0.0)
    """... and a free one is blocked above this; 1 is an obstacle at the robot's place."""
    wide: int = Field(ge=2)
    """An opening of so many sectors or more is wide: one keeps to its side nearest the target."""
    target_weight: float = Field(ge=0.0)
    heading_weight: float = Field(ge=0.0)
    previous_weight: float = Field(ge=0.0)
    """Prices of a candidate's angle to the target, to the heading and to the last choice."""
    turn_gain: float = Field(gt=0.0)
    """Turn rate per radian [1/s]."""
    rotate_angle: float = Field(gt=0.0)
    """A direction further to the side is turned to on the spot [rad]."""
    least_speed: float = Field(ge=0.0, le=1.0)
    """Beside obstacles, of the robot's greatest."""


class VFH(GuidedPlanner):
    """Choose among the openings."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: VFHParams) -> None:
        """Drive a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        self.params = params
        lidar = robot.lidar
        self._directions = lidar.angles + lidar.yaw
        self._mount = (lidar.x, lidar.y, lidar.range_min)
        self._blocked = np.zeros((0, params.sectors), dtype=np.bool_)
        self._chosen = np.zeros(0)

    def reset(self) -> None:
        """Forget maps, plans and the last choices."""
        super().reset()
        self._blocked = self._blocked[:0]

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        super().keep(robots)
        self._blocked, self._chosen = self._blocked[robots], self._chosen[robots]

    def command(self, situation: Situation) -> FloatArray:
        """Turn to the best opening; slower the more is in the way."""
        params, limits, count = self.params, self.robot.limits, len(situation.carrot)
        if len(self._blocked) != count:
            self._blocked = np.zeros((count, params.sectors), dtype=np.bool_)
            self._chosen = np.zeros(count)
        radius = self.robot.footprint.circumscribed_radius + params.safety
        density = np.zeros(self._blocked.shape)
        reach = (params.active_range, radius)
        _fill(density, situation.scan, self._directions, self._mount, reach)
        self._blocked = np.where(
            self._blocked, density >= params.free_below, density > params.blocked_above
        )
        target = np.arctan2(situation.carrot[:, 1], situation.carrot[:, 0])
        weights = (params.target_weight, params.heading_weight, params.previous_weight)
        _steer(self._blocked, target, self._chosen, params.wide, weights)
        ahead = density[:, params.sectors // 2 - 1 : params.sectors // 2 + 1].max(axis=1)
        speed = np.maximum(1.0 - ahead / params.blocked_above, params.least_speed)
        direction = self._chosen
        angular = np.clip(params.turn_gain * direction, -limits.angular_max, limits.angular_max)
        speed = speed * np.maximum(1.0 - np.abs(direction) / params.rotate_angle, 0.0)
        stuck = self._blocked.all(axis=1)
        angular = np.where(stuck, limits.angular_max, angular)
        return np.stack([np.where(stuck, 0.0, limits.linear_max * speed), angular], axis=-1)


@compiled
def _fill(density, scan, directions, mount, reach):
    """Enter the returns into the primary histograms; sector 0 begins behind the robot.

    A return blocks the sectors under which a disc of the enlarged robot's radius around it is
    seen. Of several the densest counts, so that the density does not depend on the beams' number.
    """
    sectors = density.shape[1]
    active_range, radius = reach
    for i in range(scan.shape[0]):
        for k in range(scan.shape[1]):
            length = reading(scan[i, k], mount[2])
            if length < 0.0 or length == np.inf:
                continue
            x = mount[0] + length * np.cos(directions[k])
            y = mount[1] + length * np.sin(directions[k])
            distance = np.sqrt(x * x + y * y)
            if distance >= active_range:
                continue
            here = max(1.0 - max(distance - radius, 0.0) / (active_range - radius), 0.0)
            half = np.arcsin(min(radius / max(distance, 1e-6), 1.0))
            middle = np.arctan2(y, x)
            first = int(np.floor((middle - half + np.pi) / (2.0 * np.pi) * sectors))
            last = int(np.floor((middle + half + np.pi) / (2.0 * np.pi) * sectors))
            for s in range(first, last + 1):
                density[i, s % sectors] = max(density[i, s % sectors], here)


@compiled
def _steer(blocked, target, chosen, wide, weights):
    """Replace each robot's choice by the cheapest candidate direction [rad]."""
    sectors = blocked.shape[1]
    size = 2.0 * np.pi / sectors
    for i in range(blocked.shape[0]):
        best, direction = np.inf, target[i]
        some = False
        for s in range(sectors):
            some = some or blocked[i, s]
        if not some:
            chosen[i] = target[i]
            continue
        for s in range(sectors):
            if blocked[i, s] or not blocked[i, s - 1]:
                continue
            length = 1  # s is the right border of an opening.
            while not blocked[i, (s + length) % sectors]:
                length += 1
            right, left = (s + 0.5) * size - np.pi, (s + length - 0.5) * size - np.pi
            for c in range(3):
                if length < wide:
                    candidate = 0.5 * (right + left)
                elif c == 0:
                    candidate = right + 0.5 * (wide - 1) * size
                elif c == 1:
                    candidate = left - 0.5 * (wide - 1) * size
                else:
                    candidate = target[i]
                    offset = (candidate - right) % (2.0 * np.pi)
                    if offset > left - right:
                        continue
                cost = weights[0] * apart(candidate, target[i])
                cost += weights[1] * apart(candidate, 0.0)
                cost += weights[2] * apart(candidate, chosen[i])
                if cost < best:
                    best, direction = cost, candidate
        chosen[i] = (direction + np.pi) % (2.0 * np.pi) - np.pi


@compiled
def apart(one, other):
    """Return the angle between two directions [rad], 0 to pi."""
    return abs((one - other + np.pi) % (2.0 * np.pi) - np.pi)
