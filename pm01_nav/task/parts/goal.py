# SPDX-License-Identifier: Apache-2.0
"""Where the goal is in base_link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pm01_nav.arrays import array_namespace
from pm01_nav.task.parts.base import ObservationPart, Seen, observation_part


@observation_part
@dataclass(frozen=True)
class GoalDistance(ObservationPart):
    """Distance of the goal [m]."""

    name = "goal_distance"
    unit = "m"

    maximum: float = 10.0
    """A goal further away than this is shown at this distance [m]."""

    @property
    def bounds(self) -> tuple[float, float]:
        """From 0 to the greatest that is shown."""
        return 0.0, self.maximum

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the distance."""
        return (array_namespace(seen.goal).minimum(seen.goal[..., 0], self.maximum),)


@observation_part
@dataclass(frozen=True)
class GoalBearing(ObservationPart):
    """Direction of the goal [rad]."""

    name = "goal_bearing"
    unit = "rad"

    @property
    def bounds(self) -> tuple[float, float]:
        """Half a turn to both sides."""
        return -math.pi, math.pi

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the bearing."""
        return (seen.goal[..., 1],)


@observation_part
@dataclass(frozen=True)
class GoalSinCos(ObservationPart):
    """Sine and cosine of the direction of the goal."""

    name = "goal_sin_cos"

    @property
    def shape(self) -> tuple[int, ...]:
        """Two numbers."""
        return (2,)

    @property
    def bounds(self) -> tuple[float, float]:
        """Those of a sine."""
        return -1.0, 1.0

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return sine and cosine."""
        xp, bearing = array_namespace(seen.goal), seen.goal[..., 1]
        return xp.sin(bearing), xp.cos(bearing)
