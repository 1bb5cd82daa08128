# SPDX-License-Identifier: Apache-2.0
"""From what a robot's topics say to what its motors are told, at the policy's rate.

Whoever owns a ``Controller`` (a ROS node, the DDS or rosbridge driver, a test) hands over messages
as they come and calls ``step`` every ``control_dt``. It has no thread of its own, and no clock but
the one by which it times the policy.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.goals import Goal, turn_rate
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.safety import (
    COMMAND_HELD_S,
    Command,
    Reason,
    SafetyConfig,
    SafetySupervisor,
    Verdict,
)
from pm01_nav.deploy.scan_fitting import ScanFitter, sector_lines
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, wrap_angle
from pm01_nav.policy.protocol import Policy, is_timed
from pm01_nav.task.scans import ScanGeometry

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec

ENDS_THE_GOAL = frozenset((Reason.EMERGENCY_STOP, Reason.CLOCK_JUMP, Reason.ODOMETRY_JUMP))
"""After these the robot does not start again by itself..."""
PATIENCE_S = 10.0
"""... nor when anything else made it stand for so long: nobody expects it to move any more [s]."""
YAW_TOLERANCE = 0.25
"""How far off the heading at a goal may be, as Nav2's goal checker has it [rad]."""
LONGEST_STEP_S = 0.1
"""Commands come at least so often, whatever the policy's own time step: watchdogs, in bases too,
wait for a few of these, and obstacles do not wait for a slow policy [s]."""


class Status(NamedTuple):
    """The outcome of one control step."""

    verdict: Verdict
    goal_distance: float
    """To the present goal [m]; NaN without one, or where it is unknown."""
    arrived: bool
    """Whether a goal was reached in this step; it is then forgotten."""
    dropped: bool
    """Whether the goals were given up in this step, for the reasons in the verdict."""
    remaining: int
    """How many goals are still to be reached."""


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

        ``control_dt`` [s] is the time between two answers of the policy; a goal is reached within
        ``goal_radius`` [m]. ``same_clock`` is as for ``SafetySupervisor``.
        """
        self.patience_s = PATIENCE_S
        """Goals are given up when something made the robot stand for longer [s]."""
        self.yaw_tolerance = YAW_TOLERANCE
        """A heading is reached within this [rad]."""
        self.policy = policy
        self.robot = robot
        self.drive = robot.base
        self.axes = self.drive.axes
        """What the numbers of commands and of odometry's twists stand for."""
        self.control_dt = control_dt / max(1, math.ceil(control_dt / LONGEST_STEP_S - 1e-9))
        """Time between two calls of ``step`` [s]; in between, a slow policy's answer is kept."""
        self.goal_radius = goal_radius
        self.supervisor = SafetySupervisor(robot, self.control_dt, safety, same_clock=same_clock)
        self.clock: Callable[[], float] = time.monotonic
        """What the policy is timed by [s]; in simulated time give it the simulation's: there the
        wall's seconds are not the robot's, be it that they race or that they wait."""
        self._policy_dt = control_dt
        self._asked_at = -math.inf
        """When the policy gave the answer that is kept [s]; not finite if there is none."""
        self._answer: NDArray[np.float64] | None = None
        self._commanded: tuple[float, Command] = (-math.inf, self.supervisor.stop)
        """When the robot was told what [s], [m/s, rad/s]."""
        self._goals: deque[Goal] = deque()
        self._turning_since: float | None = None
        """Since when the robot is at the last goal and turns to its heading [s]."""
        self._fitter = ScanFitter(replace(geometry, zero_means=robot.lidar.zero_means))
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

    @property
    def goal(self) -> Goal | None:
        """Where the robot drives to now."""
        return self._goals[0] if self._goals else None

    def set_goal(self, goal: Goal) -> None:
        """Head for one goal instead of any others, as ``set_goals`` does."""
        self.set_goals([goal])

    def set_goals(self, goals: Iterable[Goal]) -> None:
        """Head for other goals, in order; the policy forgets the way so far.

        Only at the last of them a heading is turned to. Under a pressed emergency stop nothing is
        taken: releasing it must not start the robot.
        """
        if not self.supervisor.emergency:
            self.cancel()
            self._goals.extend(goals)
            self._forget()

    def _forget(self) -> None:
        """Let the policy forget the way so far, and what it said."""
        self.policy.reset()
        self._asked_at = -math.inf

    def move_goals(self, goals: Iterable[Goal]) -> None:
        """Correct the places of the remaining goals, as when their frame moves in odometry's."""
        self._goals = deque(goals)

    def cancel(self) -> None:
        """Give up all goals."""
        self._goals.clear()
        self._turning_since = None

    def set_emergency(self, pressed: bool, source: str = "topic") -> None:
        """Press or release the emergency stop of one ``source``; after it a new goal is needed.

        It is pressed while any source presses it. Releasing what is not pressed changes nothing:
        many buttons repeat their state.
        """
        self.supervisor.set_emergency(pressed, source)
        if self.supervisor.emergency:
            self.cancel()

    def step(self, now: float, transform_age: float = 0.0, link_age: float = 0.0) -> Status:
        """Return what the robot is told at ``now`` [s].

        ``transform_age`` [s] is how old the transform is by which the goal came into the odometry
        frame, infinite if it is missing; ``link_age`` [s] is as for ``SafetySupervisor.faults``.
        """
        supervisor = self.supervisor
        ages = {"transform_age": transform_age, "link_age": link_age}
        faults = supervisor.faults(now, goal=self.goal is not None, **ages)
        if self.goal is None or not faults or self._sound is None:
            self._sound = now
        distance = self._distance(now)
        arrived = not faults and self._reach(now)
        proposed: NDArray[np.float64] | None = None
        if not faults and self.goal is not None:
            proposed = self._propose(self.goal, now)
        else:
            self._asked_at = -math.inf
        verdict = supervisor.supervise(proposed, now, goal=self.goal is not None, **ages)
        self._commanded = (now, verdict.command)
        dropped = self.goal is not None and self._is_hopeless(verdict, now)
        if dropped:
            self.cancel()
        return Status(verdict, distance, arrived, dropped, len(self._goals))

    def distance_left(self, now: float) -> float:
        """Return the length of the straight way past all goals [m]; NaN as in ``Status``."""
        places = [(goal.x, goal.y) for goal in self._goals]
        between = (math.dist(a, b) for a, b in pairwise(places))
        return self._distance(now) + sum(between)

    def _distance(self, now: float) -> float:
        """Return how far the present goal is [m]; NaN without one, or where the robot is lost."""
        pose = self.supervisor.pose(now)
        if self.goal is None or pose is None:
            return math.nan
        return math.hypot(self.goal.x - pose[0], self.goal.y - pose[1])

    def _reach(self, now: float) -> bool:
        """Forget the goals that are reached at ``now`` [s]; tell whether there were any."""
        before = len(self._goals)
        while len(self._goals) > 1 and self._distance(now) <= self.goal_radius:
            self._goals.popleft()
            self._forget()
        if len(self._goals) == 1 and self._is_there(now):
            self.cancel()
        return len(self._goals) < before

    def _is_there(self, now: float) -> bool:
        """Tell whether the robot is at its last goal and faces where it should."""
        if self._turning_since is None and not self._distance(now) <= self.goal_radius:
            return False
        left = self._left_to_turn(now)
        if abs(left) <= self.yaw_tolerance:
            return True
        # From here on the place is reached, wherever the turn takes the robot.
        if self._turning_since is None:
            self._turning_since = now
        return False

    def _left_to_turn(self, now: float) -> float:
        """Return the angle to the heading at the present goal [rad]; 0 if any heading will do."""
        pose = self.supervisor.pose(now)
        if self.goal is None or self.goal.yaw is None or pose is None:
            return 0.0
        return float(wrap_angle(self.goal.yaw - pose[2]))

    def _propose(self, goal: Goal, now: float) -> NDArray[np.float64] | None:
        """Return what to do about a goal that is not reached yet; None if the policy fails."""
        if self._turning_since is not None:
            self.failure = None
            self._asked_at = -math.inf
            left = self._left_to_turn(now)
            return self.drive.turning(turn_rate(left, self.drive, self.control_dt))
        pose = self.supervisor.pose(now)
        assert pose is not None
        return self._policy_says(to_frame(np.array([goal.x, goal.y]), pose), now)

    def _is_hopeless(self, verdict: Verdict, now: float) -> bool:
        """Tell whether nobody expects the robot to reach its goals any more."""
        assert self._sound is not None
        if self._turning_since is not None:
            slowest = 2.0 * math.pi / self.drive.angular_max
            if now - self._turning_since > self.patience_s + slowest:
                self.failure = "the goal is reached, but there is no room to turn to its heading"
                return True
        tired = now - self._sound > self.patience_s
        return tired or not ENDS_THE_GOAL.isdisjoint(verdict.reasons)

    def _policy_says(self, goal: NDArray[np.float64], now: float) -> NDArray[np.float64] | None:
        """Return what the policy would do, or what it said last until its next step is due."""
        due = self._policy_dt - 0.5 * self.control_dt
        slow = self._policy_dt > self.control_dt
        if slow and self._answer is not None and 0.0 <= now - self._asked_at < due:
            return self._answer
        self._asked_at = now
        self._answer = self._ask(goal, now)
        return self._answer

    def _ask(self, goal: NDArray[np.float64], now: float) -> NDArray[np.float64] | None:
        """Return what the policy would do; None if it fails, whatever it fails of."""
        odometry, scan, policy = self.supervisor.odometry, self._scan, self.policy
        assert odometry is not None
        assert scan is not None
        self.failure = None
        began = self.clock()
        try:
            sees = (self._fitter.fit(scan), goal, odometry.twist)
            if is_timed(policy):
                at, applied = self._commanded
                # After a longer silence a watchdog has stopped the robot.
                applied = applied if now - at <= COMMAND_HELD_S else self.supervisor.stop
                pose = self.supervisor.pose(now)
                command = policy.act(*sees, now=now, applied=applied, pose=pose)
            else:
                command = policy.act(*sees)
        except Exception as error:  # A policy is a stranger's file: no failure may stop the loop.
            self.failure = " ".join(str(error).split())[:200] or type(error).__name__
            return None
        seconds = self.clock() - began
        if seconds > self.control_dt:
            # What it saw is over, and so is the time for which the supervisor would judge.
            self.failure = f"took {seconds:.2f} s, longer than a control step"
            return None
        return command
