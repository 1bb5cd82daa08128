# SPDX-License-Identifier: Apache-2.0
"""Real nodes in processes of their own; skipped where there is no ROS 2 with pm01_rl."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

from pm01_nav.policy.export import export_policy, policy_metadata
from pm01_nav.task.config import observation_layout
from pm01_nav.task.tasks import task_config
from pm01_nav.train.algorithm_config import PPOConfig
from pm01_nav.train.ppo import make_policy


def pytest_collection_modifyitems(items):
    """Mark what stands in this folder."""
    for item in items:
        if Path(__file__).parent in Path(item.fspath).parents:
            item.add_marker(pytest.mark.ros)


@pytest.fixture(scope="session", autouse=True)
def rclpy():
    """Return rclpy, initialised, in a domain of its own on this machine only."""
    module = pytest.importorskip("rclpy", reason="needs ROS 2: source its setup first")
    pytest.importorskip("pm01_rl", reason="needs pm01_rl: colcon build, then source install/setup")
    os.environ["ROS_DOMAIN_ID"] = str(100 + os.getpid() % 100)
    os.environ["ROS_LOCALHOST_ONLY"] = "1"
    module.init()
    yield module
    module.shutdown()


@pytest.fixture
def start(rclpy):
    """Return a function that starts a node of pm01_rl; all are killed at the end."""
    processes = []

    def run(executable: str, **parameters) -> subprocess.Popen:
        given = [word for k, v in parameters.items() for word in ("-p", f"{k}:={v}")]
        command = ["ros2", "run", "pm01_rl", executable, "--ros-args", *given]
        processes.append(subprocess.Popen(command, start_new_session=True))
        return processes[-1]

    yield run
    for process in processes:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
        process.wait()


@pytest.fixture(scope="session")
def policy_file(tmp_path_factory):
    """Return an untrained policy, which goes ahead at about 0.15 m/s whatever it sees."""
    config = task_config("static")
    robot = config.robot_spec()
    layout = observation_layout(config, robot)
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    policy = make_policy(PPOConfig(net_arch=(16, 16)), layout)
    metadata = policy_metadata(layout, robot, config.control_dt, {})
    export_policy(policy, layout, metadata, path)
    return path
