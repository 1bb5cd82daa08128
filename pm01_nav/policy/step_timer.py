# SPDX-License-Identifier: Apache-2.0
"""How much time went by, and how far a robot came, from one call of ``act`` to the next.

A memory that counts calls believes that each came one control step after the last. On a robot they
come late now and then, and none comes while a fault makes it stand.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import relative_pose
from pm01_nav.policy.inputs import finite_numbers
from pm01_nav.task.parts import Elapsed

FloatArray = NDArray[np.float64]

PAUSE_STEPS = 2.0
"""More control steps than this between two calls are a pause: what lies between is unknown."""
ROUNDING = 1e-6
"""Of a difference of two times, in control steps."""


class StepTimer:
    """Time the calls of one policy."""

    def __init__(self, control_dt: float) -> None:
        """Expect a call every ``control_dt`` [s]."""
        self._dt = control_dt
        self.reset()

    def reset(self) -> None:
        """Begin anew: what was before the next call does not count."""
        self._now: float | None = None
        self._pose: FloatArray | None = None
        self._ahead = 0.0

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        if self._pose is not None:
            self._pose = self._pose[robots]

    def next(self, now: float | None, pose: ArrayLike | None) -> Elapsed:
        """Take note of a call at ``now`` [s], with poses (..., 3) [m, m, rad] by odometry.

        Raises:
            InputError: a number is not finite, or a pose has not three.
        """
        if now is not None and not math.isfinite(now):
            raise InputError(f"now = {now!r}: must be a finite number")
        rows = None if pose is None else finite_numbers(pose, "pose", 3).reshape(-1, 3)
        before, self._pose = self._pose, rows
        motion = None
        if before is not None and rows is not None and before.shape == rows.shape:
            motion = relative_pose(rows, before)
        last, self._now = self._now, now
        if now is None or last is None:
            return Elapsed(self._dt, 1, False, motion)
        return self._timed(now - last, motion)

    def _timed(self, seconds: float, motion: FloatArray | None) -> Elapsed:
        steps = seconds / self._dt
        if not 0.0 <= steps <= PAUSE_STEPS + ROUNDING:
            self._ahead = 0.0
            return Elapsed(seconds, 1, True, motion)
        # A whole step must have come together: the jitter of a loop is no step more or less.
        self._ahead += steps - 1.0
        more = math.trunc(self._ahead + math.copysign(ROUNDING, self._ahead))
        self._ahead -= more
        return Elapsed(seconds, 1 + more, False, motion)
