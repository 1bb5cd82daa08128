# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with a robot's messages and its policy, and how often."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Odometry, Scan

OTHER_FRAME = "other"


@dataclass(frozen=True)
class Faults:
    """How often what goes wrong; probabilities for each message or step, unless said otherwise."""

    drop: float = 0.0
    double: float = 0.0
    delay_s: float = 0.0
    """Messages are late by U(0, delay_s), so that some overtake others."""
    corrupt: float = 0.0
    clock_jump: float = 0.0
    """The robot's clock is set: by some seconds or more, or by less than a second."""
    policy: float = 0.0
    """The policy answers with something that is no command."""
    operator: float = 0.0
    """Somebody presses, releases, cancels or sends a goal."""
    transform: float = 0.0
    silence: float = 0.0
    """A sensor falls silent for the rest of the sequence."""
    sick: float = 0.0
    """All scans of a sequence are corrupted in the same way."""
    late: float = 0.0
    """All messages of one topic are late by the same, U(0, 1.5) s, beside ``delay_s``."""
    frozen: float = 0.0
    """The lidar repeats its scan, or one with the same range everywhere, from now on."""
    foreign: float = 0.0
    """Somebody else publishes on the same topic."""
    our_clock_jump: float = 0.0
    """Our own clock is set, forward or back."""


HONEST = Faults(delay_s=0.05)
BROKEN = Faults(
    drop=0.15,
    double=0.15,
    delay_s=0.6,
    corrupt=0.06,
    clock_jump=0.01,
    policy=0.1,
    operator=0.08,
    transform=0.03,
    silence=0.02,
    sick=0.5,
    late=0.4,
    frozen=0.2,
    foreign=0.03,
    our_clock_jump=0.005,
)


class StrangePolicy:
    """Answers with commands of any size, and now and then with no command at all."""

    def __init__(self, rng: np.random.Generator, faults: Faults, size: int = 2) -> None:
        """Draw answers of ``size`` numbers from ``rng``."""
        self.rng, self.faults = rng, faults
        self._side = [1.5] * (size - 2)
        self.failed = False
        self._steady = np.zeros(2)

    def reset(self) -> None:
        """Forget nothing."""

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Keep nothing."""

    def act(self, scan: Any, goal: Any, velocity: Any) -> Any:
        """Answer."""
        self.failed = bool(self.rng.random() < self.faults.policy)
        if not self.failed:
            if self.rng.random() < 0.2:
                # Mostly forwards, within three times the limits.
                self._steady = self.rng.uniform(
                    [-0.6, *(-most for most in self._side), -4.5], [1.5, *self._side, 4.5]
                )
            return self._steady
        nonsense = [None, "left", [math.nan, 0.0], [0.1, math.inf], [0.1], np.zeros((2, 2)), {}]
        choice = int(self.rng.integers(len(nonsense) + 1))
        if choice == len(nonsense):
            raise RuntimeError("out of memory")
        return nonsense[choice]


def corrupted(rng: np.random.Generator, message: Scan | Odometry) -> Scan | Odometry:
    """Return a message as a broken sensor, driver or network may leave it."""
    if isinstance(message, Scan):
        return _SCANS[int(rng.integers(len(_SCANS)))](rng, message)
    return _ODOMETRIES[int(rng.integers(len(_ODOMETRIES)))](rng, message)


def _filled(value: float) -> Callable[[np.random.Generator, Scan], Scan]:
    """Return what puts ``value`` in the place of all ranges."""

    def corrupt(rng: np.random.Generator, scan: Scan) -> Scan:
        return replace(scan, ranges=np.full_like(scan.ranges, value))

    return corrupt


def _partly(value: float) -> Callable[[np.random.Generator, Scan], Scan]:
    """Return what puts ``value`` in the place of many ranges, here and there."""

    def corrupt(rng: np.random.Generator, scan: Scan) -> Scan:
        # Of the beams U(0.4, 1).
        lost = rng.random(len(scan.ranges)) < rng.uniform(0.4, 1.0)
        return replace(scan, ranges=np.where(lost, np.float32(value), scan.ranges))

    return corrupt


def _ahead(value: float) -> Callable[[np.random.Generator, Scan], Scan]:
    """Return what puts ``value`` in the place of neighbouring ranges, mostly around ahead."""

    def corrupt(rng: np.random.Generator, scan: Scan) -> Scan:
        count = len(scan.ranges)
        # Around a direction of N(0, 30 deg) from ahead, U(0, 180) deg wide in all.
        middle = count // 2 + round(count * rng.normal(0.0, 30.0) / 360.0)
        half = round(count * rng.uniform(0.0, 90.0) / 360.0)
        ranges = scan.ranges.copy()
        ranges[np.arange(middle - half, middle + half + 1) % count] = value
        return replace(scan, ranges=ranges)

    return corrupt


def _other_number(rng: np.random.Generator, scan: Scan) -> Scan:
    """Leave beams out at the end, or send too many: none, one, half, one more, twice as many."""
    count = len(scan.ranges)
    wanted = [0, 1, count // 2, count - 1, count + 1, 2 * count][int(rng.integers(6))]
    return replace(scan, ranges=np.resize(scan.ranges, wanted))


def _other_figures(rng: np.random.Generator, scan: Scan) -> Scan:
    """Break one of the figures beside the ranges."""
    changes = [
        {"angle_min": math.nan},
        {"angle_increment": 0.0},
        {"angle_increment": math.inf},
        {"range_max": 0.01},
        {"range_min": math.nan},
    ]
    return replace(scan, **changes[int(rng.integers(len(changes)))])


def _other_stamp(rng: np.random.Generator, message: Any) -> Any:
    """Stamp a message with what is no time of its robot."""
    return replace(message, stamp=float(rng.choice([math.nan, math.inf, 0.0])))


def _other_frame(rng: np.random.Generator, message: Any) -> Any:
    return replace(message, frame_id=OTHER_FRAME)


_SCANS: tuple[Callable[[np.random.Generator, Scan], Scan], ...] = (
    *(_filled(value) for value in (math.nan, -1.0, 0.0, 0.0, 65.535, 0.01, 1.0)),
    *(_partly(value) for value in (math.nan, 0.0, 65.535, -1.0)),
    *(_ahead(value) for value in (math.nan, 0.0, 0.0, 65.535)),
    _other_number,
    _other_figures,
    _other_stamp,
    _other_frame,
)


def _no_pose(rng: np.random.Generator, odometry: Odometry) -> Odometry:
    pose = odometry.pose.copy()
    pose[int(rng.integers(3))] = rng.choice([math.nan, math.inf, -math.inf])
    return replace(odometry, pose=pose)


def _no_twist(rng: np.random.Generator, odometry: Odometry) -> Odometry:
    twist = odometry.twist.copy()
    # Not finite, or faster than any robot.
    twist[int(rng.integers(len(twist)))] = rng.choice([math.nan, math.inf, 50.0, -50.0])
    return replace(odometry, twist=twist)


def _elsewhere(rng: np.random.Generator, odometry: Odometry) -> Odometry:
    # By U(-5, 5) m and U(-pi, pi).
    jump = rng.uniform([-5.0, -5.0, -math.pi], [5.0, 5.0, math.pi])
    return replace(odometry, pose=odometry.pose + jump)


_ODOMETRIES: tuple[Callable[[np.random.Generator, Odometry], Odometry], ...] = (
    _no_pose,
    _no_twist,
    _elsewhere,
    _other_stamp,
    _other_frame,
)


def foreign(rng: np.random.Generator, message: Scan | Odometry) -> Scan | Odometry:
    """Return what somebody else publishes at that time: a lidar in free space, another odometry."""
    frame = OTHER_FRAME if rng.random() < 0.5 else message.frame_id
    if isinstance(message, Scan):
        return replace(message, ranges=np.full_like(message.ranges, np.inf), frame_id=frame)
    # Apart by U(-0.6, 0.6) m and U(-0.6, 0.6) rad.
    return replace(message, pose=message.pose + rng.uniform(-0.6, 0.6, 3), frame_id=frame)
