# SPDX-License-Identifier: Apache-2.0
"""The wheel controller of a differential drive: twist commands in, wheel speeds out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]


class WheelController:
    """What a robot's firmware does: it keeps the limits, and ramps the speeds of its wheels.

    Limits and lag act on v and w as in the planar simulator, at ``ticks`` set points in a control
    step.
    """

    def __init__(self, robot: RobotSpec, num_envs: int, control_dt: float, ticks: int) -> None:
        """Stand still; ``control_dt`` [s] is the time between commands."""
        limits, lag, dt = robot.limits, robot.actuator.lag_s, control_dt / ticks
        self._ticks = ticks
        self._low = np.array([limits.linear_min, -limits.angular_max])
        self._high = np.array([limits.linear_max, limits.angular_max])
        self._change = dt * np.array([limits.linear_acceleration, limits.angular_acceleration])
        self._keep = math.exp(-dt / lag) if lag > 0.0 else 0.0
        half = robot.driven_wheels.separation / 2.0
        # w to the left turns the right wheel faster.
        self._to_wheels = np.array([[1.0, 1.0], [-half, half]]) / robot.driven_wheels.radius
        self.twist: FloatArray = np.zeros((num_envs, 2))
        """v and w that the wheels are to have by now [m/s, rad/s]."""

    def wheel_speeds(self, command: FloatArray) -> FloatArray:
        """Answer commands (num_envs, 2) [m/s, rad/s] for one control step.

        Returns the speeds of left and right wheel in each tick [rad/s], (ticks, num_envs, 2).
        """
        command = np.clip(command, self._low, self._high)
        speeds = np.empty((self._ticks, *command.shape))
        for tick in range(self._ticks):
            wanted = command + (self.twist - command) * self._keep
            change = np.clip(wanted - self.twist, -self._change, self._change)
            # What a speed that ramps is on average.
            speeds[tick] = (self.twist + 0.5 * change) @ self._to_wheels
            self.twist = self.twist + change
        return speeds
