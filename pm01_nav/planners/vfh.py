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
from pm01_nav.planners.polar import PolarView, turn_to
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.dynamics import wrap

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


@planner("vfh", VFHParams)
class VFH(GuidedPlanner):
    """Choose among the openings."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: VFHParams) -> None:
        """Drive a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        self.params = params
        self._view = PolarView(robot, params.sectors, params.safety)
        self._weights = (params.target_weight, params.heading_weight, params.previous_weight)

    def begin(self, count: int) -> None:
        """Begin maps and plans; all sectors are free, and every robot heads straight on."""
        super().begin(count)
        self._blocked = np.zeros((count, self.params.sectors), dtype=np.bool_)
        self._chosen = np.zeros(count)

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        super().keep(robots)
        self._blocked, self._chosen = self._blocked[robots], self._chosen[robots]

    def command(self, situation: Situation) -> FloatArray:
        """Turn to the best opening; slower the more is in the way."""
        params, limits = self.params, self.robot.limits
        density = self._density(self._view(situation.scan))
        self._blocked = np.where(
            self._blocked, density >= params.free_below, density > params.blocked_above
        )
        target = np.arctan2(situation.carrot[:, 1], situation.carrot[:, 0])
        _steer(self._blocked, target, self._chosen, params.wide, self._weights)
        ahead = density[:, params.sectors // 2 - 1 : params.sectors // 2 + 1].max(axis=1)
        speed = np.maximum(1.0 - ahead / params.blocked_above, params.least_speed)
        speed *= limits.linear_max
        command = turn_to(self._chosen, speed, limits, params.turn_gain, params.rotate_angle)
        command[self._blocked.all(axis=1)] = (0.0, limits.angular_max)
        return command

    def _density(self, nearest: FloatArray) -> FloatArray:
        """Return the primary histograms (n, sectors): 1 in contact, 0 from ``active_range`` on.

        Of several returns in a sector the nearest counts, so that the density does not depend on
        the number of beams.
        """
        radius, reach = self._view.radius, self.params.active_range
        gap = np.maximum(nearest - radius, 0.0)
        return np.maximum(1.0 - gap / (reach - radius), 0.0)


@compiled
def _steer(blocked, target, chosen, wide, weights):
    """Replace each robot's choice by the cheapest candidate direction [rad]."""
    sectors = blocked.shape[1]
    size = 2.0 * np.pi / sectors
    for i in range(blocked.shape[0]):
        best, direction = np.inf, target[i]
        for s in range(sectors):
            if blocked[i, s] or not blocked[i, s - 1]:
                continue  # s is not the right border of an opening.
            length = 1
            while not blocked[i, (s + length) % sectors]:
                length += 1
            right, left = (s + 0.5) * size - np.pi, (s + length - 0.5) * size - np.pi
            side = 0.5 * (wide - 1) * size if length >= wide else 0.5 * (left - right)
            # A narrow opening has no other candidate than its middle.
            third = target[i] if length >= wide else right + side
            for candidate in (right + side, left - side, third):
                if (candidate - right) % (2.0 * np.pi) <= left - right:
                    cost = _price(candidate, target[i], chosen[i], weights)
                    if cost < best:
                        best, direction = cost, candidate
        chosen[i] = wrap(direction)


@compiled
def _price(candidate, target, previous, weights):
    """Return what a direction costs by its angles to the target, the heading and the last choice.

    Ulrich and Borenstein 1998, eq. 9.
    """
    cost = weights[0] * abs(wrap(candidate - target))
    return cost + weights[1] * abs(wrap(candidate)) + weights[2] * abs(wrap(candidate - previous))
