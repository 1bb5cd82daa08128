# SPDX-License-Identifier: Apache-2.0
"""Whether tf has the lidar where the robot's description has it."""

from __future__ import annotations

import math

import numpy as np
from rclpy.time import Time
from tf2_ros import Buffer, TransformException

from pm01_nav.deploy.messages import Scan
from pm01_nav.robot import Lidar
from pm01_rl.goals import planar

TOLERANCE_M = 0.02
TOLERANCE_RAD = math.radians(2.0)


class LidarMount:
    """Compare a lidar's place by tf with its description, once tf and a scan tell of it."""

    def __init__(self, lidar: Lidar, base_frame: str, buffer: Buffer) -> None:
        """Compare with ``lidar``, whose place in ``base_frame`` comes from ``buffer``."""
        self._described = np.array([lidar.x, lidar.y, lidar.yaw])
        self._base_frame, self._buffer = base_frame, buffer
        self._frame = ""
        self._known = False
        self.upside_down = False
        """Whether it hangs head down, so that its beams go round the other way."""
        self.difference: str | None = None
        """What is wrong; None where nothing is, or nothing is known yet."""

    @property
    def state(self) -> str:
        """Say what is known."""
        return self.difference or ("as described" if self._known else "tf does not say")

    @property
    def known(self) -> bool:
        """Whether tf has told of it."""
        return self._known

    def look(self, frame: str) -> None:
        """Take in that scans are in ``frame``, and compare what was not compared yet."""
        if frame != self._frame:
            self._frame, self._known, self.difference = frame, False, None
        if self._known:
            return
        try:
            found = self._buffer.lookup_transform(self._base_frame, frame, Time())
        except TransformException:
            return
        self._known = True
        self._compare(found.transform)

    def _compare(self, transform: object) -> None:
        turn = transform.rotation
        # The lidar's own axis, seen from the robot: up is 1, down is -1.
        up = 1.0 - 2.0 * (turn.x**2 + turn.y**2)
        self.upside_down = up < 0.0
        tilt = math.acos(min(abs(up), 1.0))
        if tilt > TOLERANCE_RAD:
            self.difference = (
                f"the lidar must lie level; by tf {self._frame} tilts by {math.degrees(tilt):.1f}°"
            )
            return
        by_tf = planar(transform)
        off = by_tf - self._described
        turned = abs(math.remainder(off[2], 2.0 * math.pi))
        if math.hypot(off[0], off[1]) > TOLERANCE_M or turned > TOLERANCE_RAD:
            self.difference = (
                f"the lidar: by tf {self._frame} is at {_text(by_tf)} of {self._base_frame}, "
                f"by the robot's description at {_text(self._described)}"
            )

    def upright(self, scan: Scan) -> Scan:
        """Return the scan as a lidar would give it that does not hang head down."""
        if not self.upside_down:
            return scan
        last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        return Scan(
            scan.stamp,
            -last,
            scan.angle_increment,
            scan.range_min,
            scan.range_max,
            scan.ranges[::-1],
            scan.frame_id,
        )


def _text(pose: np.ndarray) -> str:
    return f"x {pose[0]:.3f} m, y {pose[1]:.3f} m, yaw {math.degrees(pose[2]):.1f}°"
