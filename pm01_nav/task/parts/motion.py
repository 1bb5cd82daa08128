# SPDX-License-Identifier: Apache-2.0
"""How the robot moves, and what it was told to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pm01_nav.arrays import array_namespace
from pm01_nav.task.parts.base import ObservationPart, Seen, clip, observation_part


@observation_part
@dataclass(frozen=True)
class LinearVelocity(ObservationPart):
    """Measured v [m/s]."""

    name = "linear_velocity"
    unit = "m/s"

    @property
    def bounds(self) -> tuple[float, float]:
        """The robot's limits."""
        return self.limits.linear_min, self.limits.linear_max

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return v."""
        return (clip(array_namespace(seen.goal), seen.velocity[..., 0], *self.bounds),)


@observation_part
@dataclass(frozen=True)
class AngularVelocity(ObservationPart):
    """Measured w [rad/s]."""

    name = "angular_velocity"
    unit = "rad/s"

    @property
    def bounds(self) -> tuple[float, float]:
        """The robot's limits."""
        return -self.limits.angular_max, self.limits.angular_max

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return w."""
        return (clip(array_namespace(seen.goal), seen.velocity[..., 1], *self.bounds),)


@observation_part
@dataclass(frozen=True)
class PreviousAction(ObservationPart):
    """The last action; 0 at the start of an episode."""

    name = "previous_action"

    @property
    def shape(self) -> tuple[int, ...]:
        """V and w."""
        return (2,)

    @property
    def bounds(self) -> tuple[float, float]:
        """Those of actions."""
        return -1.0, 1.0

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return both numbers of the action."""
        return seen.previous_action[..., 0], seen.previous_action[..., 1]
