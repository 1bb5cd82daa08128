# SPDX-License-Identifier: Apache-2.0
"""Robots in Gazebo, and in servers that only play Gazebo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.backends.gazebo import GazeboEngine, GazeboSimulator
from pm01_nav.backends.gazebo_install import what_is_missing
from pm01_nav.backends.gazebo_robot import IDLE
from pm01_nav.robot import load_robot
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

HALL = World("hall", (-10.0, -10.0, 10.0, 10.0), discs=np.array([[8.0, 8.0, 0.3]]))
Make = Callable[..., GazeboSimulator]


def simulator_in(worlds: list[World], num_envs: int, robot: str = "pm01") -> GazeboSimulator:
    """Return robots in Gazebo, seeded with 0, 1, 2 ... and reset."""
    pool = build_pool(worlds, radius=0.3)
    simulator = GazeboSimulator(load_robot(robot), pool, num_envs)
    simulator.seed(np.arange(num_envs))
    simulator.reset()
    return simulator


@pytest.fixture(scope="session")
def hall() -> World:
    """A wide floor with one disc in a corner."""
    return HALL


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., GazeboSimulator]]:
    """Return a function that makes robots whose servers play their part (``played_server``)."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    import played_server

    def make(opener: str, num_envs: int = 1, worlds: tuple[World, ...] = (HALL,)):
        monkeypatch.setattr(GazeboEngine, "opener", staticmethod(getattr(played_server, opener)))
        return simulator_in(list(worlds), num_envs)

    yield make
    IDLE.close()


@pytest.fixture(scope="session")
def gazebo() -> Iterator[Make]:
    """Return a function that puts robots at rest into the real Gazebo."""
    missing = what_is_missing()
    if missing is not None:
        pytest.skip(f"needs Gazebo Harmonic: {missing}")

    def make(
        poses: list[list[float]], world: World = HALL, robot: str = "pm01", backend: str = "gazebo"
    ):
        pool = build_pool([world], radius=0.3)
        simulator = make_simulator(backend, NUMPY, load_robot(robot), pool, len(poses))
        count = len(poses)
        simulator.seed(np.arange(count))
        simulator.reset()
        simulator.place(np.arange(count), poses, [[x, y + 5.0] for x, y, _ in poses])
        return simulator

    yield make
    IDLE.close()
