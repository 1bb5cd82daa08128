# SPDX-License-Identifier: Apache-2.0
"""How the CPU simulator scales: with robots side by side, with cores, and with Ray nodes.

python benchmarks/scaling.py --out benchmarks/results/scaling.json

Ray nodes are of this machine, one core each, and drive pieces of 256 robots. It needs Ray.
"""

from __future__ import annotations

import argparse
import os
import time
from importlib import import_module
from typing import Any

import numba
import numpy as np
from report import rate, write_report

from pm01_nav.executors import make_executor
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

PIECES, PIECE_ROBOTS, PIECE_STEPS = 8, 256, 2000


def batch_of(num_envs: int) -> NavigationBatch:
    """Return robots of the task ``static``."""
    task = task_config("static")
    batch = NavigationBatch(task, world_pool(task, "train", 256), num_envs)
    batch.reset(np.arange(num_envs))
    return batch


def measure(num_envs: int, threads: int, seconds: float) -> dict[str, Any]:
    """Step robots for a while; return environment steps a second and the memory of their state."""
    numba.set_num_threads(threads)
    batch = batch_of(num_envs)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (8, num_envs, 2))

    def run() -> None:
        for action in actions:
            batch.step(action)

    state = sum(array.nbytes for array in batch.state_dict().values())
    result = rate(run, num_envs * len(actions), seconds, repeats=5)
    return {"robots": num_envs, "threads": threads, "bytes_a_robot": state // num_envs} | result


def drive(_: int) -> int:
    """Drive a piece on the machine that this runs on; return its environment steps."""
    numba.set_num_threads(1)
    batch = batch_of(PIECE_ROBOTS)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (PIECE_STEPS, PIECE_ROBOTS, 2))
    for action in actions:
        batch.step(action)
    return PIECE_ROBOTS * PIECE_STEPS


def measure_ray(nodes: int) -> dict[str, Any]:
    """Drive ``PIECES`` pieces on a cluster of so many nodes of one core."""
    ray: Any = import_module("ray")
    cluster = import_module("ray.cluster_utils").Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1}
    )
    for _ in range(nodes - 1):
        cluster.add_node(num_cpus=1)
    try:
        executor = make_executor(1, cluster.address)
        list(executor.run(drive, range(2 * nodes)))  # starts the processes, loads the kernels
        began = time.perf_counter()
        steps = sum(done.result for done in executor.run(drive, range(PIECES)))
        seconds = time.perf_counter() - began
    finally:
        ray.shutdown()
        cluster.shutdown()
    return {"nodes": nodes, "steps_per_second": round(steps / seconds), "seconds": seconds}


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    results: dict[str, Any] = {"task": "static", "unit": "environment steps/s"}
    threads = sorted({1, min(2, os.cpu_count() or 1)})
    results["one_process"] = [
        measure(num_envs, count, options.seconds)
        for num_envs in (64, 256, 1024, 4096, 16384, 65536)
        for count in threads
    ]
    results["ray"] = [measure_ray(nodes) for nodes in (1, 2)]
    write_report(options.out, results)


if __name__ == "__main__":
    main()
