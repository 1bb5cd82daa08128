# SPDX-License-Identifier: Apache-2.0
"""What all planners that look at a scan have in common: its checks, and one row a robot."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.policy.inputs import check_scan, finite_numbers, finite_pair
from pm01_nav.robot import RobotSpec
from pm01_nav.task.scans import ScanGeometry, discard_invalid, scan_geometry

FloatArray = NDArray[np.float64]


def clean_ranges(scan: NDArray[np.float32], geometry: ScanGeometry) -> FloatArray:
    """Return raw ranges as what they say [m], same shape: range_min to range_max, or no return.

    What is too close is taken to be at range_min, what says nothing for no return, +inf.
    """
    return np.maximum(discard_invalid(scan, geometry), geometry.range_min).astype(np.float64)


class ScanPlanner(ABC):
    """Check what the robots see, and leave the next commands to a subclass."""

    def __init__(self, robot: RobotSpec) -> None:
        """Plan for robots of one kind."""
        self.robot = robot
        self.drive = robot.base
        self.geometry = scan_geometry(robot.lidar)

    @abstractmethod
    def plan(self, scan: NDArray[np.float32], goal: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return v and w (n, 2); arguments are those of ``act``, one row a robot.

        ``velocity`` (n, 2) is v and w as well, whatever the drive.
        """

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> FloatArray:
        """Return commands [m/s, rad/s]; see ``Policy.act``. They do not go sideways.

        Raises:
            InputError: a length is wrong, a range is negative, no range of a scan is valid, or
                goal or velocity are not finite.
        """
        ranges, goal = check_scan(scan, self.geometry), finite_pair(goal, "goal")
        axes, before = self.drive.size, goal.shape[:-1]
        velocity = np.broadcast_to(finite_numbers(velocity, "velocity", axes), (*before, axes))
        rows = ranges.reshape(-1, self.geometry.num_beams)
        velocity = self.drive.to_unicycle(velocity.reshape(-1, axes))
        command = self.plan(rows, goal.reshape(-1, 2), velocity)
        return self.drive.from_unicycle(command).reshape(*before, axes)
