# SPDX-License-Identifier: Apache-2.0
"""Settings for training in Gazebo, and training itself with servers that play its part."""

from __future__ import annotations

import pytest

from pm01_nav.backends import BACKENDS
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.config import run_config

GAZEBO = task_config("static").model_copy(update={"backend": "gazebo"})


def test_a_robot_a_core_and_looks_that_take_minutes() -> None:
    config = run_config(GAZEBO, {"steps": 1000}, "test")
    assert config.train.ppo.n_envs == BACKENDS["gazebo"].most_robots
    assert config.train.eval_episodes == 20
    planar = run_config(task_config("static"), {"steps": 1000}, "test")
    assert planar.train.ppo.n_envs == 512


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_what_is_given_goes_over_it(algo: str) -> None:
    usual = run_config(GAZEBO, {"steps": 1000, "algo": algo}, "test").train.hyperparameters
    assert usual.n_envs == BACKENDS["gazebo"].most_robots
    config = run_config(GAZEBO, {"steps": 1000, "algo": algo, algo: {"n_envs": 4}}, "test")
    assert config.train.hyperparameters.n_envs == 4
