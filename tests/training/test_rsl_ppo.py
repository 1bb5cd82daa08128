# SPDX-License-Identifier: Apache-2.0
"""rsl_rl's PPO leaves the same files as SB3's, and its experience is what it says."""

from __future__ import annotations

import json
import time

import numpy as np
import onnxruntime
import pytest
import torch

from pm01_nav.config import validate
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.ppo import make_policy
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train

pytest.importorskip("rsl_rl", reason="needs the extra `gpu`")
from tensordict import TensorDict

from pm01_nav.training.rsl_ppo import (
    GROUP,
    Rollouts,
    copy_weights,
    make_algorithm,
    parameters,
)
from tests.training.progress import Quiet

SAMPLES = 32 * 16  # one iteration
PPO = {"n_envs": 32, "n_steps": 16, "batch_size": 256, "n_epochs": 2}


def config(iterations: int = 4, task: str = "static", **changes) -> RunConfig:
    settings = {
        "learner": "rsl_rl",
        "steps": iterations * SAMPLES,
        "eval_every": 2 * SAMPLES,
        "eval_episodes": 4,
        "threads": 1,
        "ppo": PPO,
    }
    small = task_config(task).model_copy(update={"num_worlds": 4, "time_limit_s": 3.0})
    return RunConfig(task=small, train=TrainConfig.model_validate(settings | changes))


def run(settings, folder, progress=None, **options):
    started = time.perf_counter()
    return train(settings, RunFolder(folder), progress or Quiet(), started_at=started, **options)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return folder, run(config(), folder)


def rollouts(task: str = "static") -> tuple[Rollouts, NavigationBatch]:
    settings = config(task=task)
    ppo, pool = settings.train.ppo, world_pool(settings.task, "train", 4)
    batch = NavigationBatch(settings.task, pool, 32)
    made = Rollouts(make_algorithm(ppo, batch, torch.device("cpu")), batch, ppo)
    made.begin(batch.reset(np.arange(32)))
    return made, batch


def test_run_leaves_the_files_of_any_run(uninterrupted):
    folder, result = uninterrupted
    assert result.steps == 4 * SAMPLES
    names = {path.name for path in folder.iterdir()}
    assert {"config.yaml", "last.pt", "best.pt", "history.json", "policy.onnx"} <= names
    history = json.loads((folder / "history.json").read_text())
    assert history["steps"] == [SAMPLES, 2 * SAMPLES, 3 * SAMPLES, 4 * SAMPLES]
    assert {"return", "length", "reward/goal", "eval_success_rate"} <= set(history)


def test_exported_policy_commands_what_the_network_says(uninterrupted):
    folder, _ = uninterrupted
    policy = OnnxPolicy(folder / "policy.onnx")
    observation = np.random.default_rng(0).uniform(-1, 1, (7, policy.layout.size))
    scale = np.array(policy.layout.scale)
    best = torch.load(folder / "best.pt", weights_only=True)["policy"]
    hidden = torch.from_numpy(observation).float()
    for layer in ("mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2"):
        hidden = torch.relu(hidden @ best[f"{layer}.weight"].T + best[f"{layer}.bias"])
    mean = (hidden @ best["action_net.weight"].T + best["action_net.bias"]).clamp(-1, 1).numpy()
    # v from -0.2 to 0.5 m/s, w from -1.5 to 1.5 rad/s.
    expected = np.stack([0.35 * mean[:, 0] + 0.15, 1.5 * mean[:, 1]], axis=-1)
    session = onnxruntime.InferenceSession(folder / "policy.onnx")
    (actual,) = session.run(None, {"observation": (observation * scale).astype(np.float32)})
    np.testing.assert_allclose(actual, expected, atol=1e-5)


def test_interrupted_and_resumed_run_equals_the_uninterrupted_one(uninterrupted, tmp_path):
    folder, _ = uninterrupted
    stopped = run(config(), tmp_path / "x", Quiet(interrupt_after=2))
    assert stopped.interrupted
    assert run(config(), tmp_path / "x", resume=True).steps == 4 * SAMPLES
    whole = torch.load(folder / "last.pt", weights_only=True)["policy"]
    parts = torch.load(tmp_path / "x" / "last.pt", weights_only=True)["policy"]
    assert all(torch.equal(whole[name], parts[name]) for name in whole)


def test_weights_go_to_sb3_and_back():
    made, _ = rollouts()
    algorithm = made._algorithm
    before = {name: value.detach().clone() for name, value in parameters(algorithm).items()}
    policy = make_policy(config().train.ppo, made._batch.layout)
    assert set(before) == set(policy.state_dict())
    copy_weights(policy, algorithm)
    observation = torch.rand(5, made._batch.layout.size)
    grouped = TensorDict({GROUP: observation}, batch_size=[5])
    mean = policy.get_distribution(observation).distribution.mean
    torch.testing.assert_close(algorithm.actor(grouped), mean)
    torch.testing.assert_close(algorithm.critic(grouped), policy.predict_values(observation))


@pytest.mark.parametrize("task", ["static", "article"])
def test_experience_is_what_the_task_says(task):
    """Repeat a rollout's actions one by one: same observations, scaled rewards and ends."""
    made, batch = rollouts(task)
    episodes = made.collect()
    again = NavigationBatch(batch.config, batch.simulator.pool, 32)
    observation = again.reset(np.arange(32))
    storage, ended = made._algorithm.storage, 0
    for t in range(16):
        shown = observation if again.layout.normalize else observation / again.layout.scale
        np.testing.assert_allclose(storage.observations[GROUP][t], shown, atol=1e-6)
        step = again.step(storage.actions[t].double().numpy())
        done = step.terminated | step.truncated
        ended += int(done.sum())
        assert np.array_equal(storage.dones[t, :, 0].numpy().astype(bool), done)
        # A time-out is not the end of the world: what was still to be had is added.
        worth = 0.995 * storage.values[t, :, 0].numpy() * step.truncated
        np.testing.assert_allclose(storage.rewards[t, :, 0], 0.02 * step.reward + worth, atol=1e-5)
        observation = step.observation
    assert (0 if episodes is None else len(episodes.indices)) == ended


def test_device_cuda_without_a_gpu_says_what_is_missing(tmp_path):
    if torch.cuda.is_available():
        pytest.skip("there is a GPU")
    with pytest.raises(InputError, match="device = 'cuda'"):
        run(config(device="cuda"), tmp_path / "x")
    with pytest.raises(InputError, match="needs learner = rsl_rl"):
        validate(TrainConfig, {"steps": 1, "device": "cuda"}, "test")
