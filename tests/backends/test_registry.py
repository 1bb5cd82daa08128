# SPDX-License-Identifier: Apache-2.0
"""A backend is registered in one place, and is then known wherever backends are named."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.backends import BACKENDS, backend
from pm01_nav.cli.options import task_from_options
from pm01_nav.envs.nav_env import NavEnv
from pm01_nav.errors import InputError
from pm01_nav.sim.simulator import Simulator
from pm01_nav.task.tasks import task_config
from pm01_nav.training.config import run_config

NONE = {"task": "empty", "config_file": None, "changes": ()}


class Ice(Simulator):
    """Robots without grip, as a package of somebody else's would bring them."""

    def step(self, command) -> None:
        """Stand where the episode began."""
        self.checked(command)
        self.move_obstacles()
        self.perceive(np.arange(self.num_envs), first=False)


@pytest.fixture
def _ice():
    backend("ice", most_robots=3)(lambda _, *robots, **how: Ice(*robots, **how))
    yield
    del BACKENDS["ice"]


@pytest.mark.usefixtures("_ice")
def test_a_registered_backend_can_be_used_everywhere():
    task = task_from_options(None, backend="ice", **NONE)
    env = NavEnv(task)
    env.reset(seed=0)
    simulator = env.batch.simulator
    assert isinstance(simulator, Ice)
    goal = simulator.state.goal_polar.copy()
    _, _, terminated, truncated, _ = env.step(np.array([1.0, 0.0], dtype=np.float32))
    # It did not move, so the goal is where it was.
    assert simulator.state.goal_polar == pytest.approx(goal)
    assert not terminated
    assert not truncated
    assert run_config(task, {"steps": 1000}, "test").train.ppo.n_envs == 3


def test_an_unknown_backend_is_refused_with_those_of_the_table():
    allowed = "planar, mujoco, pybullet, gazebo, gazebo_transport"
    with pytest.raises(InputError, match=rf"task.backend = 'ice': unknown; allowed: {allowed}$"):
        task_from_options(task_config("empty"), backend="ice", **NONE)
