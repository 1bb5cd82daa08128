# SPDX-License-Identifier: Apache-2.0
"""A backend is registered in one place, and is then known wherever backends are named."""

from __future__ import annotations

import pytest

from pm01_nav.backends import BACKENDS, backend
from pm01_nav.cli.options import task_from_options
from pm01_nav.envs.nav_env import NavEnv
from pm01_nav.errors import InputError
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.tasks import task_config
from pm01_nav.training.config import run_config

NONE = {"task": "empty", "config_file": None, "changes": ()}


class Ice(PlanarSimulator):
    """Another simulator, as a package of somebody else's would bring it."""


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
    assert isinstance(env.batch.simulator, Ice)
    assert run_config(task, {"steps": 1000}, "test").train.ppo.n_envs == 3


def test_an_unknown_backend_is_refused_with_those_of_the_table():
    allowed = "planar, mujoco, pybullet, gazebo, gazebo_transport"
    with pytest.raises(InputError, match=rf"task.backend = 'ice': unknown; allowed: {allowed}$"):
        task_from_options(task_config("empty"), backend="ice", **NONE)
