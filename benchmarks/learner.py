# SPDX-License-Identifier: Apache-2.0
"""What the environment costs the learner, what threads bring, and what a busy machine costs.

python benchmarks/learner.py --out benchmarks/results/learner.json
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import argparse
import multiprocessing
import statistics
import time
from typing import Any

import numpy as np
import torch
from report import write_report
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.train.config import PPOConfig
from pm01_nav.train.ppo import make_ppo
from pm01_nav.train.runtime import keep_freed_memory

ITERATIONS = 12


class IdleVecEnv(NavVecEnv):
    """A VecEnv of the same spaces that does nothing: the learner's own cost."""

    def reset(self) -> np.ndarray:
        """Return zeros."""
        self._observation = np.zeros((self.num_envs, self.batch.layout.size), dtype=np.float32)
        self._rewards = np.zeros(self.num_envs, dtype=np.float32)
        self._dones = np.zeros(self.num_envs, dtype=np.bool_)
        return self._observation.copy()

    def step_wait(self) -> Any:
        """Return zeros."""
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        return self._observation.copy(), self._rewards.copy(), self._dones.copy(), infos


def learning_rate_of(env: VecEnv, layout: Any, config: PPOConfig) -> float:
    """Return the learner's steps a second on ``env``."""
    model = make_ppo(config, env, layout, seed=0, progress=lambda: 0.0)
    samples = config.n_envs * config.n_steps
    model.learn(2 * samples)
    began = time.perf_counter()
    model.learn(ITERATIONS * samples)
    return ITERATIONS * samples / (time.perf_counter() - began)


def spin(stop: Any) -> None:
    """Keep one core busy."""
    while not stop.is_set():
        sum(range(10000))


def summarize(rates: list[float]) -> dict[str, Any]:
    """Return the median and all repeats."""
    return {"median": round(statistics.median(rates)), "repeats": [round(r) for r in rates]}


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    keep_freed_memory()
    config, task = PPOConfig(), task_config("static")
    batch = NavigationBatch(task, world_pool(task, "train", 256), config.n_envs)
    ours, idle = NavVecEnv(batch), IdleVecEnv(batch)
    rates: dict[str, list[float]] = {}
    for _ in range(options.repeats):
        for threads in (1, 2):
            torch.set_num_threads(threads)
            for name, env in (("ours", ours), ("idle", idle)):
                rate = learning_rate_of(env, batch.layout, config)
                rates.setdefault(f"{name}_{threads}_threads", []).append(rate)
    results: dict[str, Any] = {"unit": "learner steps/s", "task": "static"}
    results |= {name: summarize(values) for name, values in rates.items()}
    for threads in (1, 2):
        pairs = zip(rates[f"ours_{threads}_threads"], rates[f"idle_{threads}_threads"], strict=True)
        results[f"ours_over_idle_{threads}_threads"] = round(
            statistics.median(a / b for a, b in pairs), 3
        )
    results |= under_load(ours, batch.layout, config, options.repeats)
    write_report(options.out, results)


def under_load(env: VecEnv, layout: Any, config: PPOConfig, repeats: int) -> dict[str, Any]:
    """Measure beside another process that keeps every core busy, one spinning process a core."""
    results: dict[str, Any] = {}
    cores = len(os.sched_getaffinity(0))
    for threads in (1, 2):
        torch.set_num_threads(threads)
        alone, beside = [], []
        for _ in range(repeats):
            alone.append(learning_rate_of(env, layout, config))
            stop = multiprocessing.get_context("spawn").Event()
            others = [
                multiprocessing.get_context("spawn").Process(target=spin, args=(stop,))
                for _ in range(cores)
            ]
            for other in others:
                other.start()
            time.sleep(1.0)
            beside.append(learning_rate_of(env, layout, config))
            stop.set()
            for other in others:
                other.join()
        results[f"beside_busy_cores_{threads}_threads"] = summarize(beside)
        results[f"kept_beside_busy_cores_{threads}_threads"] = round(
            statistics.median(b / a for a, b in zip(alone, beside, strict=True)), 3
        )
    return results


if __name__ == "__main__":
    main()
