# SPDX-License-Identifier: Apache-2.0
"""How fast Gazebo can be stepped: 4 ms physics, 360 beams at 10 Hz, 20 obstacles, no GPU.

python benchmarks/gazebo_speed.py --out benchmarks/results/gazebo_speed.json

Compared are the backend with one robot and with two, each with a task around it; a bare loop that
runs the same world for the same 0.1 s and waits for the same scans; and the usual way to train in
Gazebo, which sleeps for 0.1 s a step. The resets come last: memory of the server's process before
and after.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from gazebo_bare import open_bare
from report import write_report

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.backends.gazebo.engine import GazeboEngine
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.robot import load_robot
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.pool import WorldPool

OBSTACLES = 20
CONTROL_DT = 0.1
LOOPS = 60
"""Control steps of each repeat."""


def worlds() -> WorldPool:
    """Return rooms with 20 obstacles."""
    task = task_config("static")
    task = task.model_copy(update={"suite_params": {"obstacles": OBSTACLES}})
    return world_pool(task, "train", 64)


def robots(pool: WorldPool, num_envs: int) -> PhysicsSimulator:
    """Return robots in Gazebo, ready to step."""
    simulator = make_simulator("gazebo", NUMPY, load_robot("pm01"), pool, num_envs)
    assert isinstance(simulator, PhysicsSimulator)
    simulator.seed(np.arange(num_envs))
    simulator.reset()
    return simulator


def bare(pool: WorldPool) -> Callable[[], float]:
    """Return what measures the bare loop's real-time factor."""
    original = GazeboEngine.opener
    GazeboEngine.opener = staticmethod(open_bare)
    simulator = robots(pool, 1)
    GazeboEngine.opener = staticmethod(original)
    worker: Any = simulator._engine
    worker = worker._robots[0]._worker

    def measure() -> float:
        worker.send("bare_loop", LOOPS)
        return LOOPS * CONTROL_DT / worker.receive()

    # Whoever measures keeps the simulator alive.
    measure.simulator = simulator  # type: ignore[attr-defined]
    return measure


def stepped(simulator: PhysicsSimulator) -> Callable[[], float]:
    """Return what measures the real-time factor of robots that drive, all together."""
    rng = np.random.default_rng(0)
    count = simulator.num_envs

    def measure() -> float:
        began = time.perf_counter()
        for _ in range(LOOPS):
            simulator.step(rng.uniform([-0.2, -1.5], [0.5, 1.5], (count, 2)))
        return count * LOOPS * CONTROL_DT / (time.perf_counter() - began)

    return measure


def asleep() -> float:
    """Return the real-time factor of a step that publishes, sleeps for 0.1 s and reads."""
    began = time.perf_counter()
    for _ in range(20):
        time.sleep(CONTROL_DT)
    return 20 * CONTROL_DT / (time.perf_counter() - began)


def memory_mb(simulator: PhysicsSimulator) -> float:
    """Return what the server's process holds in memory [MB]."""
    engine: Any = simulator._engine
    return engine._robots[0]._worker.memory_mb


def reset_often(simulator: PhysicsSimulator, resets: int) -> dict[str, Any]:
    """Reset a robot over and over into other worlds; return memory and times."""
    engine: Any = simulator._engine
    process = engine._robots[0]._worker.process_id
    seconds, memory = [], [round(memory_mb(simulator), 1)]
    for number in range(resets):
        began = time.perf_counter()
        simulator.reset()
        seconds.append(time.perf_counter() - began)
        if (number + 1) % (resets // 10) == 0:
            memory.append(round(memory_mb(simulator), 1))
    return {
        "resets": resets,
        "median_ms": round(1e3 * statistics.median(seconds), 1),
        "memory_mb": memory,
        "same_process": engine._robots[0]._worker.process_id == process,
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--resets", type=int, default=1000)
    options = parser.parse_args()
    pool = worlds()
    one, two = robots(pool, 1), robots(pool, 2)
    ways = {
        "bare": bare(pool),
        "one_robot": stepped(one),
        "two_robots": stepped(two),
        "sleeping": asleep,
    }
    factors: dict[str, list[float]] = {name: [] for name in ways}
    # In turn, so that whatever else the machine does meets all of them.
    for _ in range(options.repeats):
        for name, measure in ways.items():
            factors[name].append(round(measure(), 2))
    medians = {name: round(statistics.median(values), 2) for name, values in factors.items()}
    results = {
        "real_time_factor": {n: {"median": medians[n], "repeats": v} for n, v in factors.items()},
        "part_of_the_bare_loop": round(medians["one_robot"] / medians["bare"], 3),
        "two_to_one": round(medians["two_robots"] / medians["one_robot"], 2),
        "steps_per_second": {n: round(m / CONTROL_DT, 1) for n, m in medians.items()},
        "resets": reset_often(one, options.resets),
    }
    write_report(options.out, results)


if __name__ == "__main__":
    main()
