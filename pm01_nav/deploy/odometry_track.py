# SPDX-License-Identifier: Apache-2.0
"""Where the robot was when a scan was taken, and where it is now."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Odometry
from pm01_nav.geometry import after_twist, wrap_angle

CAPACITY = 256
"""Odometries kept: a scan of a second ago finds its place at 200 Hz, too."""


class OdometryTrack:
    """The latest odometry messages, newest last, all finite and in the order of their stamps."""

    def __init__(self, reach_s: float) -> None:
        """Go on with the newest twist for up to ``reach_s`` [s] where there is no odometry yet."""
        self._reach = reach_s
        self._kept: deque[Odometry] = deque(maxlen=CAPACITY)

    @property
    def newest(self) -> Odometry | None:
        """The newest message; None if there is none."""
        return self._kept[-1] if self._kept else None

    def add(self, odometry: Odometry) -> None:
        """Note a message that is newer than all others."""
        self._kept.append(odometry)

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()

    def pose_at(self, stamp: float) -> NDArray[np.float64]:
        """Return the pose at a time by the robot's clock, shape (3,) [m, m, rad]."""
        after = bisect_left(self._kept, stamp, key=lambda odometry: odometry.stamp)
        if 0 < after < len(self._kept):
            return _between(self._kept[after - 1], self._kept[after], stamp)
        known = self._kept[-1 if after else 0]
        seconds = min(max(stamp - known.stamp, -self._reach), self._reach)
        return after_twist(known.pose, known.twist, seconds)


def _between(before: Odometry, after: Odometry, stamp: float) -> NDArray[np.float64]:
    share = (stamp - before.stamp) / (after.stamp - before.stamp)
    change = after.pose - before.pose
    change[2] = wrap_angle(change[2])
    return before.pose + share * change
