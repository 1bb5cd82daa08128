# SPDX-License-Identifier: Apache-2.0
"""How the robot moves, and what it was told to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from pm01_nav.arrays import array_namespace
from pm01_nav.drives import AxisName
from pm01_nav.task.parts.base import ObservationPart, Seen, clip, observation_part


@dataclass(frozen=True)
class Velocity(ObservationPart):
    """Measured speed of one of the drive's axes."""

    axis: ClassVar[AxisName]

    @property
    def bounds(self) -> tuple[float, float]:
        """The robot's limits."""
        return self.drive.bounds(self.axis)

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the speed."""
        speed = seen.velocity[..., self.drive.axes.index(self.axis)]
        return (clip(array_namespace(seen.goal), speed, *self.bounds),)


@observation_part
@dataclass(frozen=True)
class LinearVelocity(Velocity):
    """Measured speed forwards [m/s]."""

    name = "linear_velocity"
    unit = "m/s"
    axis = "x"


@observation_part
@dataclass(frozen=True)
class LateralVelocity(Velocity):
    """Measured speed to the left [m/s], of a base that can go there."""

    name = "lateral_velocity"
    unit = "m/s"
    axis = "y"


@observation_part
@dataclass(frozen=True)
class AngularVelocity(Velocity):
    """Measured w [rad/s]."""

    name = "angular_velocity"
    unit = "rad/s"
    axis = "yaw"


@observation_part
@dataclass(frozen=True)
class PreviousAction(ObservationPart):
    """The last action; 0 at the start of an episode."""

    name = "previous_action"

    @property
    def shape(self) -> tuple[int, ...]:
        """A number for each axis."""
        return (self.drive.size,)

    @property
    def bounds(self) -> tuple[float, float]:
        """Those of actions."""
        return -1.0, 1.0

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the numbers of the action."""
        return tuple(seen.previous_action[..., k] for k in range(self.drive.size))
