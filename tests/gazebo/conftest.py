# SPDX-License-Identifier: Apache-2.0
"""Robots in Gazebo, and in servers that only play Gazebo."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.backends.gazebo.config import what_is_missing
from pm01_nav.backends.gazebo.engine import IDLE, GazeboEngine
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.robot import load_robot
from pm01_nav.sim.simulator import Simulator
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

SRC = Path(__file__).resolve().parents[2] / "src"
HALL = World("hall", (-10.0, -10.0, 10.0, 10.0), discs=np.array([[8.0, 8.0, 0.3]]))
Make = Callable[..., Simulator]


def simulator_in(
    worlds: list[World], num_envs: int, robot: str = "pm01", localized: bool = False
) -> PhysicsSimulator:
    """Return robots in Gazebo, seeded with 0, 1, 2 ... and reset."""
    pool = build_pool(worlds, radius=0.3)
    simulator = PhysicsSimulator(
        GazeboEngine, load_robot(robot), pool, num_envs, localized=localized
    )
    simulator.seed(np.arange(num_envs))
    simulator.reset()
    return simulator


@pytest.fixture(scope="session")
def hall() -> World:
    """A wide floor with one disc in a corner."""
    return HALL


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., PhysicsSimulator]]:
    """Return a function that makes robots whose servers play their part (``played_server``)."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    import played_server

    def make(opener: str, num_envs: int = 1, worlds: tuple[World, ...] = (HALL,), **more: Any):
        monkeypatch.setattr(GazeboEngine, "opener", staticmethod(getattr(played_server, opener)))
        return simulator_in(list(worlds), num_envs, **more)

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


@pytest.fixture(scope="session")
def running_world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Start the article's world with the robot of ``pm01_description``; return its file."""
    missing = what_is_missing()
    if missing is not None or shutil.which("gz") is None:
        pytest.skip(f"needs Gazebo Harmonic and its command gz: {missing}")
    world = SRC / "pm01_gazebo" / "worlds" / "article.sdf"
    urdf = tmp_path_factory.mktemp("robot") / "pm01.urdf"
    xacro = SRC / "pm01_description" / "urdf" / "pm01.urdf.xacro"
    text = (
        pytest.importorskip("xacro")
        .process_file(str(xacro), mappings={"gazebo": "harmonic"})
        .toxml()
    )
    urdf.write_text(text, encoding="utf-8")
    os.environ["GZ_PARTITION"] = f"pm01_test_{os.getpid()}"
    config = SRC / "pm01_gazebo" / "config" / "server.config"
    server = subprocess.Popen(
        ["gz", "sim", "-s", "-r", "--headless-rendering", str(world)],
        env=os.environ | {"GZ_SIM_SERVER_CONFIG_PATH": str(config)},
        start_new_session=True,
    )
    try:
        _spawn(urdf)
        yield world
    finally:
        os.killpg(server.pid, signal.SIGKILL)
        server.wait()
        del os.environ["GZ_PARTITION"]


def _spawn(urdf: Path) -> None:
    """Put the robot into the world that starts."""
    from gz.msgs10.boolean_pb2 import Boolean
    from gz.msgs10.entity_factory_pb2 import EntityFactory
    from gz.transport13 import Node

    node, service, end = Node(), "/world/article/create", time.monotonic() + 60.0
    while service not in node.service_list() and time.monotonic() < end:
        time.sleep(0.1)
    request = EntityFactory(sdf_filename=str(urdf), name="pm01")
    request.pose.position.z = 0.001
    done, answer = node.request(service, request, EntityFactory, Boolean, 5000)
    assert done
    assert answer.data
    while "/scan" not in node.topic_list() and time.monotonic() < end:
        time.sleep(0.1)
