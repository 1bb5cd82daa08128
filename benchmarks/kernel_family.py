# SPDX-License-Identifier: Apache-2.0
"""CPU time of simulator steps and resets of two checkouts, turn about on one core.

python benchmarks/kernel_family.py --before CHECKOUT --out benchmarks/results/kernel_family.json

Each checkout has a process of its own, with one thread, and is asked for a round in turn. What is
compared is the time of the process, which other work on the machine hardly touches.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

CASES = {"static": ("static", False), "crowd": ("crowd", False), "mixed_errors": ("mixed", True)}
ROBOT_STEPS = 16384
"""Steps of a robot in a round: of 256 robots 64 control steps, of 4096 four."""


def work(case: str, num_envs: int) -> None:
    """Answer each line of stdin with the seconds that a reset and the steps of a round took."""
    from pm01_nav.sim.simulator import PlanarSimulator
    from pm01_nav.task.config import observation_layout
    from pm01_nav.task.navigation import features
    from pm01_nav.task.randomization import default_randomization
    from pm01_nav.task.tasks import task_config
    from pm01_nav.task.worlds import world_pool

    name, errors = CASES[case]
    task = task_config(name).model_copy(update={"num_worlds": 64})
    robot, pool = task.robot_spec(), world_pool(task, "train", 64)
    wanted = features(task, observation_layout(task, robot))
    simulator = PlanarSimulator(robot, pool, num_envs, features=wanted)
    if errors:
        simulator.perturb(default_randomization().ranges(robot, simulator.control_dt))
    commands = np.random.default_rng(0).uniform([-0.1, -1.0], [0.5, 1.0], (32, num_envs, 2))
    for _ in sys.stdin:
        simulator.seed(np.arange(num_envs))
        began = time.process_time()
        simulator.reset()
        reset = time.process_time()
        for k in range(ROBOT_STEPS // num_envs):
            simulator.step(commands[k % 32])
        print(json.dumps([reset - began, time.process_time() - reset]), flush=True)


def start(checkout: str, case: str, num_envs: int) -> subprocess.Popen[str]:
    """Start a worker of a checkout."""
    environment = os.environ | {"PYTHONPATH": checkout, "NUMBA_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--worker", case, "--num-envs", str(num_envs)]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen(command, env=environment, text=True, **pipes)


def ask(worker: subprocess.Popen[str]) -> list[float]:
    """Return the seconds of a worker's next reset and steps."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    return json.loads(worker.stdout.readline())


def compare(before: str, case: str, num_envs: int, rounds: int) -> dict[str, Any]:
    """Return the microseconds a robot of both checkouts, and how much longer ours takes."""
    here = str(Path(__file__).parents[1])
    workers = [start(checkout, case, num_envs) for checkout in (before, here)]
    for worker in workers * 3:
        ask(worker)  # Compiles, then fills the caches.
    seconds = np.empty((2, rounds, 2))
    for k in range(rounds):
        for one in (0, 1) if k % 2 == 0 else (1, 0):
            seconds[one, k] = ask(workers[one])
    for worker in workers:
        worker.communicate()
    robots = np.array([num_envs, ROBOT_STEPS // num_envs * num_envs])
    per_robot = 1e6 * seconds / robots
    found: dict[str, Any] = {}
    for n, what in enumerate(("reset", "step")):
        old, new = per_robot[0, :, n], per_robot[1, :, n]
        found[what] = {
            "before_us": [round(float(f(old)), 4) for f in (np.median, np.min)],
            "after_us": [round(float(f(new)), 4) for f in (np.median, np.min)],
            "ratio_of_medians": round(float(np.median(new) / np.median(old)), 4),
            "ratio_of_minima": round(float(new.min() / old.min()), 4),
            "median_of_ratios": round(statistics.median(new / old), 4),
        }
    return found


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", help="checkout to compare this one with")
    parser.add_argument("--out")
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--num-envs", type=int, nargs="+", default=[256, 4096])
    parser.add_argument("--worker", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if options.worker:
        work(options.worker, options.num_envs[0])
        return
    from report import write_report

    results: dict[str, Any] = {"unit": "CPU time a robot [us]: median, minimum"}
    for case in CASES:
        for num_envs in options.num_envs:
            found = compare(options.before, case, num_envs, options.rounds)
            results[f"{case}_{num_envs}"] = found
    write_report(options.out, results)


if __name__ == "__main__":
    main()
