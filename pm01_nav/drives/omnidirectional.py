# SPDX-License-Identifier: Apache-2.0
"""A base that moves in any direction and turns as it likes, as on Mecanum or omni wheels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from pm01_nav.drives.base import BOX, ELLIPSE, AxisName, Drive, FloatArray, drive

Shape = Literal["box", "ellipse"]


@drive
@dataclass(frozen=True)
class OmnidirectionalDrive(Drive):
    """Commands are vx, vy and w [m/s, m/s, rad/s]."""

    name = "omnidirectional"
    axes = ("x", "y", "yaw")
    has_wheels = False

    lateral_max: float
    shape: Shape = "ellipse"

    @classmethod
    def _accelerations(cls, limits: Any) -> tuple[float, ...]:
        return limits.linear_acceleration, limits.lateral_acceleration, limits.angular_acceleration

    def _bounds(self) -> dict[AxisName, tuple[float, float]]:
        return {**super()._bounds(), "y": (-self.lateral_max, self.lateral_max)}

    @property
    def envelope(self) -> int:
        """How the speeds of the axes limit each other."""
        return ELLIPSE if self.shape == "ellipse" else BOX

    @cached_property
    def top_speed(self) -> float:
        """How fast the base can travel in any direction [m/s]."""
        x, y, _ = self.fastest
        return float(max(x, y) if self.shape == "ellipse" else np.hypot(x, y))

    def clip(self, command: FloatArray) -> FloatArray:
        """Return the commands (..., 3) that the base really follows, in the same direction."""
        command = super().clip(command)
        if self.shape == "box":
            return command
        x, y = command[..., 0], command[..., 1]
        # A base that cannot go backwards has no such half of the ellipse: there x is 0.
        reach_x = np.where(x < 0.0, -self.linear_min or 1.0, self.linear_max)
        excess = np.maximum(np.hypot(x / reach_x, y / self.lateral_max), 1.0)
        return np.stack([x / excess, y / excess, command[..., 2]], axis=-1)
