# SPDX-License-Identifier: Apache-2.0
"""Actions in [-1, 1] and the velocity commands they stand for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pm01_nav.arrays import array_namespace


@dataclass(frozen=True)
class ActionLimits:
    """What an action of -1 and of +1 means; zero lies halfway between."""

    linear_min: float
    """[m/s]"""
    linear_max: float
    """[m/s]"""
    angular_max: float
    """To either side [rad/s]."""

    def to_command(self, action: Any) -> Any:
        """Return (v, w) [m/s, rad/s] of actions (..., 2) in [-1, 1]."""
        xp = array_namespace(action)
        half = 0.5 * (self.linear_max - self.linear_min)
        command = xp.empty_like(action)
        command[..., 0] = half * action[..., 0] + (self.linear_min + half)
        command[..., 1] = self.angular_max * action[..., 1]
        return command

    def to_action(self, command: Any) -> Any:
        """Return the actions (..., 2) that stand for commands (..., 2) within the limits."""
        xp = array_namespace(command)
        half = 0.5 * (self.linear_max - self.linear_min)
        linear = (command[..., 0] - self.linear_min) / half - 1.0
        return xp.clip(xp.stack([linear, command[..., 1] / self.angular_max], axis=-1), -1.0, 1.0)
