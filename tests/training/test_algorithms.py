# SPDX-License-Identifier: Apache-2.0
"""Every algorithm and network: it resumes as if never stopped, and its file drives alike."""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
import torch

from pm01_nav.policy import OnnxPolicy
from pm01_nav.policy.export import greedy_policy
from pm01_nav.task.config import observation_layout
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.checkpoint import load_checkpoint
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.environment import stored_statistics
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet

SAMPLES = 8 * 16  # one iteration
ON_POLICY = {"n_envs": 8, "n_steps": 16, "batch_size": 64, "n_epochs": 2, "net_arch": [16]}
OFF_POLICY = {
    "n_envs": 8,
    "train_freq": 4,
    "log_interval": 4,
    "gradient_steps": 2,
    "batch_size": 32,
    "learning_starts": 40,
    "buffer_size": 400,
    "net_arch": [16],
}
MORE = {"ppo_lstm": {"lstm_hidden_size": 8, "n_lstm_layers": 2}, "tqc": {"n_quantiles": 5}}
NETWORKS = {
    "flat": {},
    "conv": {"features_extractor": "circular_conv"},
    "normalized": {"norm_obs": True, "norm_reward": True},
    "asymmetric": {"asymmetric_critic": True},
    "all": {
        "features_extractor": "circular_conv",
        "norm_obs": True,
        "norm_reward": True,
        "asymmetric_critic": True,
    },
}
# Every algorithm with nothing and with everything; each network alone with PPO.
CASES = [(a, n) for a in ALGORITHMS for n in ("flat", "all")]
CASES += [("ppo", n) for n in ("conv", "normalized", "asymmetric")]


def config(algo: str, network: str, iterations: int = 4) -> RunConfig:
    small = OFF_POLICY if ALGORITHMS[algo].off_policy else ON_POLICY
    settings = {
        "algo": algo,
        "steps": iterations * SAMPLES,
        "eval_every": 2 * SAMPLES,
        "eval_episodes": 2,
        "threads": 1,
        algo: small | MORE.get(algo, {}) | NETWORKS[network],
    }
    task = task_config("static").model_copy(update={"num_worlds": 2, "time_limit_s": 2.0})
    return RunConfig(task=task, train=TrainConfig.model_validate(settings))


def run(settings, folder, progress=None, **options):
    started = time.perf_counter()
    return train(settings, RunFolder(folder), progress or Quiet(), started_at=started, **options)


def curve(folder):
    history = json.loads((folder / "history.json").read_text())
    return {name: values for name, values in history.items() if "seconds" not in name}


def same(first, second) -> bool:
    """Compare nested data of tensors, numbers and strings."""
    if isinstance(first, torch.Tensor):
        return torch.equal(first, second)
    if isinstance(first, dict):
        return set(first) == set(second) and all(same(first[k], second[k]) for k in first)
    if isinstance(first, (list, tuple)):
        return len(first) == len(second) and all(map(same, first, second))
    return first == second


@pytest.mark.parametrize(("algo", "network"), CASES)
def test_resumed_run_equals_the_uninterrupted_one_and_its_file_drives_alike(
    algo, network, tmp_path
):
    settings = config(algo, network)
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert run(settings, whole).steps == 4 * SAMPLES
    assert run(settings, parts, Quiet(interrupt_after=2)).steps == 2 * SAMPLES
    assert run(settings, parts, resume=True).steps == 4 * SAMPLES
    first, second = (torch.load(f / "last.pt", weights_only=True) for f in (whole, parts))
    for part in ("policy", "learner", "environment", "batch", "last_obs", "random"):
        assert same(first[part], second[part]), part
    assert curve(whole) == curve(parts)
    check_file(settings, whole)


def check_file(settings: RunConfig, folder) -> None:
    """Drive with the file and with the policy in torch: the same commands for the same scans."""
    data = load_checkpoint(folder / "best.pt")
    layout = observation_layout(settings.task, settings.task.robot_spec())
    chosen = settings.train.hyperparameters
    policy = chosen.implementation().make_policy(chosen, layout)
    policy.load_state_dict(data["policy"])
    statistics = stored_statistics(data["environment"])
    assert (statistics is not None) == chosen.norm_obs
    in_torch = greedy_policy(policy, layout, 0.1, statistics)
    in_file = OnnxPolicy(folder / "policy.onnx")
    assert in_file.metadata["algorithm"] == settings.train.algo
    rng = np.random.default_rng(0)
    for count in (3, 3, 2):
        if count == 2:
            for driver in (in_torch, in_file):
                driver.keep(np.array([0, 2]))
        scan = rng.uniform(0.2, 3.5, (count, 360)).astype(np.float32)
        goal, velocity = rng.uniform(-3, 3, (count, 2)), rng.uniform(-0.2, 0.5, (count, 2))
        expected = in_torch.act(scan, goal, velocity)
        assert in_file.act(scan, goal, velocity) == pytest.approx(expected, abs=1e-5)
        limits = layout.drive
        assert (np.abs(expected[:, 1]) <= limits.angular_max + 1e-6).all()


def test_only_recurrent_policies_remember(tmp_path):
    run(config("ppo_lstm", "flat", 2), tmp_path / "x")
    policy = OnnxPolicy(tmp_path / "x" / "policy.onnx")
    assert policy.memory_size == 2 * 2 * 8  # hidden and cell of two layers of eight
    scan, goal, rest = np.full(360, 2.0), np.array([2.0, 1.0]), np.zeros(2)
    # The first answers are the same again after a reset; without one the memory tells.
    first = [policy.act(scan, goal, rest) for _ in range(3)]
    policy.reset()
    again = [policy.act(scan, goal, rest) for _ in range(3)]
    assert np.array_equal(first, again)
    alone = OnnxPolicy(tmp_path / "x" / "policy.onnx")
    alone.act(scan, goal, rest)
    alone._memory = None
    assert not np.array_equal(alone.act(scan, goal, rest), first[1])


def test_config_of_a_run_names_only_its_algorithm(tmp_path):
    settings = config("sac", "flat", 1)
    RunFolder(tmp_path / "x").create(settings)
    text = (tmp_path / "x" / "config.yaml").read_text()
    assert "  sac:" in text
    assert "  ppo:" not in text
    assert RunFolder(tmp_path / "x").load_config() == settings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algo": "dqn"}, "algo"),
        ({"algo": "sac", "sac": {"ent_coef": "much"}}, "ent_coef"),
        ({"algo": "sac", "sac": {"buffer_size": 10}}, "buffer_size"),
        ({"algo": "sac", "sac": {"n_epochs": 10}}, "n_epochs"),
        ({"ppo": {"conv": {"kernel_size": 4}}}, "odd"),
        ({"algo": "sac", "learner": "rsl_rl"}, "rsl_rl"),
        ({"learner": "rsl_rl", "ppo": {"norm_obs": True}}, "norm_obs"),
    ],
)
def test_impossible_settings_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        TrainConfig.model_validate({"steps": 10} | changes)
