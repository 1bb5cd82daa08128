# SPDX-License-Identifier: Apache-2.0
"""Recover what is known: robots of MuJoCo with faults of their own, driven, recorded, identified.

    python benchmarks/identification.py --robots 12 --out benchmarks/results/identification.json

Each robot draws its wheels, delay, lag, limits of acceleration, lidar and odometry from the ranges
below. It drives as ``pm01 drive excite`` does, under the supervisor, with noise on all that is
measured; the drive goes through an MCAP file. The identification knows the nominal robot alone.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from report import write_report

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.identification import identify
from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.deploy.recording import Recorder, read_recording
from pm01_nav.deploy.simulated_robot import SimulatedRobot, drive_simulated
from pm01_nav.geometry import after_twist
from pm01_nav.robot import RobotSpec, load_robot
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

DT = 0.02
ODOMETRY_NOISE = np.array([0.005, 0.01])
"""Standard deviation of v and w by odometry [m/s, rad/s]."""
RANGES = {
    "wheel_left_factor": (0.95, 1.05),
    "wheel_right_factor": (0.95, 1.05),
    "wheel_separation_factor": (0.9, 1.1),
    "command_delay_s": (0.0, 0.2),
    "actuator_lag": (0.03, 0.2),
    "linear_acceleration": (0.5, 2.0),
    "angular_acceleration": (2.0, 8.0),
    "lidar_noise_std": (0.005, 0.02),
    "lidar_dropout": (0.0, 0.05),
    "odometry_scale": (0.97, 1.03),
}
"""Each robot's faults are U(least, greatest); the delay in whole steps of the simulator."""


def draw_faults(seed: int) -> dict[str, float]:
    """Return what is wrong with one robot."""
    rng = np.random.default_rng(seed)
    faults = {name: float(rng.uniform(*limits)) for name, limits in RANGES.items()}
    return faults | {"command_delay_s": round(faults["command_delay_s"] / DT) * DT}


def expected(faults: dict[str, float]) -> dict[str, float]:
    """Return what a drive can tell: odometry that overstates travel makes wheels look larger."""
    true = dict(faults)
    scale = true.pop("odometry_scale")
    for name in ("wheel_left_factor", "wheel_right_factor", "wheel_separation_factor"):
        true[name] *= scale
    return true | {"travel_scale": 1.0 / scale}


class FaultyRobot(SimulatedRobot):
    """A robot of MuJoCo whose firmware takes it for the nominal one."""

    def __init__(self, nominal: RobotSpec, faults: dict[str, float], seed: int) -> None:
        """Put it into a world with things to see."""
        self._faults = faults
        self._noise = np.random.default_rng(seed + 1)
        self._separation = nominal.driven_wheels.separation
        self._pose: NDArray[np.float64] = np.zeros(3)
        self._queue: deque[tuple[float, float, float]] = deque()
        limits = nominal.limits
        true = nominal.model_copy(
            update={
                # Wheels that are too large make the robot faster than it is said to be.
                "limits": limits.model_copy(
                    update={
                        "linear_max": 1.5 * limits.linear_max,
                        "linear_min": 1.5 * limits.linear_min,
                        "angular_max": 1.5 * limits.angular_max,
                        "linear_acceleration": faults["linear_acceleration"],
                        "angular_acceleration": faults["angular_acceleration"],
                    }
                ),
                "actuator": nominal.actuator.model_copy(update={"lag_s": faults["actuator_lag"]}),
                "lidar": nominal.lidar.model_copy(update={"noise_std": faults["lidar_noise_std"]}),
            }
        )
        pool = world_pool(task_config("static"), "held_out", 8, 1)
        super().__init__(true, pool, seed=seed, dt=DT, backend="mujoco")

    def command(self, *command: float) -> None:
        """Take a command that reaches the wheels later, through the nominal wheels."""
        linear, angular = command
        f, across = self._faults, 0.5 * self._separation * angular
        left = f["wheel_left_factor"] * (linear - across)
        right = f["wheel_right_factor"] * (linear + across)
        turn = (right - left) / (self._separation * f["wheel_separation_factor"])
        due = self.time + f["command_delay_s"]
        self._queue.append((due, 0.5 * (left + right), turn))

    def step(self) -> bool:
        """Move on by ``dt``, and odometry with it."""
        while self._queue and self._queue[0][0] <= self.time + 1e-9:
            super().command(*self._queue.popleft()[1:])
        new_scan = super().step()
        self._pose = after_twist(self._pose, self._measured(), self.dt)
        return new_scan

    def _measured(self) -> NDArray[np.float64]:
        twist = super().odometry().twist
        return np.array([self._faults["odometry_scale"] * twist[0], twist[1]])

    def odometry(self) -> Odometry:
        """Return the integral of the wheels' travel, and a noisy twist."""
        twist = self._measured() + self._noise.normal(0.0, ODOMETRY_NOISE)
        return Odometry(self.time, self._pose.copy(), twist)

    def scan(self) -> Scan:
        """Return what the lidar sees now, less what it loses."""
        scan = super().scan()
        ranges = scan.ranges.copy()
        lost = self._noise.random(len(ranges)) < self._faults["lidar_dropout"]
        ranges[lost] = np.inf
        return Scan(
            scan.stamp,
            scan.angle_min,
            scan.angle_increment,
            scan.range_min,
            scan.range_max,
            ranges,
        )


def recover(seed: int, seconds: float) -> dict[str, Any]:
    """Return the true and the identified quantities of one robot."""
    nominal, faults = load_robot("pm01"), draw_faults(seed)
    controller = load_controller("excite", "pm01", same_clock=True)
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder) / "drive")
        drive_simulated(controller, FaultyRobot(nominal, faults, seed), seconds, recorder)
        recorder.close()
        found = identify(read_recording(Path(folder) / "drive"), nominal).estimates
    rows = {}
    for name, true in expected(faults).items():
        row: dict[str, Any] = {"true": round(true, 5)}
        if name in found:
            value, low, high = found[name]
            row |= {"found": round(value, 5), "low": round(low, 5), "high": round(high, 5)}
        rows[name] = row
    return rows


def summary(robots: list[dict[str, Any]]) -> dict[str, Any]:
    """Return for each quantity how far off it was at most, and how often its interval held it."""
    result = {}
    for name in robots[0]:
        rows = [r[name] for r in robots if "found" in r[name]]
        errors = [r["found"] - r["true"] for r in rows]
        held = sum(r["low"] <= r["true"] <= r["high"] for r in rows)
        result[name] = {
            "found_for": len(rows),
            "error_mean": round(float(np.mean(errors)), 5),
            "error_most": round(float(np.abs(errors).max()), 5),
            "interval_holds_truth": held,
        }
    return result


def main() -> None:
    """Recover so many robots."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=180.0, help="of each drive")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    robots = [recover(seed, arguments.seconds) for seed in range(arguments.robots)]
    write_report(arguments.out, {"summary": summary(robots), "robots": robots})


if __name__ == "__main__":
    main()
