# SPDX-License-Identifier: Apache-2.0
"""Places to drive to, one after the other, and the heading at the last of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pm01_nav.errors import InputError

if TYPE_CHECKING:
    from pm01_nav.drives import Drive

BRAKING_SHARE = 0.5
"""Of the angular acceleration is planned with at the end of a turn: a base lags behind."""


@dataclass(frozen=True)
class Goal:
    """Where to go, in the odometry frame [m], and with ``yaw`` [rad] which way to face there."""

    x: float
    y: float
    yaw: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no place.

        Raises:
            InputError: a number is not finite.
        """
        if not (math.isfinite(self.x) and math.isfinite(self.y)):
            raise InputError(f"goal = ({self.x}, {self.y}): must be two finite numbers")
        if self.yaw is not None and not math.isfinite(self.yaw):
            raise InputError(f"goal's yaw = {self.yaw}: must be finite")


def turn_rate(error: float, drive: Drive, control_dt: float) -> float:
    """Return how fast to turn on the spot [rad/s] when ``error`` [rad] is left to turn.

    It is the fastest rate from which the robot comes to rest within what is left, and which does
    not pass it within ``control_dt`` [s].
    """
    braking = BRAKING_SHARE * drive.acceleration[-1]
    fastest = min(drive.angular_max, math.sqrt(2.0 * braking * abs(error)))
    return math.copysign(min(fastest, abs(error) / control_dt), error)
