# SPDX-License-Identifier: Apache-2.0
"""Environment steps a second of simulator and task together, with random actions and auto-reset.

python benchmarks/throughput.py --barn barn_data --out benchmarks/results/throughput.json
... --irsim PYTHON --jaxnav PYTHON    measures the peers of benchmarks/peers in the same run
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from report import rate, write_report

from pm01_nav.robot import full_circle
from pm01_nav.sim.warm_up import warm_up
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.pool import WorldPool, generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.world import World

PEERS = Path(__file__).parent / "peers"


def twelve_discs(rng: np.random.Generator) -> World:
    """Draw a walled 10 m x 10 m room with exactly 12 discs of radius U(0.15, 0.5) m."""
    walls = np.array([[0, 0, 10, 0], [10, 0, 10, 10], [10, 10, 0, 10], [0, 10, 0, 0]], dtype=float)
    discs = np.column_stack([rng.uniform(0.5, 9.5, (12, 2)), rng.uniform(0.15, 0.5, 12)])
    return World("twelve_discs", (0.0, 0.0, 10.0, 10.0), discs=discs, segments=walls)


def with_beams(beams: int) -> TaskConfig:
    """Return the default task with a full-circle lidar; many beams are pooled to 36 sectors."""
    task = task_config("static").model_dump()
    task["robot_changes"] = {"lidar": full_circle(beams)}
    task["observation"]["sectors"] = 36 if beams % 36 == 0 else 0
    return TaskConfig.model_validate(task)


def measure(task: TaskConfig, pool: WorldPool, num_envs: int, seconds: float) -> dict[str, Any]:
    """Step ``num_envs`` robots for a while; return steps a second."""
    batch = NavigationBatch(task, pool, num_envs)
    batch.reset(np.arange(num_envs))
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1.0, 1.0, (num_envs, 2)) for _ in range(32)]

    def run() -> None:
        for action in actions:
            batch.step(action)

    return rate(run, num_envs * len(actions), seconds, repeats=7)


def measure_mixed(num_envs: int, seconds: float) -> dict[str, Any]:
    """Measure the task ``mixed`` with 72 sectors from 360 beams, and making 1024 of its worlds."""
    task = task_config("mixed")
    layout = task.observation.model_copy(update={"sectors": 72})
    task = task.model_copy(update={"observation": layout})
    radius = task.robot_spec().footprint.circumscribed_radius + task.margin

    def build(first: int, count: int) -> WorldPool:
        pool = generate_pool(suites()["mixed"].generator, range(first, first + count), radius)
        pool.arrays_for(task.robot_spec().lidar.range_max)
        return pool

    warm_up()
    build(1 << 41, 16)  # compiles what making worlds needs
    began = time.perf_counter()
    # Seeds that are never trained on, so that no cache can hold their worlds.
    pool = build(1 << 40, 1024)
    built = time.perf_counter() - began
    return measure(task, pool, num_envs, seconds) | {"pool_of_1024_worlds_s": round(built, 2)}


def measure_peer(python: str, script: str, *arguments: str) -> dict[str, Any]:
    """Run a peer's script in its own environment; return what it printed last."""
    command = [python, str(PEERS / script), *arguments]
    answer = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    return json.loads(answer.stdout.strip().splitlines()[-1])


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--barn", help="folder of the BARN dataset")
    parser.add_argument("--irsim", help="Python of an environment with ir-sim")
    parser.add_argument("--jaxnav", help="Python of an environment with jaxmarl")
    options = parser.parse_args()
    results: dict[str, Any] = {"num_envs": options.num_envs, "unit": "environment steps/s"}
    pool = generate_pool(twelve_discs, range(256), radius=0.27)
    for beams in (20, 360):
        task = with_beams(beams)
        results[f"{beams}_beams_12_discs"] = measure(task, pool, options.num_envs, options.seconds)
    results["mixed_72_sectors"] = measure_mixed(options.num_envs, options.seconds)
    if options.barn:
        barn = task_config("barn").model_copy(update={"worlds": options.barn})
        barn_pool = world_pool(barn, "held_out", 250)
        results["barn_720_beams"] = measure(barn, barn_pool, options.num_envs, options.seconds)
    if options.irsim:
        results["irsim_20_beams"] = measure_peer(options.irsim, "irsim_steps.py", "--beams", "20")
    if options.jaxnav:
        for reset in ("fresh", "bank"):
            results[f"jaxnav_20_beams_{reset}"] = measure_peer(
                options.jaxnav,
                "jaxnav_steps.py",
                *("--beams", "20", "--reset", reset, "--num-envs", "256", "1024"),
                *("--repeats", "3"),
            )
    # Once more at the end: the machine may have slowed down or sped up meanwhile.
    results["20_beams_12_discs_again"] = measure(
        with_beams(20), pool, options.num_envs, options.seconds
    )
    ours = results["20_beams_12_discs_again"]["median"]
    for name in [n for n in results if n.startswith(("irsim", "jaxnav"))]:
        results[f"ratio_to_{name}"] = round(ours / results[name]["env_steps_per_s"], 1)
    write_report(options.out, results)


if __name__ == "__main__":
    main()
