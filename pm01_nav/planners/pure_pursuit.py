# SPDX-License-Identifier: Apache-2.0
"""Pure pursuit: the arc to a point some way ahead on the path.

R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992.
The path is planned with A* over a rolling costmap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.planners.guided import GuidedPlanner, GuideParams, Situation
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]


class PurePursuitParams(FrozenModel):
    """Parameters of pure pursuit."""

    guide: GuideParams = GuideParams()
    look_ahead: float = Field(gt=0.0)
    """Of the point that is pursued [m]."""
    speed: float = Field(gt=0.0, le=1.0)
    """Of the robot's greatest."""
    rotate_angle: float = Field(gt=0.0)
    """With the point further to the side the robot turns on the spot [rad]."""
    rotate_gain: float = Field(gt=0.0)
    """Turn rate per radian while it does [1/s]."""


@planner("pure_pursuit", PurePursuitParams)
class PurePursuit(GuidedPlanner):
    """Follow the plan at full speed."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: PurePursuitParams) -> None:
        """Follow plans with a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        self.params = params

    def command(self, situation: Situation) -> FloatArray:
        """Return the arcs to the carrots."""
        limits, carrot = self.robot.limits, situation.carrot
        speed = np.full(len(carrot), self.params.speed * limits.linear_max)
        return pursue(carrot, speed, limits.angular_max, self.params)


def pursue(
    carrot: FloatArray, speed: FloatArray, angular_max: float, params: PurePursuitParams
) -> FloatArray:
    """Return commands (n, 2) on the arcs to points (n, 2) at up to some speed (n,) [m/s].

    An arc that is tighter than the greatest turn rate allows is driven slower.
    """
    bearing = np.arctan2(carrot[:, 1], carrot[:, 0])
    squared = np.maximum((carrot**2).sum(axis=1), 1e-6)
    curvature = 2.0 * carrot[:, 1] / squared
    linear = np.minimum(speed, angular_max / np.maximum(np.abs(curvature), 1e-9))
    angular = linear * curvature
    aside = np.abs(bearing) > params.rotate_angle
    turning = np.clip(params.rotate_gain * bearing, -angular_max, angular_max)
    return np.stack([np.where(aside, 0.0, linear), np.where(aside, turning, angular)], axis=-1)
