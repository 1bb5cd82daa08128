# SPDX-License-Identifier: Apache-2.0
"""Throw broken sequences of messages at the controller and judge every command by other means.

    python benchmarks/safety_fuzz.py --sequences 100000 --out benchmarks/results/safety_fuzz.json

Each sequence is a robot among discs, with a clock of its own. Its messages are dropped, doubled,
delayed, overtaken and corrupted, its clock jumps, its policy answers with nonsense, and somebody
plays with the emergency stop and the goal. The judge shares no code with the supervisor: it works
with small time steps in true coordinates.
"""

from __future__ import annotations

import argparse
import heapq
import math
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference_robot import Base, cast, outside, robot_with
from report import write_report

from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.safety import SafetyConfig
from pm01_nav.robot import RobotSpec
from pm01_nav.task.observation import scan_geometry

CONTROL_DT = 0.1
TICKS = 12
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Faults:
    """How often what goes wrong; probabilities for each message or step."""

    drop: float = 0.0
    double: float = 0.0
    delay_s: float = 0.0
    """Messages are late by U(0, delay_s)."""
    corrupt: float = 0.0
    clock_jump: float = 0.0
    policy: float = 0.0
    """The policy answers with something that is no command."""
    operator: float = 0.0
    """Somebody presses, releases, cancels or sends a goal."""
    transform: float = 0.0
    silence: float = 0.0
    """A sensor falls silent for the rest of the sequence."""


HONEST = Faults(delay_s=0.05)
BROKEN = Faults(0.15, 0.15, 0.6, 0.05, 0.01, 0.1, 0.08, 0.03, 0.02)


class StrangePolicy:
    """Answers with commands of any size, and now and then with no command at all."""

    def __init__(self, rng: np.random.Generator, faults: Faults) -> None:
        """Draw answers from ``rng``."""
        self.rng, self.faults = rng, faults
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
                self._steady = self.rng.uniform([-0.6, -4.5], [1.5, 4.5])
            return self._steady
        nonsense = [None, "left", [math.nan, 0.0], [0.1, math.inf], [0.1], np.zeros((2, 2)), {}]
        choice = int(self.rng.integers(len(nonsense) + 1))
        if choice == len(nonsense):
            raise RuntimeError("out of memory")
        return nonsense[choice]


class Sequence:
    """One robot, its messages, and the judge of what it is told."""

    def __init__(self, seed: int, robot: RobotSpec, faults: Faults) -> None:
        """Draw a scene and what will go wrong from ``seed``."""
        self.rng = np.random.default_rng(seed)
        # From a quiet day to a disaster: all probabilities times U(0, 1)^2.
        level = 1.0 if faults is HONEST else float(self.rng.uniform()) ** 2
        self.honest = faults is HONEST
        faults = Faults(**{name: level * value for name, value in asdict(faults).items()})
        self.robot, self.faults = robot, faults
        self.policy = StrangePolicy(self.rng, faults)
        self.safety = SafetyConfig()
        self.controller = Controller(
            self.policy,
            robot,
            scan_geometry(robot.lidar),
            control_dt=CONTROL_DT,
            goal_radius=0.3,
            safety=self.safety,
        )
        self.controller.set_goal(Goal(50.0, 0.0))
        self.base = Base(robot, np.zeros(3), np.zeros(2))
        self.discs = self._scene()
        # The robot's clock, ahead of ours by U(-1000, 1000) s.
        self.clock = self.rng.uniform(-1000.0, 1000.0)
        self.queue: list[tuple[float, int, str, Any, float]] = []
        self.count = 0
        self.violations: list[str] = []
        self.contacts = 0
        self.told = Counter[str]()
        self.command = (0.0, 0.0)
        self.newest = {"scan": -math.inf, "odometry": -math.inf}
        """When each was taken that is the newest to have arrived, in true time [s]."""
        self.silent = {"scan": math.inf, "odometry": math.inf}
        self.pressed: set[str] = set()
        """Who presses the emergency stop."""
        self.goal = True

    def _scene(self) -> FloatArray:
        """Place discs that leave the robot 3 cm or more."""
        count = int(self.rng.integers(1, 12))
        distance, angle = self.rng.uniform(0.3, 2.0, count), self.rng.uniform(-np.pi, np.pi, count)
        discs = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
        radius = self.rng.uniform(0.02, 0.3, count)
        reach = self.robot.footprint.circumscribed_radius + 0.03
        radius = np.minimum(radius, distance - reach)
        # Thinner ones could stand between two beams.
        seen = radius > distance * self.robot.lidar.angle_increment
        return np.concatenate([discs, radius[:, None]], axis=1)[seen]

    def run(self) -> None:
        """Play the sequence."""
        for tick in range(TICKS):
            for part in range(2):
                now = (2 * tick + part) * 0.5 * CONTROL_DT
                self._send("odometry", now)
                if part == 0:
                    self._send("scan", now)
                self._deliver(now)
                if part == 0:
                    self._operate()
                    self._step(now)
                self.base.move(self.command, 0.5 * CONTROL_DT)
                gap = self._gap()
                if gap <= 0.0 and np.abs(self.base.twist).max() > 0.01:
                    self.contacts += 1

    def _gap(self) -> float:
        """Return the distance from the true outline to the nearest disc [m]."""
        if len(self.discs) == 0:
            return math.inf
        distance = outside(self.robot, self.discs[:, :2], self.base.pose) - self.discs[:, 2]
        return float(distance.min())

    def _send(self, kind: str, now: float) -> None:
        """Take a message and put it on its way, or lose it."""
        rng, faults = self.rng, self.faults
        if rng.random() < faults.silence:
            self.silent[kind] = min(self.silent[kind], now)
        if rng.random() < faults.drop or now >= self.silent[kind]:
            return
        message = self._scan(now) if kind == "scan" else self._odometry(now)
        if rng.random() < faults.corrupt:
            message = self._corrupted(message)
        for _ in range(2 if rng.random() < faults.double else 1):
            self.count += 1
            arrival = now + rng.uniform(0.0, faults.delay_s)
            heapq.heappush(self.queue, (arrival, self.count, kind, message, now))

    def _scan(self, now: float) -> Scan:
        lidar = self.robot.lidar
        ranges = cast(self.discs, self.base.pose, self.robot)
        return Scan(
            now + self.clock,
            lidar.angle_min,
            lidar.angle_increment,
            lidar.range_min,
            lidar.range_max,
            ranges,
        )

    def _odometry(self, now: float) -> Odometry:
        return Odometry(now + self.clock, self.base.pose, self.base.twist)

    def _corrupted(self, message: Any) -> Any:
        """Break a message so that it cannot be used."""
        if isinstance(message, Odometry):
            broken = message.pose.copy()
            broken[int(self.rng.integers(3))] = self.rng.choice([math.nan, math.inf, -math.inf])
            return replace(message, pose=broken)
        count = len(message.ranges)
        choices = [
            np.full(count, np.nan, dtype=np.float32),
            np.full(count, -1.0, dtype=np.float32),
            np.zeros(0, dtype=np.float32),
        ]
        return replace(message, ranges=choices[int(self.rng.integers(len(choices)))])

    def _deliver(self, now: float) -> None:
        """Hand over what has arrived by ``now``."""
        if self.rng.random() < self.faults.clock_jump:
            # U(2, 100) s, back or ahead. What is on its way has stamps of before.
            self.clock += self.rng.choice([-1.0, 1.0]) * self.rng.uniform(2.0, 100.0)
        while self.queue and self.queue[0][0] <= now:
            arrival, _, kind, message, taken = heapq.heappop(self.queue)
            if kind == "scan":
                self.controller.see_scan(message, arrival)
            else:
                self.controller.see_odometry(message, arrival)
            self.newest[kind] = max(self.newest[kind], taken)

    def _operate(self) -> None:
        """Press, release, cancel, or send a goal."""
        if self.rng.random() >= self.faults.operator:
            return
        what = int(self.rng.integers(4))
        if what == 0:
            self.controller.cancel()
            self.goal = False
        elif what == 1:
            self.controller.set_goal(Goal(50.0, 0.0))
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
        self.policy.failed = False
        before = self.command
        status = self.controller.step(now, math.inf if lost else 0.0)
        self.command = status.verdict.command
        self.told.update(reason.name for reason in status.verdict.reasons)
        self.told["DRIVES" if self.command != (0.0, 0.0) else "STANDS"] += 1
        self._judge(before, now, lost)
        if status.dropped:
            self.goal = False

    def _judge(self, before: tuple[float, float], now: float, lost: bool) -> None:
        """Write down everything that is wrong with the present command."""
        v, w = self.command
        limits = self.robot.limits
        checks = {
            "not finite": not (math.isfinite(v) and math.isfinite(w)),
            "beyond the limits": not (
                limits.linear_min <= v <= limits.linear_max and abs(w) <= limits.angular_max
            ),
            "too sudden": not (
                _reachable(before[0], v, limits.linear_acceleration * CONTROL_DT)
                and _reachable(before[1], w, limits.angular_acceleration * CONTROL_DT)
            ),
        }
        if (v, w) != (0.0, 0.0):
            checks |= {
                "emergency stop": bool(self.pressed),
                "no goal": not self.goal,
                "lost transform": lost,
                "policy failed": self.policy.failed,
                "drives into a disc": self._would_touch((v, w)),
            }
            for kind, timeout in (
                ("scan", self.safety.scan_timeout_s),
                ("odometry", self.safety.odometry_timeout_s),
            ):
                # The quickest message may have been late, too, by delay_s at most.
                age = now - self.newest[kind] - self.faults.delay_s
                checks[f"stale {kind}"] = age > timeout + 0.005
        self.violations += [name for name, wrong in checks.items() if wrong]

    def _would_touch(self, command: tuple[float, float]) -> bool:
        """Tell whether the robot cannot stop any more, if it knew all that is true.

        Only where messages were honest: a supervisor cannot see what it was not told.
        """
        if not self.honest or len(self.discs) == 0 or self._gap() <= 0.0:
            return False
        robot = Base(self.robot, self.base.pose, self.base.twist)
        for seconds, told in ((0.09, command), (0.6, (0.0, 0.0))):
            for _ in range(round(seconds / 0.03)):
                robot.move(told, 0.03)
                gaps = outside(self.robot, self.discs[:, :2], robot.pose) - self.discs[:, 2]
                if gaps.min() <= 0.0:
                    return True
        return False


def _reachable(before: float, now: float, change: float) -> bool:
    """Tell whether a speed is one step of acceleration from the last, or slower than that."""
    return min(0.0, before - change) - 1e-9 <= now <= max(0.0, before + change) + 1e-9


def run_batch(job: tuple[int, int, str, bool]) -> dict[str, Any]:
    """Play sequences of the seeds [first, first + count)."""
    first, count, name, honest = job
    robot = robot_with(name, 360 if honest else 60)
    total, told, contacts, examples = Counter[str](), Counter[str](), 0, []
    for seed in range(first, first + count):
        sequence = Sequence(seed, robot, HONEST if honest else BROKEN)
        sequence.run()
        told.update(sequence.told)
        contacts += bool(sequence.contacts)
        total.update(sequence.violations)
        if sequence.violations or (honest and sequence.contacts):
            examples.append(seed)
    return {"unsafe": total, "told": told, "contacts": contacts, "examples": examples[:5]}


def run(
    sequences: int,
    workers: int,
    robot: str,
    write: Callable[[dict[str, Any]], None],
    *,
    honest: bool,
) -> None:
    """Play many sequences on all cores, add up, and ``write`` after each batch."""
    step = 500
    jobs = [(k, min(step, sequences - k), robot, honest) for k in range(0, sequences, step)]
    unsafe, told, contacts, examples, done = Counter[str](), Counter[str](), 0, [], 0
    started = time.perf_counter()
    with ProcessPoolExecutor(workers) as pool:
        for job, result in zip(jobs, pool.map(run_batch, jobs), strict=True):
            done += job[1]
            unsafe.update(result["unsafe"])
            told.update(result["told"])
            contacts += result["contacts"]
            examples += result["examples"]
            write(
                {
                    "robot": robot,
                    "faults": "honest" if honest else "broken",
                    "sequences": done,
                    "commands": done * TICKS,
                    "unsafe_commands": dict(unsafe),
                    "sequences_with_contact_while_moving": contacts,
                    "first_bad_seeds": examples[:5],
                    "told": dict(told.most_common()),
                    "seconds": round(time.perf_counter() - started, 1),
                }
            )


def main() -> None:
    """Play sequences of both kinds with a round and an oblong robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=100_000, help="broken ones of PM01")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    count = arguments.sequences
    kinds = (
        ("pm01", False, count),
        ("pm01", True, count // 20),
        ("jackal", True, count // 20),
        ("jackal", False, count // 5),
    )
    results: dict[str, dict[str, Any]] = {}
    for robot, honest, sequences in kinds:
        name = f"{robot}_{'honest' if honest else 'broken'}"

        def write(result: dict[str, Any], name: str = name) -> None:
            results[name] = result
            write_report(arguments.out, {"results": results})

        run(sequences, arguments.workers, robot, write, honest=honest)


if __name__ == "__main__":
    main()
