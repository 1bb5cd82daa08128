# SPDX-License-Identifier: Apache-2.0
"""An algorithm is one class, and is then known wherever algorithms are named."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pm01_nav import load_policy
from pm01_nav.cli import pm01
from pm01_nav.config import to_yaml, validate
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithm_config import AlgorithmConfig, Count
from pm01_nav.training.algorithms import ALGORITHMS, algorithm
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.algorithms.td3 import TD3Config
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.run_folder import RunFolder


class A2CConfig(AlgorithmConfig):
    n_envs: Count = 16
    batch_size: Count = 80
    learning_rate: float = 3e-3
    learning_rate_final: float = 1.0
    gamma: float = 0.9
    net_arch: tuple[Count, ...] = (16,)
    activation: str = "tanh"
    reward_scale: float = 1.0
    n_steps: Count = 5

    @property
    def samples(self) -> int:
        return self.n_envs * self.n_steps

    @staticmethod
    def implementation():
        return A2CAlgorithm()


class A2CAlgorithm:
    def make(self, config, env, layout, *, seed, learning_rate):
        from stable_baselines3 import A2C

        arguments = {"n_steps": config.n_steps, "gamma": config.gamma, "seed": seed}
        networks = {"net_arch": list(config.net_arch)}
        return A2C(
            "MlpPolicy",
            env,
            learning_rate=learning_rate,
            policy_kwargs=networks,
            device="cpu",
            **arguments,
        )

    def make_policy(self, config, layout):
        from stable_baselines3.common.policies import ActorCriticPolicy

        from pm01_nav.envs.spaces import action_space
        from pm01_nav.training.networks import network_space

        rate = lambda _: config.learning_rate  # noqa: E731
        space = network_space(config, layout)
        return ActorCriticPolicy(space, action_space(layout), rate, net_arch=list(config.net_arch))

    def state(self, model):
        from pm01_nav.training.learner import on_policy_state

        return on_policy_state(model)

    def restore(self, model, state):
        from pm01_nav.training.learner import restore_on_policy

        restore_on_policy(model, state)


@pytest.fixture
def _a2c(monkeypatch):
    monkeypatch.setitem(ALGORITHMS, "a2c", A2CConfig)  # to be taken out again
    algorithm("a2c")(A2CConfig)


def run(*arguments: object) -> str:
    done = CliRunner().invoke(pm01, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output or done.exception
    return done.output


@pytest.mark.usefixtures("_a2c")
def test_a_registered_algorithm_learns_by_the_ordinary_command(tmp_path: Path):
    # A probe: nothing pays but speed, so that the best policy drives at full speed.
    probe = ("--task", "empty", "--set", "task.rewards={speed: {weight: 1.0}}")
    probe += ("--set", "task.time_limit_s=2.0", "--set", "train.eval_episodes=2")
    few = ("--steps", 16_000, "--set", "train.a2c.n_steps=10", "--set", "train.eval_every=16000")
    run("train", *probe, "--algo", "a2c", *few, "--out", tmp_path / "x")
    stored = load_yaml(tmp_path / "x" / "config.yaml")["train"]
    assert (stored["a2c"]["n_steps"], stored["a2c"]["n_envs"]) == (10, 16)
    robot = load_robot("pm01")
    policy = load_policy(tmp_path / "x")
    scan = np.full(robot.lidar.num_beams, 5.0)
    speed, _ = policy.act(scan, np.array([3.0, 0.0]), np.array([0.0, 0.0]))
    assert speed > 0.8 * robot.limits.linear_max
    run("train", "--resume", tmp_path / "x", "--steps", 16_320)
    assert "a2c" in run("train", "--help")


def test_an_unknown_one_is_refused_with_those_of_the_table():
    allowed = "ppo, ppo_lstm, sac, td3, tqc"
    with pytest.raises(InputError, match=rf"algo = 'dqn': unknown; allowed: {allowed}$"):
        validate(TrainConfig, {"steps": 1, "algo": "dqn"}, "test")
    for key in ("dqn", "ppoo"):
        with pytest.raises(InputError, match=rf"{key}: unknown key; allowed here: algo, .*, tqc$"):
            validate(TrainConfig, {"steps": 1, key: {}}, "test")


def test_a_configuration_with_the_sections_of_all_algorithms_is_read(tmp_path: Path):
    """As runs, and sweeps above all, stored them before algorithms had a table."""
    sections = {n: ALGORITHMS[n].model_validate({}).model_dump(mode="json") for n in ALGORITHMS}
    sections["sac"]["gamma"] = 0.5
    train = {"algo": "sac", "steps": 1, **sections, "track": "none"}
    task = task_config("empty").model_dump(mode="json")
    (tmp_path / "config.yaml").write_text(to_yaml({"task": task, "train": train}))
    config = RunFolder(tmp_path).load_config()
    assert config.train.hyperparameters.gamma == 0.5
    assert config == validate(RunConfig, config.model_dump(mode="json"), "again")
    # A mistake in the section of another one is still a mistake.
    train["ppo"]["gamma"] = 2.0
    with pytest.raises(InputError, match=r"ppo.gamma = 2.0: .* less than or equal to 1"):
        validate(TrainConfig, train, "test")


def test_no_section_changes_another():
    quick = validate(TrainConfig, {"steps": 1, "preset": "quick"}, "test").hyperparameters
    usual = validate(TrainConfig, {"steps": 1}, "test").hyperparameters
    assert usual == PPOConfig.model_validate({})
    assert quick != usual


def test_actions_are_explored_in_all_directions_that_a_base_has():
    noise = TD3Config.model_validate({}).learner_arguments(3)["action_noise"]
    assert noise().shape == (3,)


def test_the_table_loads_no_torch():
    code = (
        "import sys; import pm01_nav.training.config; "
        "sys.exit(', '.join({'torch', 'stable_baselines3'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
