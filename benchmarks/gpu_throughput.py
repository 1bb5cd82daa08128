# SPDX-License-Identifier: Apache-2.0
"""Speed on an NVIDIA GPU: simulator, environment with task layer, learner, and time to 99 %.

python benchmarks/gpu_throughput.py --out benchmarks/results/gpu_throughput.json
python benchmarks/gpu_throughput.py --parts simulator --envs 1024 65536 --out ...
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from learning import run as train_and_evaluate
from report import write_report
from throughput import twelve_discs, with_beams

from pm01_nav.arrays import Arrays
from pm01_nav.config import merge, validate
from pm01_nav.envs.devices import arrays_on
from pm01_nav.sim.cuda_simulator import CudaSimulator
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import TrainConfig, device_defaults
from pm01_nav.training.rsl_ppo import Rollouts, make_algorithm
from pm01_nav.worlds.pool import WorldPool, generate_pool

PARTS = ("simulator", "environment", "learner", "time_to_99")
WARM_UP, STEPS, REPEATS = 20, 50, 5
LARGE = {"n_envs": 65536, "n_steps": 28, "batch_size": 458752, "n_epochs": 4}
"""PPO at the most steps a second; ``device_defaults`` are for the fewest seconds to a policy."""


def rates(function: Callable[[], Any], steps: int) -> dict[str, Any]:
    """Call a function that makes so many steps; return steps a second, median and all repeats."""
    for _ in range(WARM_UP):
        function()
    found = []
    for _ in range(REPEATS):
        torch.cuda.synchronize()
        began = time.perf_counter()
        for _ in range(STEPS):
            function()
        torch.cuda.synchronize()
        found.append(STEPS * steps / (time.perf_counter() - began))
    return {"median": round(float(np.median(found))), "repeats": [round(r) for r in found]}


def random_actions(num_envs: int, on: Arrays) -> Any:
    """Return actions (num_envs, 2) in [-1, 1] on the GPU."""
    return 2.0 * torch.rand(num_envs, 2, dtype=torch.float64, device=on.place) - 1.0


def simulator_speed(pool: WorldPool, num_envs: int, beams: int, on: Arrays) -> dict[str, Any]:
    """Measure steps of the simulator alone."""
    robot = with_beams(beams).robot_spec()
    simulator = CudaSimulator(robot, pool, num_envs, arrays=on, goal_distance=(2.0, np.inf))
    simulator.seed(np.arange(num_envs))
    simulator.reset()
    command = random_actions(num_envs, on)
    return rates(lambda: simulator.step(command), num_envs)


def environment_speed(pool: WorldPool, num_envs: int, beams: int, on: Arrays) -> dict[str, Any]:
    """Measure steps with observations, rewards and automatic resets; launched, and as a graph."""
    batch = NavigationBatch(with_beams(beams), pool, num_envs, arrays=on)
    batch.reset(np.arange(num_envs))
    action = random_actions(num_envs, on)
    launched = rates(lambda: batch.step(action), num_envs)
    batch.step_all(action)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        batch.step_all(action)
    return {"launched": launched, "graph": rates(graph.replay, num_envs)}


def learner_speed(num_envs: int, on: Arrays) -> dict[str, Any]:
    """Measure training on `static` end to end: rollouts and updates."""
    settings = merge(device_defaults("cuda"), {"device": "cuda", "steps": 1})
    batch_size = LARGE["batch_size"] * num_envs // LARGE["n_envs"]
    large = {**LARGE, "n_envs": num_envs, "batch_size": batch_size}
    config = validate(TrainConfig, merge(settings, {"ppo": large}), "benchmark").hyperparameters
    task = task_config("static")
    batch = NavigationBatch(task, world_pool(task, "train", task.num_worlds), num_envs, arrays=on)
    torch.set_float32_matmul_precision("high")
    algorithm = make_algorithm(config, batch, torch.device(on.place))
    rollouts = Rollouts(algorithm, batch, config)
    rollouts.begin(on.to_numpy(batch.reset(np.arange(num_envs))))
    seconds: dict[str, list[float]] = {"rollout": [], "update": []}
    for _ in range(12):
        torch.cuda.synchronize()
        began = time.perf_counter()
        rollouts.collect()
        torch.cuda.synchronize()
        collected = time.perf_counter()
        algorithm.update()
        torch.cuda.synchronize()
        seconds["rollout"].append(collected - began)
        seconds["update"].append(time.perf_counter() - collected)
    rollout, update = (float(np.median(times[4:])) for times in seconds.values())
    samples = num_envs * config.n_steps
    return {
        "median": round(samples / (rollout + update)),
        "rollout_s": round(rollout, 4),
        "update_s": round(update, 4),
        "ppo": large,
    }


def time_to_99(seeds: int, budget: float) -> list[dict[str, Any]]:
    """Train `static` for ``budget`` seconds of the command; evaluate on 1000 held-out worlds."""
    with tempfile.TemporaryDirectory() as folder:
        options = ("--device", "cuda")
        # Once before, so that everything is compiled and all worlds are there.
        train_and_evaluate("static", budget, 0, 16, Path(folder) / "first", options)
        runs = []
        for seed in range(seeds):
            path = Path(folder) / str(seed)
            runs.append(train_and_evaluate("static", budget, seed, 1000, path, options))
            print(runs[-1], flush=True)
        return runs


def gpu() -> dict[str, str]:
    """Return the GPU's name and its driver's version."""
    command = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    name, driver = answer.stdout.strip().splitlines()[0].split(", ")
    return {"name": name, "driver": driver, "cuda": str(torch.version.cuda)}


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--envs", type=int, nargs="+", default=[64, 1024, 8192, 65536])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=float, default=15.0)
    options = parser.parse_args()
    on = arrays_on("cuda")
    pool = generate_pool(twelve_discs, range(256), radius=0.27)
    results: dict[str, Any] = {"gpu": gpu(), "unit": "steps/s"}
    for name, measure in (("simulator", simulator_speed), ("environment", environment_speed)):
        for beams in (20, 360):
            for count in options.envs if name in options.parts else ():
                key = f"{name}_{beams}_beams_{count}_envs"
                results[key] = measure(pool, count, beams, on)
                print(key, results[key], flush=True)
    for count in options.envs if "learner" in options.parts else ():
        results[f"learner_{count}_envs"] = learner_speed(count, on)
        print(f"learner_{count}_envs", results[f"learner_{count}_envs"], flush=True)
    if "time_to_99" in options.parts:
        results["static"] = time_to_99(options.seeds, options.budget)
    write_report(options.out, results)


if __name__ == "__main__":
    main()
