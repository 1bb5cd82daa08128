# SPDX-License-Identifier: Apache-2.0
"""The judge of a fuzzed sequence: what a robot must not do, worked out from what is true.

It shares no code with the supervisor. It reads messages in plain loops, knows when each was really
taken, and moves the true robot in small steps.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from fuzz_faults import Faults
from reference_robot import Base, outside

from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.safety import SafetyConfig
from pm01_nav.drives.limits import OmnidirectionalLimits
from pm01_nav.robot import RobotSpec

CONTROL_DT = 0.1
JUMP_S = 1.0
"""Stamps that go back by less are of messages that were overtaken [s]."""
SLACK_S = 0.005
FROZEN_S = 1.5
"""A lidar that repeats itself for so long while the robot moves must have been noticed [s]."""
NOTABLE = (0.05, 0.12)
"""A robot that moves faster than this is known to move [m/s, rad/s]."""
Command = tuple[float, ...]


class Topic:
    """What has been delivered of one topic, as far as anybody could know its order."""

    def __init__(self) -> None:
        """Know of nothing."""
        self.taken = -math.inf
        """When the newest message was really taken [s]."""
        self.message: Any = None
        self.stamp = -math.inf
        self.frame = ""
        self.changed = False
        """Whether the newest message is of another frame than the one before it."""

    def deliver(self, message: Any, taken: float) -> bool:
        """Take in a message; tell whether it replaces the last one."""
        self.taken = max(self.taken, taken)
        stamp = message.stamp
        if not math.isfinite(stamp) or self.stamp - JUMP_S <= stamp <= self.stamp:
            return False
        self.message, self.stamp = message, stamp
        return True

    def forget(self) -> None:
        """Begin anew after a jump; what is overtaken by what came before it stays so."""
        self.message, self.frame, self.changed = None, "", False


class Judge:
    """Write down everything that is wrong with what a robot is told."""

    def __init__(self, robot: RobotSpec, faults: Faults, safety: SafetyConfig) -> None:
        """Judge commands to ``robot``, whose messages suffer from ``faults``."""
        self.robot, self.faults, self.safety = robot, faults, safety
        self.topics = {"scan": Topic(), "odometry": Topic()}
        self.violations: list[str] = []
        self._repeated_s = 0.0
        self._ranges = b""
        self._ranges_at = math.nan
        self._true_poses: deque[tuple[float, tuple[float, float, float]]] = deque(maxlen=100)

    def deliver(self, kind: str, message: Any, taken: float) -> None:
        """Take in a message that was ``taken`` [s] and has now arrived."""
        topic = self.topics[kind]
        before = topic.stamp
        if not topic.deliver(message, taken):
            return
        if isinstance(message, Scan):
            self._note_repetition(message, message.stamp - before)
        elif unusable_odometry(message, self.robot):
            # What cannot be used is no frame that others are compared with.
            return
        topic.changed |= (
            "" not in (topic.frame, message.frame_id) and topic.frame != message.frame_id
        )
        topic.frame = message.frame_id or topic.frame

    def moved(self, now: float, pose: Any) -> None:
        """Note where the robot really is."""
        self._true_poses.append((now, (float(pose[0]), float(pose[1]), float(pose[2]))))

    def _note_repetition(self, scan: Scan, since: float) -> None:
        ranges = np.asarray(scan.ranges, dtype=np.float32).tobytes()
        same = ranges == self._ranges and 0.0 < since <= 0.45
        inside = (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
        met = bool(inside.any())
        taken = self.topics["scan"].taken
        if not (same and met):
            self._repeated_s = 0.0
        elif self._is_moving(taken - since, taken):
            self._repeated_s += since
        self._ranges = ranges

    def _is_moving(self, begin: float, end: float) -> bool:
        """Tell whether the robot really moved between two times, so that it could not be missed."""
        places = [pose for at, pose in self._true_poses if begin - 0.06 <= at <= end + 0.06]
        if len(places) < 2:
            return False
        (x1, y1, yaw1), (x2, y2, yaw2) = places[0], places[-1]
        span = max(end - begin, 1e-9)
        way, turn = math.hypot(x2 - x1, y2 - y1) / span, abs(yaw2 - yaw1) / span
        return way > NOTABLE[0] or turn > NOTABLE[1]

    def judge(
        self, before: Command, command: Command, now: float, *, stop: dict[str, bool]
    ) -> None:
        """Compare a command at ``now`` [s] with the last one and with what has been delivered.

        ``stop`` names what else the robot must stand for, and whether it does.
        """
        v, *side, w = command
        limits, u = self.robot.limits, sum(side)
        checks = {
            "not finite": not all(map(math.isfinite, command)),
            "beyond the limits": not (
                limits.linear_min <= v <= limits.linear_max and abs(w) <= limits.angular_max
            ),
            "too sudden": not (
                _reachable(before[0], v, limits.linear_acceleration * CONTROL_DT)
                and _reachable(before[-1], w, limits.angular_acceleration * CONTROL_DT)
            ),
        }
        if isinstance(limits, OmnidirectionalLimits):
            # A robot of the same speed in every direction.
            checks["beyond the limits"] |= math.hypot(v, u) > limits.lateral_max + 1e-9
            change = limits.lateral_acceleration * CONTROL_DT
            checks["too sudden"] |= not _reachable(before[1], u, change)
        if any(command):
            checks |= stop | self._stale(now) | self._untold(v, u)
        for topic in self.topics.values():
            topic.changed = False
        self.violations += [name for name, wrong in checks.items() if wrong]

    def _stale(self, now: float) -> dict[str, bool]:
        config = self.safety
        timeouts = {"scan": config.scan_timeout_s, "odometry": config.odometry_timeout_s}
        return {
            # The quickest message may have been late, too, by delay_s at most.
            f"stale {kind}": now - self.topics[kind].taken > timeout + self.faults.delay_s + SLACK_S
            for kind, timeout in timeouts.items()
        }

    def _untold(self, v: float, u: float) -> dict[str, bool]:
        """Tell what the newest messages do not allow a robot that moves."""
        scan, odometry = self.topics["scan"].message, self.topics["odometry"].message
        unusable, blind = False, False
        if scan is not None:
            told = what_is_told(scan, self.robot.lidar.zero_means != "invalid")
            unusable = sum(told) < 0.5 * len(told)
            blind = (v or u) != 0.0 and is_blind(scan, told, math.degrees(math.atan2(u, v)))
        return {
            "unusable scan": unusable,
            "drives blindly": blind,
            "unusable odometry": odometry is not None and unusable_odometry(odometry, self.robot),
            "two lidars": self.topics["scan"].changed,
            "two odometries": self.topics["odometry"].changed,
            "frozen scan": self._repeated_s > FROZEN_S,
        }

    def forget(self) -> None:
        """Begin anew after a jump that the robot was told to stand for."""
        for topic in self.topics.values():
            topic.forget()
        self._repeated_s = 0.0


def what_is_told(scan: Scan, zero_is_valid: bool) -> list[bool]:
    """Tell of each beam whether it says anything; of no beam if the message makes no sense."""
    numbers = (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max)
    if not all(math.isfinite(number) for number in numbers) or len(scan.ranges) == 0:
        return [False]
    # Twice round: nobody knows which of two beams is meant.
    if (len(scan.ranges) - 1) * abs(scan.angle_increment) > math.radians(361.0):
        return [False]
    told = []
    for value in scan.ranges.tolist():
        if math.isfinite(value) and value < 0.0:
            return [False]
        if value == 0.0:
            told.append(zero_is_valid)
        else:
            # A driver writes its limits as float32.
            inside = scan.range_min - 1e-6 <= value <= scan.range_max + 1e-6
            told.append(math.isinf(value) or inside)
    return told


def is_blind(scan: Scan, told: list[bool], course: float) -> bool:
    """Tell whether most of a quarter of a circle, or a sixteenth in one piece, is not seen."""
    step = math.degrees(scan.angle_increment)
    first = math.degrees(scan.angle_min)
    unseen, run, longest = 0, 0, 0
    for direction in range(-45, 46):
        ahead = direction + course
        beam = round((ahead - first) % 360.0 / step) if step else 0
        beam = beam % len(told) if len(told) * step > 359.0 else beam
        seen = beam < len(told) and told[beam]
        unseen += not seen
        run = 0 if seen else run + 1
        longest = max(longest, run)
    whole = len(told) * step > 359.0
    return unseen > 0.6 * 91 or (whole and longest > 22)


def unusable_odometry(odometry: Odometry, robot: RobotSpec) -> bool:
    """Tell whether odometry is no place, or says that the robot flies."""
    numbers = [*odometry.pose.tolist(), *odometry.twist.tolist()]
    fastest = 4.0 * max(robot.limits.linear_max, robot.limits.angular_max)
    return not all(math.isfinite(n) for n in numbers) or max(map(abs, numbers[3:])) > fastest


def cannot_stop(robot: RobotSpec, base: Base, discs: Any, command: Command) -> bool:
    """Tell whether a robot cannot stop any more before a disc, if it knew all that is true."""
    if len(discs) == 0 or gap(robot, base, discs) <= 0.0:
        return False
    ghost = Base(robot, base.pose, base.twist)
    for seconds, told in ((0.09, command), (0.6, (0.0,) * len(command))):
        for _ in range(round(seconds / 0.03)):
            ghost.move(told, 0.03)
            if gap(robot, ghost, discs) <= 0.0:
                return True
    return False


def gap(robot: RobotSpec, base: Base, discs: Any) -> float:
    """Return the distance from the true outline to the nearest disc [m]."""
    if len(discs) == 0:
        return math.inf
    return float((outside(robot, discs[:, :2], base.pose) - discs[:, 2]).min())


def _reachable(before: float, now: float, change: float) -> bool:
    """Tell whether a speed is one step of acceleration from the last, or slower than that."""
    return min(0.0, before - change) - 1e-9 <= now <= max(0.0, before + change) + 1e-9
