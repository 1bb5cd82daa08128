# SPDX-License-Identifier: Apache-2.0
"""What ``import pm01_nav`` offers in one line."""

from __future__ import annotations

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import pm01_nav
from pm01_nav.errors import InputError
from pm01_nav.task.tasks import task_config


def test_importing_the_package_loads_nothing_heavy():
    # In a process of its own: here everything is loaded already.
    code = (
        "import sys; before = set(sys.modules); import pm01_nav; dir(pm01_nav); "
        "print({m.split('.')[0] for m in set(sys.modules) - before} - sys.stdlib_module_names)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "{'pm01_nav'}"


def test_everything_it_names_is_there_and_stays_there():
    import pm01_nav.training.trainer  # a submodule must not take a function's name

    for name in pm01_nav.__all__:
        assert getattr(pm01_nav, name) is not None
        assert name in dir(pm01_nav)
    assert all(callable(getattr(pm01_nav, name)) for name in ("train", "evaluate", "make_env"))
    with pytest.raises(AttributeError, match="nothing_such"):
        _ = pm01_nav.nothing_such


def test_make_env_and_make_vec_are_the_same_robots():
    sb3 = pm01_nav.make_env("empty", num_envs=3, seed=5, reward_scale=1.0, num_worlds=2)
    vec = pm01_nav.make_vec("empty", num_envs=3, num_worlds=2)
    seen, (expected, _) = sb3.reset(), vec.reset(seed=5)
    np.testing.assert_array_equal(seen, expected)
    action = np.full((3, 2), 0.5, dtype=np.float32)
    _, rewards, _, _ = sb3.step(action)
    np.testing.assert_allclose(rewards, vec.step(action)[1], rtol=1e-6)


def test_train_load_evaluate(tmp_path):
    file = pm01_nav.train(
        tmp_path / "run",
        "empty",
        steps=4096,
        eval_episodes=10,
        ppo={"n_envs": 64, "n_steps": 16, "batch_size": 512},
    )
    assert file == tmp_path / "run" / "policy.onnx"
    policy = pm01_nav.load_policy(tmp_path / "run")
    assert policy.act(np.full(360, 3.0), (1.0, 0.0), (0.0, 0.0)).shape == (2,)
    # Without a task it is the policy's own.
    figures = pm01_nav.evaluate(file, episodes=10)
    same = pm01_nav.evaluate(file, "empty", episodes=10)
    for name in ("episodes", "success_rate", "collision_rate"):
        assert figures[name] == same[name]
    assert figures["episodes"] == 10


def test_settings_go_where_the_command_line_puts_them(tmp_path):
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.training.config import TrainConfig
    from pm01_nav.training.run_folder import RunFolder

    # A key tells by its name alone whether it is the task's or the training's.
    assert not TaskConfig.model_fields.keys() & TrainConfig.model_fields.keys()
    pm01_nav.train(
        tmp_path / "run",
        "empty",
        n_envs=64,
        steps=1024,
        eval_episodes=2,
        goal_radius=0.5,
        randomization="on",
        ppo={"n_steps": 16, "batch_size": 512},
    )
    config = RunFolder(tmp_path / "run").load_config()
    assert (config.task.goal_radius, config.train.ppo.n_envs) == (0.5, 64)
    assert config.task.randomization is not None
    # Measured without its randomization, with the goal radius that it was trained with.
    figures = pm01_nav.evaluate(tmp_path / "run", "empty", episodes=2, goal_radius=0.4)
    assert figures["episodes"] == 2


def test_one_environment_has_few_worlds_and_a_batch_all_of_them():
    def worlds(env):
        return env.unwrapped.batch.config.num_worlds

    one = "pm01_nav.envs:PM01Nav-v1"
    assert worlds(gym.make(one)) == 32
    assert worlds(gym.make(one, task="empty")) == 1
    assert worlds(gym.make(one, num_worlds=40)) == 40
    # A task that is given whole is taken as it is.
    assert worlds(gym.make(one, task=task_config("static"))) == 1024
    batch = pm01_nav.make_vec("static", 8)
    batch.reset(seed=0)
    assert worlds(batch) == 1024
    # As it was when one environment had 1024 worlds, too.
    assert batch.batch.simulator.state.world.tolist() == [142, 710, 101, 337, 464, 668, 827, 624]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pm01_nav.make_env("nonsense"), "nonsense"),
        (lambda: pm01_nav.make_env(num_envs=0), "num_envs = 0"),
        (lambda: pm01_nav.make_env(goal_radios=1.0), "goal_radios"),
        (lambda: pm01_nav.make_vec("static", 0), "num_envs = 0"),
        (lambda: pm01_nav.train("x", gama=1.0), "gama"),
        (lambda: pm01_nav.evaluate("zoo:nobody"), "zoo:nobody"),
        (lambda: pm01_nav.evaluate("goal_seeking", episodes=0), "episodes = 0"),
        (lambda: pm01_nav.evaluate("goal_seeking"), "task"),
        (lambda: pm01_nav.evaluate("goal_seeking", "empty", look_ahead=1.0), "look-ahead = 1"),
        (lambda: pm01_nav.evaluate("goal_seeking", "empty", seed=-1), "seed = -1"),
        (lambda: pm01_nav.train("x", robot="nobody"), "nobody"),
        (lambda: pm01_nav.load_policy("zoo:nobody"), "zoo:nobody"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(call, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        call()
    assert not list(tmp_path.iterdir())
