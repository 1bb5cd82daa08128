# SPDX-License-Identifier: Apache-2.0
"""Stand between a policy and the motors: whatever the policy says, the robot is told what is safe.

It knows nothing of the policy. It sees the raw scan, the odometry and the command that is asked
for, and passes on that command, a slower one, or a stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.freshness import Arrival, RobotClock, Stream
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.motion_check import (
    Outline,
    allowed_share,
    time_to_contact,
)
from pm01_nav.deploy.odometry_track import OdometryTrack
from pm01_nav.deploy.safety_config import SafetyConfig
from pm01_nav.deploy.scan_check import ScanCheck
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, to_world, wrap_angle

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]
Command = tuple[float, ...]
"""A number for each axis of a drive, such as v and w [m/s, rad/s]."""
STOP: Command = (0.0, 0.0)
"""For links, whatever the drive; a supervisor's ``stop`` has a number for each axis."""
LINK_TIMEOUT_S = 0.4
"""What has come back from the robot was sent no longer ago: a control step, there and back [s]."""
LEAST_SHARE = 0.05
"""Instead of less than this share of a command the robot stands."""
ODOMETRY_SLACK = np.array([0.3, 0.5])
"""Odometry may move by so much more than the robot can without having jumped [m, rad]."""
MOVING = np.array([0.02, 0.05])
"""A robot that travels and turns slower than this may as well stand [m/s, rad/s]."""
MIXED_S = 1.0
"""After a scan of another frame the robot stands for so long [s]: two lidars take turns."""
IMPLAUSIBLE = 3.0
"""Odometry that says the robot is faster than this many times its limits is wrong."""
WATCHDOG_S = 0.15
"""After so long without a command a watchdog says stop [s]..."""
COMMAND_HELD_S = 0.2
"""... so that a base that heard nothing for this long no longer follows the last command [s]."""


class Reason(Enum):
    """Why the robot is not told what the policy says."""

    EMERGENCY_STOP = "emergency stop"
    CLOCK_JUMP = "a clock jumped"
    ODOMETRY_JUMP = "odometry jumped"
    NO_SCAN = "no scan yet"
    STALE_SCAN = "the scan is too old"
    INVALID_SCAN = "the scan is unusable"
    FROZEN_SCAN = "the lidar repeats one scan while the robot moves"
    MIXED_SCANS = "scans of more than one lidar on one topic"
    NO_ODOMETRY = "no odometry yet"
    STALE_ODOMETRY = "odometry is too old"
    INVALID_ODOMETRY = "odometry is not finite, or faster than the robot can be"
    SLOW_LINK = "the connection to the robot is too slow"
    LOST_TRANSFORM = "the transform to the goal's frame is missing or too old"
    WRONG_MOUNT = "tf has the lidar elsewhere than the robot's description"
    SECOND_PUBLISHER = "somebody else commands the robot, too"
    NO_GOAL = "no goal"
    POLICY_FAILED = "the policy gave no usable command"
    OBSTACLE = "an obstacle is too close"
    UNSEEN = "the lidar does not see what lies that way"
    SLOWED = "slower: an obstacle is near"


class Verdict(NamedTuple):
    """What the robot is told, and why."""

    command: Command
    reasons: tuple[Reason, ...]
    time_to_contact: float
    """On the arc that the policy asked for [s]; infinite within the horizon, NaN if not looked."""


class SafetySupervisor:
    """Tell a robot what is safe of what it is asked to do; one call of ``supervise`` a command."""

    def __init__(
        self,
        robot: RobotSpec,
        control_dt: float,
        config: SafetyConfig,
        *,
        same_clock: bool = False,
    ) -> None:
        """Guard ``robot``, which gets a command every ``control_dt`` [s].

        ``same_clock``: stamps are of the clock that ``now`` is of, as in simulated time.

        Raises:
            InputError: commands would come too seldom for a watchdog.
        """
        if not 0.0 < control_dt < WATCHDOG_S:
            raise InputError(
                f"control_dt = {control_dt:g} s: the watchdog stops a robot that hears nothing "
                f"for {WATCHDOG_S:g} s; train with a shorter control_dt"
            )
        self.config = config
        self.control_dt = control_dt
        self.drive = drive = robot.base
        self.stop: Command = (0.0,) * drive.size
        self._outline = Outline(robot.footprint)
        self._reaction = config.reaction_s + control_dt + robot.actuator.lag_s
        self._clock = RobotClock(same_clock=same_clock)
        self._scans = Stream(self._clock, jump_s=config.clock_jump_s)
        self._odometries = Stream(self._clock, jump_s=config.clock_jump_s)
        valid, frozen_s = config.valid_share_min, config.frozen_scan_s
        self._scan = ScanCheck(robot.lidar, valid, frozen_s, drive.courses)
        self._scan_frame = ""
        self._mixed_at = -math.inf
        """When a scan came that is of another frame than the one before it."""
        self._track = OdometryTrack(config.odometry_timeout_s)
        self._odometry_valid = False
        self._excess = np.zeros(2)
        """By how much odometry has moved more than the robot can [m, rad]."""
        self._emergency: set[str] = set()
        self._held: set[Reason] = set()
        self._jumped: Reason | None = None
        self._now = -math.inf
        self._commanded_at = -math.inf
        self._command = self.stop
        self._reasons: set[Reason] = set()
        """Of the last verdict."""

    @property
    def emergency(self) -> bool:
        """Whether somebody presses the emergency stop."""
        return bool(self._emergency)

    def set_emergency(self, pressed: bool, source: str) -> None:
        """Press or release the emergency stop of one ``source``; each releases only its own."""
        (self._emergency.add if pressed else self._emergency.discard)(source)

    def hold(self, reason: Reason, held: bool) -> None:
        """Let the robot stand for a ``reason`` that only its owner can see, or no longer."""
        (self._held.add if held else self._held.discard)(reason)

    def see_scan(self, scan: Scan, now: float) -> bool:
        """Take in a scan that arrived at ``now`` [s]; tell whether it is newer than the last."""
        self._follow_clock(now)
        arrival = self._scans.accept(scan.stamp, now)
        if arrival is Arrival.JUMP:
            self._jump(Reason.CLOCK_JUMP)
        if arrival is Arrival.OLD:
            return False
        if scan.frame_id and self._scan_frame and scan.frame_id != self._scan_frame:
            self._mixed_at = now
        self._scan_frame = scan.frame_id or self._scan_frame
        return self._scan.see(scan, moves=self._moved_before(scan.stamp))

    def _moved_before(self, stamp: float) -> bool:
        """Tell whether by odometry the robot moved between the newest scan and ``stamp``."""
        since, newest = stamp - self._scan.stamp, self._track.newest
        if newest is None or not since > 0.0:
            return False
        if (self.drive.pace(newest.twist) > MOVING).any():
            return True
        now, before = self._track.pose_at(stamp), self._track.pose_at(self._scan.stamp)
        return bool((_way(before, now) > MOVING * since).any())

    def see_odometry(self, odometry: Odometry, now: float) -> bool:
        """Take in odometry that arrived at ``now`` [s]; tell whether it is newer than the last."""
        self._follow_clock(now)
        arrival = self._odometries.accept(odometry.stamp, now)
        if arrival is Arrival.JUMP:
            self._jump(Reason.CLOCK_JUMP)
        if arrival is Arrival.OLD:
            return False
        before, self._odometry_valid = self._track.newest, self._is_plausible(odometry)
        if not self._odometry_valid:
            return False
        if before is not None and arrival is Arrival.NEW and self._moved_too_far(before, odometry):
            self._jump(Reason.ODOMETRY_JUMP)
        self._track.add(odometry)
        return True

    def pose(self, now: float) -> NDArray[np.float64] | None:
        """Return the pose by odometry at ``now``, shape (3,) [m, m, rad]; None if it is unknown."""
        if self._track.newest is None or not self._odometry_valid:
            return None
        return self._track.pose_at(now - self._clock.offset)

    @property
    def advice(self) -> str | None:
        """What a person can do about scans that keep the robot from driving, in one line."""
        blind = self._reasons & {Reason.INVALID_SCAN, Reason.UNSEEN}
        return self._scan.advice if blind else None

    @property
    def odometry(self) -> Odometry | None:
        """The newest valid odometry."""
        return self._track.newest

    def faults(
        self,
        now: float,
        *,
        goal: bool = True,
        transform_age: float = 0.0,
        link_age: float = 0.0,
    ) -> tuple[Reason, ...]:
        """Return every reason why the robot must stand at ``now`` [s], whatever the policy says.

        ``transform_age`` [s] is how old the transform to the goal's frame is; ``link_age`` [s] how
        long ago the newest of what has come back from the robot was sent, by a clock of ours.
        """
        self._follow_clock(now)
        config = self.config
        checks = (
            (Reason.EMERGENCY_STOP, self.emergency),
            (Reason.CLOCK_JUMP, self._jumped is Reason.CLOCK_JUMP),
            (Reason.ODOMETRY_JUMP, self._jumped is Reason.ODOMETRY_JUMP),
            (Reason.NO_SCAN, not self._scans.begun),
            (
                Reason.STALE_SCAN,
                self._scans.begun and not self._scans.age(now) <= config.scan_timeout_s,
            ),
            (Reason.INVALID_SCAN, self._scans.begun and self._scan.returns is None),
            (Reason.FROZEN_SCAN, self._scan.frozen),
            (Reason.MIXED_SCANS, now - self._mixed_at < MIXED_S),
            (Reason.NO_ODOMETRY, not self._odometries.begun),
            (
                Reason.STALE_ODOMETRY,
                self._odometries.begun
                and not self._odometries.age(now) <= config.odometry_timeout_s,
            ),
            (Reason.INVALID_ODOMETRY, self._odometries.begun and not self._odometry_valid),
            (Reason.SLOW_LINK, not link_age <= LINK_TIMEOUT_S),
            (Reason.LOST_TRANSFORM, not transform_age <= config.transform_timeout_s),
            (Reason.WRONG_MOUNT, Reason.WRONG_MOUNT in self._held),
            (Reason.SECOND_PUBLISHER, Reason.SECOND_PUBLISHER in self._held),
            (Reason.NO_GOAL, not goal),
        )
        return tuple(reason for reason, holds in checks if holds)

    def supervise(
        self,
        proposed: Sequence[float] | NDArray[np.floating] | None,
        now: float,
        *,
        goal: bool = True,
        transform_age: float = 0.0,
        link_age: float = 0.0,
    ) -> Verdict:
        """Return what the robot is told at ``now`` [s] instead of what is ``proposed``.

        None, or what is not a finite number for each axis of the drive, counts as a failure of the
        policy. The rest is as for ``faults``. A jump is over once the robot was told to stop for
        it.
        """
        faults = self.faults(now, goal=goal, transform_age=transform_age, link_age=link_age)
        command = _as_command(proposed, self.drive.size)
        elapsed = max(0.0, now - self._commanded_at)
        self._commanded_at = now
        if faults or command is None:
            self._jumped = None
            verdict = Verdict(self.stop, faults or (Reason.POLICY_FAILED,), math.nan)
        else:
            verdict = self._check_way(self._limited(command, elapsed), now)
        self._command, self._reasons = verdict.command, set(verdict.reasons)
        return verdict

    def _limited(self, command: FloatArray, elapsed: float) -> FloatArray:
        """Keep a command within the limits of speed, and within reach of the last one."""
        if elapsed > COMMAND_HELD_S:
            self._command = self.stop
        before, step = np.array(self._command), min(elapsed, self.control_dt)
        # On the way from one command to another a base may not be as fast slantwise.
        return self.drive.clip(self.drive.reachable(command, before, step))

    def _check_way(self, command: FloatArray, now: float) -> Verdict:
        """Slow a command down until the robot can stop before it touches anything."""
        pose, newest = self.pose(now), self._track.newest
        assert pose is not None
        assert newest is not None
        assert self._scan.returns is not None
        # Returns stay where they are in the odometry frame while the robot moves on.
        points = to_world(self._scan.returns, self._track.pose_at(self._scan.stamp))
        points = to_frame(points, pose)
        twist, drive = command, self.drive
        # What the robot does now it goes on doing until it has taken the command up.
        moving = newest.twist
        # A command is taken to need as much longer as odometry needed to come.
        reaction = self._reaction + max(0.0, self._odometries.age(now))
        share, _ = self._share(points, moving, reaction, slow_down=False)
        if share < 1.0:
            twist = _not_faster(twist, share * moving)
        share, contact = self._share(points, twist, reaction)
        course = drive.course(twist)
        unseen = course is not None and not self._scan.sees(course)
        if share >= LEAST_SHARE and not unseen:
            slowed = share < 1.0 or (twist != command).any()
            return Verdict(_told(share * twist), (Reason.SLOWED,) if slowed else (), contact)
        # No way on this arc: it may still turn away on the spot.
        turn = drive.turning(twist[-1])
        share, _ = self._share(points, turn, reaction)
        told = _told(share * turn) if share >= LEAST_SHARE else self.stop
        return Verdict(told, (Reason.UNSEEN if unseen else Reason.OBSTACLE,), contact)

    def _share(
        self,
        points: FloatArray,
        twist: FloatArray,
        reaction: float,
        *,
        slow_down: bool = True,
    ) -> tuple[float, float]:
        """Return how much of a twist is safe, 0 to 1, and when all of it meets a point [s]."""
        config, braking = self.config, self.drive.braking_time(twist)
        least = config.time_to_collision_s if slow_down else 1e-9
        horizon = max(least, reaction + 0.5 * braking)
        contact = time_to_contact(
            self._outline, points, twist, horizon, config.padding, config.obstacle_speed
        )
        return allowed_share(contact, reaction, braking, least), contact

    def _is_plausible(self, odometry: Odometry) -> bool:
        numbers = np.concatenate([odometry.pose, odometry.twist])
        if numbers.shape != (3 + self.drive.size,) or not np.isfinite(numbers).all():
            return False
        fastest = IMPLAUSIBLE * self.drive.fastest
        return bool((np.abs(odometry.twist) <= fastest).all())

    def _moved_too_far(self, before: Odometry, after: Odometry) -> bool:
        """Tell whether odometry jumped: at once, back and forth (two sources), or to a frame."""
        fastest = np.array([self.drive.top_speed, self.drive.angular_max])
        possible = 2.0 * fastest * (after.stamp - before.stamp)
        moved = _way(before.pose, after.pose)
        self._excess = np.maximum(self._excess + moved - possible, 0.0)
        other_frame = before.frame_id and after.frame_id and before.frame_id != after.frame_id
        return bool(other_frame or (self._excess > ODOMETRY_SLACK).any())

    def _follow_clock(self, now: float) -> None:
        """Notice that our own clock went back: all ages are then unknown."""
        if not now >= self._now:
            self._jump(Reason.CLOCK_JUMP)
        self._now = now

    def _jump(self, reason: Reason) -> None:
        """Forget what was measured before a jump."""
        self._jumped = reason
        self._scan.forget()
        self._track.clear()
        self._excess[:] = 0.0
        if reason is Reason.CLOCK_JUMP:
            self._clock.forget()
            self._mixed_at = -math.inf
            self._scans.forget()
            self._odometries.forget()
            self._odometry_valid = False


def _way(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far apart two poses are, shape (2,) [m, rad], not negative."""
    change = after - before
    return np.abs([np.hypot(change[0], change[1]), wrap_angle(change[2])])


def _not_faster(twist: FloatArray, limit: FloatArray) -> FloatArray:
    """Return ``twist``, each speed kept within that of ``limit`` if it has the same direction."""
    kept = np.copysign(np.minimum(np.abs(twist), np.abs(limit)), twist)
    return np.where(twist * limit >= 0.0, kept, twist)


def _told(twist: FloatArray) -> Command:
    return tuple(twist.tolist())


def _as_command(
    proposed: Sequence[float] | NDArray[np.floating] | None, size: int
) -> FloatArray | None:
    """Return so many finite numbers, or None for anything else."""
    try:
        values = np.asarray(proposed, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return values if values.shape == (size,) and np.isfinite(values).all() else None
