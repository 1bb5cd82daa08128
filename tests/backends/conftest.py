# SPDX-License-Identifier: Apache-2.0
"""Robots in engines, and beside them in the plane."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.robot import load_robot
from pm01_nav.sim.simulator import Simulator
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

HALL = World("hall", (-10.0, -10.0, 10.0, 10.0), discs=np.array([[8.0, 8.0, 0.3]]))
Make = Callable[..., Simulator]


@pytest.fixture(params=["mujoco", "pybullet"])
def engine(request: pytest.FixtureRequest) -> str:
    """The name of an engine that is installed."""
    # Not imported here: MuJoCo decides then how to draw, and the backend has a say in it.
    if find_spec(request.param) is None:
        pytest.skip(f"needs {request.param} (extra physics)")
    return request.param


@pytest.fixture(scope="session")
def make() -> Make:
    """Return a function that makes robots at rest, with their goals 5 m to the left."""

    def run(
        backend: str,
        poses: list[list[float]],
        world: World = HALL,
        robot: str = "pm01",
        **changes: object,
    ) -> Simulator:
        spec = load_robot(robot).model_copy(update=changes)
        pool = build_pool([world], radius=0.3)
        simulator = make_simulator(backend, NUMPY, spec, pool, len(poses))
        count = len(poses)
        simulator.seed(np.arange(count))
        simulator.reset()
        simulator.place(np.arange(count), poses, [[x, y + 5.0] for x, y, _ in poses])
        return simulator

    return run
