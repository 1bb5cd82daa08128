# SPDX-License-Identifier: Apache-2.0
"""Trainings learn: every algorithm what a probe asks for, and PPO to drive."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
import pytest

from pm01_nav.envs.vector_env import NavVectorEnv
from pm01_nav.policy import OnnxPolicy
from pm01_nav.task.config import RewardTerm, TaskConfig
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet

STEPS = {"ppo": 30_000, "ppo_lstm": 20_000, "sac": 12_000, "td3": 20_000, "tqc": 12_000}
SMALL: dict[str, Any] = {"n_envs": 32, "net_arch": [32, 32], "learning_rate": 3e-3}
ON_POLICY = SMALL | {"n_steps": 32, "batch_size": 256, "n_epochs": 5, "gamma": 0.9}
OFF_POLICY = SMALL | {"train_freq": 1, "gradient_steps": 1, "learning_starts": 500, "gamma": 0.9}
MORE: dict[str, Any] = {
    "ppo_lstm": {"lstm_hidden_size": 16},
    "td3": {"learning_rate": 1e-3, "gradient_steps": 2},
    "tqc": {"n_quantiles": 5, "top_quantiles_to_drop_per_net": 0, "gradient_steps": 2},
}


def probe() -> TaskConfig:
    """Return a task that asks for one thing: face the goal, wherever that is."""
    return task_config("empty").model_copy(
        update={
            "num_worlds": 4,
            "time_limit_s": 4.0,
            "goal_distance": (3.0, None),
            "rewards": {"heading": RewardTerm(weight=1.0)},
        }
    )


def learned(task: TaskConfig, algo: str, folder, **settings: Any) -> OnnxPolicy:
    """Train and return the policy's file, opened."""
    train_config = {"algo": algo, "threads": 1, "seed": 1, "eval_episodes": 2} | settings
    config = RunConfig(task=task, train=TrainConfig.model_validate(train_config))
    train(config, RunFolder(folder), Quiet(), started_at=time.perf_counter())
    return OnnxPolicy(folder / "policy.onnx")


def facing(policy: OnnxPolicy | None) -> float:
    """Return the mean reward of a probe's step; None stands for a robot that stands still."""
    env = NavVectorEnv(64, probe())
    env.reset(seed=11)
    simulator, total = env.batch.simulator, 0.0
    for _ in range(40):
        distance, bearing = simulator.state.goal_polar.T
        goal = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=-1)
        action = np.zeros((64, 2)) if policy is None else None
        if policy is not None:
            command = policy.act(simulator.scan, goal, simulator.state.twist)
            action = env.batch.layout.drive.to_action(command)
        total += env.step(action)[1].mean()
    return total / 40


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_every_algorithm_learns_to_face_the_goal(algo: str, tmp_path) -> None:
    settings = ON_POLICY if algo.startswith("ppo") else OFF_POLICY
    more = {"steps": STEPS[algo], "eval_every": STEPS[algo], algo: settings | MORE.get(algo, {})}
    policy = learned(probe(), algo, tmp_path / algo, **more)
    # Goals lie in any direction, so who stands faces them half. Who turns there at once at 1.5
    # rad/s has 0 to 2.1 s of 4 s to go: half of that time it is off by half of its first error,
    # 0.25 on average: 1 - 0.26 x 0.25 = 0.93. Here 0.85 to 0.89 were reached.
    assert facing(None) < 0.55
    assert facing(policy) > 0.75


@pytest.mark.slow
def test_ppo_learns_to_drive_among_obstacles(tmp_path) -> None:
    task = task_config("static")
    settings = {"steps": 500_000, "eval_every": 500_000, "eval_episodes": 512}
    learned(task, "ppo", tmp_path / "static", **settings)
    history = json.loads((tmp_path / "static" / "history.json").read_text())
    # 97 to 99 % by other seeds and machines; who drives straight at the goal reaches 55 %.
    assert history["eval_success_rate"][-1] > 0.9
