# SPDX-License-Identifier: Apache-2.0
"""From what a robot's topics say to what its motors are told, at the policy's rate.

Whoever owns a ``Controller`` (a ROS node, the DDS or rosbridge driver, a test) hands over messages
as they come and calls ``step`` every ``control_dt``. It has no thread of its own, and no clock but
the one that times the policy.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.safety import (
    Command,
    Reason,
    SafetyConfig,
    SafetySupervisor,
    Verdict,
)
from pm01_nav.deploy.scan_fitting import ScanFitter, sector_lines
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame
from pm01_nav.policy.protocol import Policy
from pm01_nav.task.observation import ScanGeometry

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec

ENDS_THE_GOAL = frozenset((Reason.EMERGENCY_STOP, Reason.CLOCK_JUMP, Reason.ODOMETRY_JUMP))
"""After these the robot does not start again by itself..."""
GIVE_UP_S = 10.0
"""... nor when anything else made it stand for so long: nobody expects it to move any more [s]."""


class Status(NamedTuple):
    """The outcome of one control step."""

    verdict: Verdict
    goal_distance: float
    """[m]; NaN without a goal, or where it is unknown."""
    arrived: bool
    """Whether the goal was reached in this step; it is then forgotten."""
    dropped: bool
    """Whether the goal was given up in this step, for the reasons in the verdict."""


@dataclass(frozen=True)
class Goal:
    """Where to go, in the odometry frame [m]."""

    x: float
    y: float

    def __post_init__(self) -> None:
        """Refuse what is no place.

        Raises:
            InputError: a coordinate is not finite.
        """
        if not (math.isfinite(self.x) and math.isfinite(self.y)):
            raise InputError(f"goal = ({self.x}, {self.y}): must be two finite numbers")


class Controller:
    """Drive one robot to one goal after the other."""

    def __init__(
        self,
        policy: Policy,
        robot: RobotSpec,
        geometry: ScanGeometry,
        *,
        control_dt: float,
        goal_radius: float,
        safety: SafetyConfig,
        same_clock: bool = False,
    ) -> None:
        """Let ``policy``, which sees scans of ``geometry``, drive ``robot``.

        ``control_dt`` [s] is the time between two calls of ``step``; a goal is reached within
        ``goal_radius`` [m]. ``same_clock`` is as for ``SafetySupervisor``.
        """
        self.policy = policy
        self.robot = robot
        self.control_dt = control_dt
        self.goal_radius = goal_radius
        self.supervisor = SafetySupervisor(robot, control_dt, safety, same_clock=same_clock)
        self.goal: Goal | None = None
        self._fitter = ScanFitter(geometry)
        self._scan: Scan | None = None
        self._sound: float | None = None
        """When last there was no goal, or nothing that made the robot stand [s]."""
        self.failure: str | None = None
        """Why the policy gave no command in the last step; None if it did."""

    def see_scan(self, scan: Scan, now: float) -> None:
        """Take in a scan that arrived at ``now`` [s]."""
        if self.robot.lidar.upside_down:
            scan = scan.mirrored()
        if self.supervisor.see_scan(scan, now):
            self._scan = scan

    def see_odometry(self, odometry: Odometry, now: float) -> None:
        """Take in odometry that arrived at ``now`` [s]."""
        self.supervisor.see_odometry(odometry, now)

    def beams(self) -> NDArray[np.float64]:
        """Return from where to where the policy looks, in base_link, shape (n, 2, 2) [m].

        There is nothing (n = 0) without a usable scan, or if the policy has no beams.
        """
        layout, lidar = getattr(self.policy, "layout", None), self.robot.lidar
        if layout is None or self._scan is None:
            return np.zeros((0, 2, 2))
        try:
            ranges = self._fitter.fit(self._scan)
        except InputError:
            return np.zeros((0, 2, 2))
        return sector_lines(layout, ranges, np.array([lidar.x, lidar.y, lidar.yaw]))

    def set_goal(self, goal: Goal) -> None:
        """Head for another goal; the policy forgets the way so far.

        Under a pressed emergency stop nothing is taken: releasing it must not start the robot.
        """
        if not self.supervisor.emergency:
            self.goal = goal
            self.policy.reset()

    def move_goal(self, goal: Goal) -> None:
        """Correct the place of the present goal, as when its frame moves against odometry's."""
        self.goal = goal

    def cancel(self) -> None:
        """Give up the goal."""
        self.goal = None

    def set_emergency(self, pressed: bool, source: str = "topic") -> None:
        """Press or release the emergency stop of one ``source``; after it a new goal is needed.

        It is pressed while any source presses it. Releasing what is not pressed changes nothing:
        many buttons repeat their state.
        """
        self.supervisor.set_emergency(pressed, source)
        if self.supervisor.emergency:
            self.goal = None

    def step(self, now: float, transform_age: float = 0.0, link_age: float = 0.0) -> Status:
        """Return what the robot is told at ``now`` [s].

        ``transform_age`` [s] is how old the transform is by which the goal came into the odometry
        frame, infinite if it is missing; ``link_age`` [s] is as for ``SafetySupervisor.faults``.
        """
        supervisor, goal = self.supervisor, self.goal
        ages = {"transform_age": transform_age, "link_age": link_age}
        faults = supervisor.faults(now, goal=goal is not None, **ages)
        if goal is None or not faults or self._sound is None:
            self._sound = now
        in_base = None if goal is None else self._in_base(goal, now)
        distance = math.nan if in_base is None else float(np.hypot(*in_base))
        arrived = not faults and distance <= self.goal_radius
        if arrived:
            self.goal = None
        proposed: NDArray[np.float64] | Command | None = None
        if not faults and not arrived and in_base is not None:
            proposed = self._ask(in_base)
        verdict = supervisor.supervise(proposed, now, goal=self.goal is not None, **ages)
        ends = now - self._sound > GIVE_UP_S or not ENDS_THE_GOAL.isdisjoint(verdict.reasons)
        dropped = self.goal is not None and ends
        if dropped:
            self.goal = None
        return Status(verdict, distance, arrived, dropped)

    def _in_base(self, goal: Goal, now: float) -> NDArray[np.float64] | None:
        """Return the goal in base_link, shape (2,) [m]; None where the robot is lost."""
        pose = self.supervisor.pose(now)
        return None if pose is None else to_frame(np.array([goal.x, goal.y]), pose)

    def _ask(self, goal: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return what the policy would do; None if it fails, whatever it fails of."""
        odometry, scan = self.supervisor.odometry, self._scan
        assert odometry is not None
        assert scan is not None
        self.failure = None
        began = time.perf_counter()
        try:
            command = self.policy.act(self._fitter.fit(scan), goal, odometry.twist)
        except Exception as error:  # A policy is a stranger's file: no failure may stop the loop.
            self.failure = " ".join(str(error).split())[:200] or type(error).__name__
            return None
        seconds = time.perf_counter() - began
        if seconds > self.control_dt:
            # What it saw is over, and so is the time for which the supervisor would judge.
            self.failure = f"took {seconds:.2f} s, longer than a control step"
            return None
        return command
