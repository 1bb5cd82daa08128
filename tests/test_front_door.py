# SPDX-License-Identifier: Apache-2.0
"""What ``import pm01_nav`` offers in one line."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import pm01_nav
from pm01_nav.errors import InputError


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
        (lambda: pm01_nav.load_policy("zoo:nobody"), "zoo:nobody"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(call, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        call()
    assert not list(tmp_path.iterdir())
