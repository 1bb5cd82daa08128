# SPDX-License-Identifier: Apache-2.0
"""One fuzzed sequence: a robot among discs, its broken messages, and the commands it is told."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from fuzz_faults import HONEST, Faults, StrangePolicy, corrupted, foreign
from fuzz_judge import CONTROL_DT, Judge, cannot_stop, gap
from numpy.typing import NDArray
from reference_robot import Base, cast

from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.safety import SafetyConfig
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import RobotSpec
from pm01_nav.task.scans import scan_geometry

TICKS, LONG_TICKS = 12, 30
"""Control steps of a sequence; a lidar that freezes takes longer to be noticed."""
FRAMES = {"scan": "laser", "odometry": "odom"}
FloatArray = NDArray[np.float64]


class Sequence:
    """One robot, its messages, and the judge of what it is told."""

    def __init__(
        self, seed: int, robot: RobotSpec, faults: Faults, policy: Policy | None = None
    ) -> None:
        """Draw a scene and what will go wrong from ``seed``.

        With a ``policy`` there is a goal near by and a way to it; else a strange one answers.
        """
        self.rng = rng = np.random.default_rng(seed)
        # From a quiet day to a disaster: all probabilities times U(0, 1)^2.
        level = 1.0 if faults is HONEST else float(rng.uniform()) ** 2
        self.honest = faults is HONEST
        self.faults = Faults(**{name: level * value for name, value in asdict(faults).items()})
        if not self.honest:
            robot = _with_zeros(robot, str(rng.choice(["invalid", "invalid", "no_return"])))
        self.robot = robot
        self.strange = StrangePolicy(rng, self.faults, robot.base.size)
        safety = SafetyConfig()
        self.controller = Controller(
            policy or self.strange,
            robot,
            scan_geometry(robot.lidar),
            control_dt=CONTROL_DT,
            goal_radius=0.3,
            safety=safety,
        )
        self.goal_place = Goal(50.0, 0.0) if policy is None else Goal(2.0, rng.uniform(-1.0, 1.0))
        self.controller.set_goal(self.goal_place)
        self.base = Base(robot, np.zeros(3), np.zeros(robot.base.size))
        self.judge = Judge(robot, self.faults, safety)
        self.discs = self._scene(clear=policy is not None)
        # The robot's clock, ahead of ours by U(-1000, 1000) s.
        self.clock = rng.uniform(-1000.0, 1000.0)
        self.our_clock = 0.0
        self.stepped = 0.0
        """When the last command was given, by our clock [s]."""
        self.late = {"scan": 0.0, "odometry": 0.0}
        if rng.random() < self.faults.late:
            self.late[str(rng.choice(list(self.late)))] = rng.uniform(0.0, 1.5)
        self.sick = int(rng.integers(1 << 32)) if rng.random() < self.faults.sick else None
        """The seed of what is wrong with all scans."""
        frozen = rng.random() < self.faults.frozen
        self.frozen_at = float(rng.integers(2, TICKS)) if frozen else math.inf
        self.stuck: NDArray[np.float32] | None = None
        self.queue: list[tuple[float, int, str, Any, float]] = []
        self.count = 0
        self.contacts = 0
        self.deceived = frozen
        """Whether a message was another than it should be, not only lost, late or doubled."""
        self.arrived = False
        self.told = Counter[str]()
        self.command = self.rest = (0.0,) * robot.base.size
        self.silent = {"scan": math.inf, "odometry": math.inf}
        self.pressed: set[str] = set()
        """Who presses the emergency stop."""
        self.goal = True

    @property
    def violations(self) -> list[str]:
        """Everything that was wrong with a command."""
        return self.judge.violations

    def _scene(self, *, clear: bool) -> FloatArray:
        """Place discs that leave the robot 3 cm or more, and with ``clear`` the way to the goal."""
        count = int(self.rng.integers(1, 12))
        distance, angle = self.rng.uniform(0.3, 2.0, count), self.rng.uniform(-np.pi, np.pi, count)
        discs = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
        radius = self.rng.uniform(0.02, 0.3, count)
        reach = self.robot.footprint.circumscribed_radius + 0.03
        radius = np.minimum(radius, distance - reach)
        # Thinner ones could stand between two beams.
        seen = radius > distance * self.robot.lidar.angle_increment
        if clear:
            end = np.array([self.goal_place.x, self.goal_place.y])
            along = np.clip(discs @ end / (end @ end), 0.0, 1.0)
            seen &= np.hypot(*(discs - along[:, None] * end).T) - radius > reach + 0.4
        return np.concatenate([discs, radius[:, None]], axis=1)[seen]

    def run(self, ticks: int | None = None) -> None:
        """Play the sequence."""
        usual = LONG_TICKS if self.frozen_at < TICKS else TICKS
        for tick in range(ticks or usual):
            for part in range(2):
                now = (2 * tick + part) * 0.5 * CONTROL_DT
                self.judge.moved(now, self.base.pose)
                self._send("odometry", now, tick)
                if part == 0:
                    self._send("scan", now, tick)
                self._deliver(now)
                if part == 0:
                    self._operate()
                    self._step(now)
                self.base.move(self.command, 0.5 * CONTROL_DT)
                still = np.abs(self.base.twist).max() <= 0.01
                self.contacts += not still and gap(self.robot, self.base, self.discs) <= 0.0
            if self.arrived:
                return

    def _send(self, kind: str, now: float, tick: int) -> None:
        """Take a message and put it on its way, or lose it."""
        rng, faults = self.rng, self.faults
        if rng.random() < faults.silence:
            self.silent[kind] = min(self.silent[kind], now)
        if rng.random() < faults.drop or now >= self.silent[kind]:
            return
        message = self._scan(now, tick) if kind == "scan" else self._odometry(now)
        whole = message
        if rng.random() < faults.foreign:
            self.deceived = True
            other = foreign(rng, message)
            self._post(kind, replace(other, stamp=message.stamp - 0.01), now)
        if kind == "scan" and self.sick is not None:
            message = corrupted(np.random.default_rng(self.sick), message)
        elif rng.random() < faults.corrupt:
            message = corrupted(rng, message)
        self.deceived |= message is not whole
        self._post(kind, message, now)
        if rng.random() < faults.double:
            self._post(kind, message, now)

    def _post(self, kind: str, message: Any, now: float) -> None:
        self.count += 1
        arrival = now + self.late[kind] + self.rng.uniform(0.0, self.faults.delay_s)
        heapq.heappush(self.queue, (arrival, self.count, kind, message, now))

    def _scan(self, now: float, tick: int) -> Scan:
        lidar = self.robot.lidar
        if self.stuck is None:
            ranges = cast(self.discs, self.base.pose, self.robot)
            if tick >= self.frozen_at:
                constant = np.full_like(ranges, self.rng.uniform(0.5, 3.0))
                self.stuck = ranges = ranges if self.rng.random() < 0.7 else constant
        else:
            ranges = self.stuck
        return Scan(
            now + self.clock,
            lidar.angle_min,
            lidar.angle_increment,
            lidar.range_min,
            lidar.range_max,
            ranges,
            FRAMES["scan"],
        )

    def _odometry(self, now: float) -> Odometry:
        return Odometry(now + self.clock, self.base.pose, self.base.twist, FRAMES["odometry"])

    def _deliver(self, now: float) -> None:
        """Hand over what has arrived by ``now``."""
        rng = self.rng
        if rng.random() < self.faults.clock_jump:
            # U(2, 100) s or U(0.1, 0.9) s, back or ahead. What is on its way is of before.
            far = rng.uniform(2.0, 100.0) if rng.random() < 0.7 else rng.uniform(0.1, 0.9)
            self.clock += rng.choice([-1.0, 1.0]) * far
        if rng.random() < self.faults.our_clock_jump:
            # U(-10, 10) s.
            self.our_clock += rng.uniform(-10.0, 10.0)
        while self.queue and self.queue[0][0] <= now:
            arrival, _, kind, message, taken = heapq.heappop(self.queue)
            if kind == "scan":
                self.controller.see_scan(message, arrival + self.our_clock)
            else:
                self.controller.see_odometry(message, arrival + self.our_clock)
            self.judge.deliver(kind, message, taken)

    def _operate(self) -> None:
        """Press, release, cancel, or send a goal."""
        if self.rng.random() >= self.faults.operator:
            return
        what = int(self.rng.integers(4))
        if what == 0:
            self.controller.cancel()
            self.goal = False
        elif what == 1:
            self.controller.set_goal(self.goal_place)
            # Under the emergency stop no goal is taken.
            self.goal = not self.pressed
        else:
            # Two who press and release, each for himself; often what is not pressed.
            source = str(self.rng.choice(["topic", "service"]))
            self.controller.set_emergency(what == 2, source)
            (self.pressed.add if what == 2 else self.pressed.discard)(source)
            self.goal = self.goal and not self.pressed

    def _step(self, now: float) -> None:
        lost = bool(self.rng.random() < self.faults.transform)
        self.strange.failed = False
        # Who heard nothing for 0.2 s by our clock has been stopped by the watchdog.
        silent = now + self.our_clock - self.stepped > 0.2
        before = self.rest if silent else self.command
        self.stepped = now + self.our_clock
        status = self.controller.step(now + self.our_clock, math.inf if lost else 0.0)
        self.command = status.verdict.command
        reasons = {reason.name for reason in status.verdict.reasons}
        self.told.update(reasons)
        self.told["DRIVES" if self.command != self.rest else "STANDS"] += 1
        self.judge.judge(before, self.command, now, stop=self._reasons_to_stand(lost))
        if reasons & {"CLOCK_JUMP", "ODOMETRY_JUMP"}:
            self.judge.forget()
        self.arrived |= status.arrived
        if status.dropped:
            self.goal = False

    def _reasons_to_stand(self, lost: bool) -> dict[str, bool]:
        return {
            "emergency stop": bool(self.pressed),
            "no goal": not self.goal,
            "lost transform": lost,
            "policy failed": self.strange.failed,
            # Only where messages were honest: a supervisor cannot see what it was not told.
            "drives into a disc": self.honest
            and cannot_stop(self.robot, self.base, self.discs, self.command),
        }


def _with_zeros(robot: RobotSpec, zero_means: str) -> RobotSpec:
    """Return a robot whose lidar's driver means something by 0."""
    if robot.lidar.zero_means == zero_means:
        return robot
    lidar = robot.lidar.model_copy(update={"zero_means": zero_means})
    return robot.model_copy(update={"lidar": lidar})
