# SPDX-License-Identifier: Apache-2.0
"""How often the intervals of ``pm01 identify`` hold the truth, on drives whose truth is known.

    python benchmarks/identification_coverage.py --drives 200 --jobs 2 --out coverage.json

The bases here are integrated in steps of 1 ms and share no code with the fitted model. Each draws
its faults, its drive and its recording from the laws in ``draw_base`` and ``draw_recording``.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from report import write_report

from pm01_nav.deploy.base_fit import fit_base
from pm01_nav.robot import RobotSpec, load_robot, robot_names

FloatArray = NDArray[np.float64]
DT = 0.001


def draw_base(rng: np.random.Generator, robot: RobotSpec) -> dict[str, float]:
    """Return what a base is: U(least, greatest) each; half of them are at times asked too much."""
    scale = rng.uniform(0.9, 1.1)
    limits, saturated = robot.limits, rng.random() < 0.5
    slower = rng.uniform(0.6, 1.0) if saturated else 1e3
    return {
        "wheel_left_factor": scale * rng.uniform(0.99, 1.01),
        "wheel_right_factor": scale * rng.uniform(0.99, 1.01),
        "wheel_separation_factor": rng.uniform(0.9, 1.1),
        "command_delay_s": rng.uniform(0.0, 0.3),
        "actuator_lag": rng.uniform(0.0, 0.4),
        "linear_acceleration": math.exp(rng.uniform(math.log(0.2), math.log(3.0))),
        "angular_acceleration": math.exp(rng.uniform(math.log(0.5), math.log(10.0))),
        "linear_max": slower * limits.linear_max,
        "linear_min": slower * limits.linear_max,
        "angular_max": slower * limits.angular_max,
    }


def draw_recording(rng: np.random.Generator) -> dict[str, float]:
    """Return how a drive is recorded: rates U(5, 50) Hz, and how far stamps are off."""
    return {
        "seconds": rng.uniform(60.0, 180.0),
        "command_rate": rng.uniform(5.0, 50.0),
        "odometry_rate": rng.uniform(5.0, 50.0),
        "outliers": rng.uniform(0.0, 0.01),
        "jitter": rng.uniform(0.0, 0.005),
    }


def drive(seed: int) -> tuple[RobotSpec, dict[str, float], FloatArray, FloatArray]:
    """Return the robot as described, the truth, and commands and odometry, both t, v, w."""
    rng = np.random.default_rng(seed)
    robot = load_robot(robot_names()[seed % len(robot_names())])
    true, how = draw_base(rng, robot), draw_recording(rng)
    sent = np.arange(0.0, how["seconds"], 1.0 / how["command_rate"])
    commands = _program(rng, robot, sent)
    speeds = _integrate(true, robot.driven_wheels.separation, sent, commands, how["seconds"])
    taken = np.arange(rng.uniform(0.0, 0.1), how["seconds"] - 0.01, 1.0 / how["odometry_rate"])
    odometry = np.stack([np.interp(taken, speeds[:, 0], speeds[:, k]) for k in (1, 2)], axis=1)
    # N(0, 5 mm/s) and N(0, 0.01 rad/s); spikes of U(-5, 5) m/s and rad/s.
    odometry = odometry + rng.normal(0.0, [0.005, 0.01], odometry.shape)
    wrong = rng.random(len(taken)) < how["outliers"]
    odometry[wrong] = rng.uniform(-5.0, 5.0, (int(wrong.sum()), 2))
    # N(0, jitter): stamps of both kinds.
    sent = np.sort(sent + rng.normal(0.0, how["jitter"], len(sent)))
    taken = np.sort(taken + rng.normal(0.0, how["jitter"], len(taken)))
    return robot, true, np.c_[sent, commands], np.c_[taken, odometry]


def _program(rng: np.random.Generator, robot: RobotSpec, sent: FloatArray) -> FloatArray:
    """Return v, w at each time: steps of U(0.4, 2.5) s, a quarter of them rests."""
    commands, until, now = np.zeros((len(sent), 2)), 0.0, np.zeros(2)
    limits = robot.limits
    for row, t in enumerate(sent):
        if t >= until:
            until = t + rng.uniform(0.4, 2.5)
            rest = rng.random() < 0.25
            v = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0) * limits.linear_max
            w = rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.3, 1.0) * limits.angular_max
            now = np.zeros(2) if rest else np.array([v, w])
        commands[row] = now
    return commands


def _integrate(
    true: dict[str, float], b: float, sent: FloatArray, commands: FloatArray, seconds: float
) -> FloatArray:
    """Return t, v, w at every millisecond, by Euler's method."""
    asked = commands.copy()
    asked[:, 0] = np.minimum(np.maximum(asked[:, 0], -true["linear_min"]), true["linear_max"])
    asked[:, 1] = np.minimum(np.maximum(asked[:, 1], -true["angular_max"]), true["angular_max"])
    left = true["wheel_left_factor"] * (asked[:, 0] - asked[:, 1] * b / 2.0)
    right = true["wheel_right_factor"] * (asked[:, 0] + asked[:, 1] * b / 2.0)
    aims = np.c_[(left + right) / 2.0, (right - left) / (b * true["wheel_separation_factor"])]
    times = np.arange(0.0, seconds, DT)
    heard = np.searchsorted(sent + true["command_delay_s"], times + DT / 2, side="right") - 1
    aim = np.where(heard[:, None] >= 0, aims[np.maximum(heard, 0)], 0.0)
    most = np.array([true["linear_acceleration"], true["angular_acceleration"]]) * DT
    speeds = np.zeros((len(times), 2))
    _march(aim, DT / max(true["actuator_lag"], DT), most, speeds)
    return np.c_[times, speeds]


@numba.njit
def _march(aim: FloatArray, share: float, most: FloatArray, speeds: FloatArray) -> None:
    for row in range(1, len(aim)):
        for axis in range(2):
            change = (aim[row - 1, axis] - speeds[row - 1, axis]) * share
            change = min(max(change, -most[axis]), most[axis])
            speeds[row, axis] = speeds[row - 1, axis] + change


def judge(seed: int) -> dict[str, Any]:
    """Return for each quantity of one drive the truth, what was found and whether it holds."""
    robot, true, commands, odometry = drive(seed)
    began = time.process_time()
    fit = fit_base(commands, odometry, robot)
    rows: dict[str, Any] = {"seed": seed, "cpu_s": round(time.process_time() - began, 2)}
    for name, truth in true.items():
        value, low, high = fit.estimates[name]
        row: dict[str, Any] = {"true": truth, "found": value, "low": low, "high": high}
        # JSON has no infinity: what has no upper end is null.
        finite = {key: number for key, number in row.items() if math.isfinite(number)}
        row |= dict.fromkeys(row) | {key: float(f"{n:.5g}") for key, n in finite.items()}
        row["shown"] = name not in fit.not_shown
        rows[name] = row | {"holds": bool(low <= truth <= high)}
    return rows


def misses(drive: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the quantities of a drive whose interval does not hold the truth."""
    rows = {name: row for name, row in drive.items() if isinstance(row, dict)}
    return [
        {"seed": drive["seed"], "quantity": name} | row
        for name, row in rows.items()
        if row["shown"] and not row["holds"]
    ]


def summary(drives: list[dict[str, Any]]) -> dict[str, Any]:
    """Return for each quantity in how many drives it was shown, and how often its interval held."""
    result = {}
    for name in [key for key in drives[0] if isinstance(drives[0][key], dict)]:
        shown = [d[name] for d in drives if d[name]["shown"]]
        held = sum(row["holds"] for row in shown)
        errors = [abs(row["found"] - row["true"]) for row in shown]
        widths = [row["high"] - row["low"] for row in shown]
        result[name] = {
            "shown": len(shown),
            "held": held,
            "share_held": round(held / max(len(shown), 1), 3),
            "error_median": float(f"{np.median(errors):.3g}") if shown else None,
            "width_median": float(f"{np.median(widths):.3g}") if shown else None,
        }
    return result


def main() -> None:
    """Drive so many bases, and judge what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.drives)
    with ProcessPoolExecutor(arguments.jobs, initializer=os.nice, initargs=(1,)) as pool:
        drives = []
        for one in pool.map(judge, seeds):
            drives.append(one)
            print(f"{len(drives)} of {len(seeds)}", flush=True)
    cpu = [one["cpu_s"] for one in drives]
    write_report(
        arguments.out,
        {
            "summary": summary(drives),
            "fit_cpu_s": {"median": float(np.median(cpu)), "most": max(cpu)},
            "missed": [miss for one in drives for miss in misses(one)],
        },
    )


if __name__ == "__main__":
    main()
