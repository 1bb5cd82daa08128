# SPDX-License-Identifier: Apache-2.0
"""Drive straight at the goal, blind to obstacles: the floor that any other policy must beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec


class GoalSeekingParams(FrozenModel):
    """Parameters of goal seeking."""

    turn_gain: float = Field(gt=0.0)
    """Turn rate per radian of bearing [1/s]."""


@planner("goal_seeking", GoalSeekingParams)
class GoalSeeking:
    """Turn towards the goal, and drive the faster the better it lies ahead."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: GoalSeekingParams) -> None:
        """Drive within the robot's limits; ``control_dt`` [s] does not matter."""
        self._drive, self._gain = robot.base, params.turn_gain

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Do nothing: there is no memory."""

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return commands [m/s, rad/s]; see ``Policy.act``. They do not go sideways."""
        goal = np.asarray(goal, dtype=np.float64)
        bearing = np.arctan2(goal[..., 1], goal[..., 0])
        drive = self._drive
        linear = drive.linear_max * np.maximum(np.cos(bearing), 0.0)
        angular = np.clip(self._gain * bearing, -drive.angular_max, drive.angular_max)
        return drive.from_unicycle(np.stack([linear, angular], axis=-1))
