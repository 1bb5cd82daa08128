# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: E402 - the waiting of threads is decided before torch and numba are imported
"""What the environment costs the learner, what threads bring, and what a busy machine costs.

python benchmarks/learner.py --out benchmarks/results/learner.json
"""

from __future__ import annotations

from pm01_nav.openmp import wait_briefly

wait_briefly()  # as the command line does

import argparse
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from report import write_report
from stable_baselines3 import PPO

from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.ppo import PPOAlgorithm
from pm01_nav.training.runtime import keep_freed_memory


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


def seconds_of(models: list[PPO], repeats: int) -> np.ndarray:
    """Return how long each model takes to learn from one batch [s], shape (repeats, models).

    They take turns: a machine that slows down for a while slows down all of them.
    """
    seconds = np.zeros((repeats + 2, len(models)))
    for row in seconds:
        for i, model in enumerate(models):
            began = time.perf_counter()
            model.learn(model.n_steps * model.n_envs, reset_num_timesteps=False)
            row[i] = time.perf_counter() - began
    return seconds[2:]


def spin(stop: Any) -> None:
    """Keep one core busy."""
    while not stop.is_set():
        sum(range(10000))


def rates(seconds: np.ndarray, samples: int) -> dict[str, Any]:
    """Return steps a second: the median, and the quartiles around it."""
    low, middle, high = np.quantile(samples / seconds, (0.25, 0.5, 0.75))
    return {"median": round(middle), "quartiles": [round(low), round(high)]}


def cost_of_environment(
    config: PPOConfig, batch: NavigationBatch, threads: int, repeats: int
) -> dict[str, Any]:
    """Compare a learner on our environment with one on an environment that does nothing."""
    torch.set_num_threads(threads)
    models = [
        PPOAlgorithm().make(
            config, env, batch.layout, seed=0, learning_rate=lambda _: config.learning_rate
        )
        for env in (NavVecEnv(batch), IdleVecEnv(batch))
    ]
    seconds = seconds_of(models, repeats)
    samples = config.n_envs * config.n_steps
    return {
        "ours": rates(seconds[:, 0], samples),
        "idle": rates(seconds[:, 1], samples),
        "ours_over_idle": round(float(np.median(seconds[:, 1] / seconds[:, 0])), 3),
    }


def cost_of_company(
    config: PPOConfig, batch: NavigationBatch, threads: int, repeats: int, rounds: int = 5
) -> dict[str, Any]:
    """Compare a learner alone with one beside processes that keep every core busy."""
    torch.set_num_threads(threads)
    model = PPOAlgorithm().make(
        config,
        NavVecEnv(batch),
        batch.layout,
        seed=0,
        learning_rate=lambda _: config.learning_rate,
    )
    samples = config.n_envs * config.n_steps
    alone, beside = [], []
    for _ in range(rounds):
        alone.append(np.median(seconds_of([model], repeats)))
        with busy_cores():
            beside.append(np.median(seconds_of([model], repeats)))
    kept = np.median(np.array(alone) / np.array(beside))
    return {
        "alone": rates(np.array(alone), samples),
        "beside_busy_cores": rates(np.array(beside), samples),
        "kept": round(float(kept), 3),
    }


@contextmanager
def busy_cores() -> Iterator[None]:
    """Keep every core busy with a process of its own for a while."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    others = [context.Process(target=spin, args=(stop,)) for _ in os.sched_getaffinity(0)]
    for other in others:
        other.start()
    time.sleep(1.0)
    try:
        yield
    finally:
        stop.set()
        for other in others:
            other.join()


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--repeats", type=int, default=40, help="batches that each model learns")
    options = parser.parse_args()
    keep_freed_memory()
    config, task = PPOConfig.model_validate({}), task_config("static")
    batch = NavigationBatch(task, world_pool(task, "train", 256), config.n_envs)
    results: dict[str, Any] = {"unit": "learner steps/s", "task": task.name}
    results["settings"] = config.model_dump(include={"n_envs", "n_steps", "batch_size", "n_epochs"})
    for threads in (1, 2):
        results[f"learner_threads_{threads}"] = cost_of_environment(
            config, batch, threads, options.repeats
        ) | cost_of_company(config, batch, threads, options.repeats // 4)
    write_report(options.out, results)


if __name__ == "__main__":
    main()
