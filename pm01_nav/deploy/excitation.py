# SPDX-License-Identifier: Apache-2.0
"""A drive that shows what a robot is: steps of speed and turn to all sides, and rests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.drives import DRIVES
from pm01_nav.errors import InputError

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec

HOLD_S = (0.4, 1.6)
"""A command is held for U(HOLD_S) [s]: long enough to reach it, short enough not to go far."""
REST_SHARE = 0.25
"""So many commands are rests, in which the lidar's noise shows."""


def check_identifiable(robot: RobotSpec) -> None:
    """Refuse a robot for whose drive there is no model.

    Raises:
        InputError: there is none; it names the drives that have one.
    """
    if DRIVES[robot.drive].identified_by is None:
        able = ", ".join(name for name, kind in sorted(DRIVES.items()) if kind.identified_by)
        raise InputError(
            f"robot {robot.name}: the drive {robot.drive} cannot be identified; can be: {able}"
        )


class Excitation:
    """Stands where a policy stands, so the supervisor watches over it."""

    def __init__(self, robot: RobotSpec, control_dt: float, seed: int = 0) -> None:
        """Draw commands within the limits of ``robot``, one every ``control_dt`` [s].

        Raises:
            InputError: its drive cannot be identified.
        """
        check_identifiable(robot)
        self._limits = robot.limits
        self._dt = control_dt
        self._rng = np.random.default_rng(seed)
        self._left = 0
        self._command = np.zeros(2)

    def reset(self) -> None:
        """Forget nothing: the program goes on."""

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Drive one robot only."""

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return the program's command, (2,): v, w [m/s, rad/s]."""
        if self._left == 0:
            self._left = max(1, round(self._rng.uniform(*HOLD_S) / self._dt))
            self._command = self._draw()
        self._left -= 1
        return self._command

    def _draw(self) -> NDArray[np.float64]:
        limits, rng = self._limits, self._rng
        if rng.random() < REST_SHARE:
            return np.zeros(2)
        # Ahead or back with equal chances, at U(0.3, 1) of the limit; turns likewise, or none.
        furthest = limits.linear_max if rng.random() < 0.5 else limits.linear_min
        v = rng.uniform(0.3, 1.0) * furthest
        w = rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.3, 1.0) * limits.angular_max
        return np.array([v, w])
