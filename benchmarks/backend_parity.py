# SPDX-License-Identifier: Apache-2.0
"""How far robots in physics engines are from the same robot in the planar simulator.

python benchmarks/backend_parity.py --out benchmarks/results/backend_parity.json
python benchmarks/backend_parity.py --engines gazebo --out benchmarks/results/gazebo_parity.json

All get the same commands from the same pose; what is reported is how far apart they ever were. The
scans are those of the same poses in the same held-out worlds.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from report import write_report

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import BACKENDS, BackendName, make_simulator
from pm01_nav.robot import load_robot, robot_names
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.world import World

STOP = [(0.0, 0.0)] * 15
DRIVES = {
    "straight": [(1.0, 0.0)] * 50 + STOP,
    "arc": [(0.8, 0.5)] * 50 + STOP,
    "spin": [(0.0, 1.0)] * 50 + STOP,
    "stop and go": ([(1.0, 0.0)] * 8 + [(0.0, 0.0)] * 7) * 4,
}
"""Commands as parts of the robot's greatest v and w, ten a second."""
FIELD = World("field", (-40.0, -40.0, 40.0, 40.0), discs=np.array([[35.0, 35.0, 0.3]]))
SUITES = ("static", "rooms", "crowd", "barn_like")
WORLDS = 32
CLOSE = 0.01
"""Ranges that differ by less agree [m]."""


def trajectory(backend: BackendName, robot: str, drive: str) -> np.ndarray:
    """Return x, y, yaw, v, w after each step of a drive, shape (steps, 5)."""
    spec, pool = load_robot(robot), build_pool([FIELD], radius=0.5)
    simulator = make_simulator(backend, NUMPY, spec, pool, 1)
    simulator.seed([0])
    simulator.reset()
    simulator.place(np.array([0]), [[0.0, 0.0, 0.0]], [[5.0, 0.0]])
    greatest = np.array([spec.limits.linear_max, spec.limits.angular_max])
    rows = []
    for command in DRIVES[drive]:
        simulator.step([np.array(command) * greatest])
        rows.append(np.concatenate([simulator.state.pose[0], simulator.state.twist[0]]))
    return np.array(rows)


def compare(robot: str, drive: str, engine: BackendName) -> dict[str, float]:
    """Return how far apart the two robots ever were."""
    plane, body = trajectory("planar", robot, drive), trajectory(engine, robot, drive)
    apart = np.linalg.norm(body[:, :2] - plane[:, :2], axis=1)
    turned = (body[:, 2] - plane[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return {
        "way_m": round(0.1 * float(np.abs(plane[:, 3]).sum()), 3),
        "turn_rad": round(0.1 * float(np.abs(plane[:, 4]).sum()), 3),
        "apart_m": round(float(apart.max()), 4),
        "apart_rad": round(float(np.abs(turned).max()), 4),
        "speed_at_end_m_s": round(float(np.abs(body[-1, 3])), 4),
    }


def scans_in(pool: WorldPool, backend: BackendName) -> np.ndarray:
    """Return the first scan in each world, shape (WORLDS, num_beams) [m]."""
    at_once = min(WORLDS, BACKENDS[backend].most_robots or WORLDS)
    simulator = make_simulator(backend, NUMPY, load_robot("pm01"), pool, at_once)
    scans = []
    for begin in range(0, WORLDS, at_once):
        numbers = begin + np.arange(at_once)
        simulator.seed(numbers)
        simulator.reset(worlds=numbers)
        scans.append(simulator.scan.astype(np.float64))
    return np.concatenate(scans)


def compare_scans(suite: str, engine: BackendName) -> dict[str, float]:
    """Return how many beams agree, and how much the others differ."""
    task = task_config(suite)
    pool = world_pool(task, "held_out", WORLDS, 1)
    plane, body = scans_in(pool, "planar"), scans_in(pool, engine)
    both = np.isfinite(plane) & np.isfinite(body)
    off = np.abs(plane[both] - body[both])
    agree = (plane == body) | (both & (np.abs(np.where(both, plane - body, 0.0)) <= CLOSE))
    return {
        "beams": int(plane.size),
        "agree": round(float(agree.mean()), 5),
        "median_m": round(float(np.median(off)), 5),
        "p99_m": round(float(np.quantile(off, 0.99)), 5),
    }


def main() -> None:
    """Compare and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engines", nargs="+", default=["mujoco", "pybullet"])
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    drives: dict[str, Any] = {
        engine: {
            robot: {drive: compare(robot, drive, engine) for drive in DRIVES}
            for robot in robot_names()
        }
        for engine in options.engines
    }
    scans = {e: {suite: compare_scans(suite, e) for suite in SUITES} for e in options.engines}
    write_report(options.out, {"drives": drives, "scans": scans})


if __name__ == "__main__":
    main()
