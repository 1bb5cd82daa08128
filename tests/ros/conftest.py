# SPDX-License-Identifier: Apache-2.0
"""Real nodes in processes of their own; skipped where there is no ROS 2 with pm01_rl."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch

from pm01_nav.policy.export import export_policy, policy_metadata
from pm01_nav.task.config import observation_layout
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.ppo import make_policy


def pytest_collection_modifyitems(items):
    """Mark what stands in this folder."""
    for item in items:
        if Path(__file__).parent in Path(item.fspath).parents:
            item.add_marker(pytest.mark.ros)


DOMAINS = itertools.count(os.getpid())


@pytest.fixture(autouse=True)
def rclpy():
    """Return rclpy, initialised, in a domain of the test's own on this machine only.

    A node that was killed is seen for ten seconds more, and who asks it gets no answer.
    """
    module = pytest.importorskip("rclpy", reason="needs ROS 2: source its setup first")
    pytest.importorskip("pm01_rl", reason="needs pm01_rl: colcon build, then source install/setup")
    os.environ["ROS_DOMAIN_ID"] = str(100 + next(DOMAINS) % 100)
    os.environ["ROS_LOCALHOST_ONLY"] = "1"
    module.init()
    yield module
    module.shutdown()


@pytest.fixture
def start(rclpy):
    """Return a function that starts a node of pm01_rl; all end with the test."""
    processes = []

    def run(executable: str, **parameters) -> subprocess.Popen:
        given = [word for k, v in parameters.items() for word in ("-p", f"{k}:={v}")]
        command = ["ros2", "run", "pm01_rl", executable, "--ros-args", *given]
        processes.append(subprocess.Popen(command, start_new_session=True))
        return processes[-1]

    yield run
    for process in processes:
        end(process)


def end(process: subprocess.Popen) -> None:
    """End a process and its children; those that take leave are not seen any more afterwards."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture(scope="session")
def policy_file(tmp_path_factory):
    """Return a policy that goes ahead and turns to the goal, whatever stands in the way."""
    config = task_config("static")
    robot = config.robot_spec()
    layout = observation_layout(config, robot)
    policy = make_policy(PPOConfig(net_arch=(16, 16), activation="relu"), layout)
    set_weights(policy, sin_of_bearing=index_of(layout, "goal_sin_cos"))
    metadata = policy_metadata(layout, robot, config.control_dt, {})
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    export_policy(policy, layout, metadata, path)
    return path


def index_of(layout, name: str) -> int:
    """Return where a part of the observation begins."""
    names = [part.name for part in layout.parts]
    return sum(part.size for part in layout.parts[: names.index(name)])


def set_weights(policy, sin_of_bearing: int) -> None:
    """Let v be 0.29 m/s, which is +0.4 of -0.2 to 0.5, and w 2 x 1.5 rad/s x the sine, limited."""
    first, _, second, _ = policy.mlp_extractor.policy_net
    with torch.no_grad():
        for layer in (first, second, policy.action_net):
            layer.weight.zero_()
            layer.bias.zero_()
        # What is positive and what is negative of it pass the rectifiers apart.
        first.weight[0, sin_of_bearing], first.weight[1, sin_of_bearing] = 1.0, -1.0
        second.weight[0, 0] = second.weight[1, 1] = 1.0
        policy.action_net.weight[1, 0], policy.action_net.weight[1, 1] = 2.0, -2.0
        policy.action_net.bias[0] = 0.4


@pytest.fixture
def watcher(rclpy):
    """Return a node that notes commands, sends goals and can wait."""
    from geometry_msgs.msg import PoseStamped, Twist

    node = rclpy.create_node("watcher")
    node.commands = []
    node.create_subscription(
        Twist, "/cmd_vel", lambda m: node.commands.append((time.monotonic(), m)), 10
    )

    def wait_for(condition, seconds=60.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.02)
            if condition():
                return True
        return False

    def send_goal(frame="odom", x=40.0, y=40.0):
        publisher = node.create_publisher(PoseStamped, "/goal_pose", 1)
        assert wait_for(lambda: publisher.get_subscription_count() > 0)
        pose = PoseStamped()
        pose.header.frame_id = frame
        pose.pose.position.x, pose.pose.position.y = x, y
        publisher.publish(pose)

    def moves():
        return bool(node.commands) and abs(node.commands[-1][1].linear.x) > 0.05

    def set_off(**goal):
        # On a busy machine a robot may take longer to wake up than a goal is waited for.
        assert any(send_goal(**goal) or wait_for(moves, 5.0) for _ in range(20))

    node.wait_for, node.send_goal, node.moves, node.set_off = wait_for, send_goal, moves, set_off
    yield node
    node.destroy_node()


@pytest.fixture
def send_action(watcher):
    """Return a function that sends a goal by an action until it is accepted; returns its handle."""
    from rclpy.action import ActionClient

    def send(action, name, goal, on_feedback=None):
        client = ActionClient(watcher, action, name)
        assert watcher.wait_for(client.server_is_ready)
        # The server is there once the node is configured, and accepts goals once it is active.
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            future = client.send_goal_async(goal, feedback_callback=on_feedback)
            assert watcher.wait_for(future.done)
            if future.result().accepted:
                return future.result()
        raise AssertionError(f"{name} accepts no goal")

    return send


@pytest.fixture
def call(watcher):
    """Return a function that returns a service's answer."""

    def ask(kind, name, request):
        client = watcher.create_client(kind, name)
        assert watcher.wait_for(client.service_is_ready)
        # The service is seen before it sees us, and an answer to nobody is lost.
        watcher.wait_for(lambda: False, 1.0)
        future = client.call_async(request)
        assert watcher.wait_for(future.done)
        return future.result()

    return ask


@pytest.fixture
def state(call):
    """Return a function that returns the policy node's state."""
    from lifecycle_msgs.srv import GetState

    def ask() -> str:
        return call(GetState, "/policy_node/get_state", GetState.Request()).current_state.label

    return ask


@pytest.fixture
def change_state(call):
    """Return a function that asks the policy node for a transition and tells whether it went."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    def change(transition: str) -> bool:
        number = getattr(Transition, f"TRANSITION_{transition.upper()}")
        request = ChangeState.Request(transition=Transition(id=number))
        return call(ChangeState, "/policy_node/change_state", request).success

    return change


@pytest.fixture
def launch(rclpy):
    """Return a function that launches navigate.launch.py; all ends with the test."""
    processes = []

    def run(*arguments: str) -> subprocess.Popen:
        command = ["ros2", "launch", "pm01_rl", "navigate.launch.py", *arguments]
        processes.append(subprocess.Popen(command, start_new_session=True))
        return processes[-1]

    yield run
    for process in processes:
        end(process)


class Body:
    """A robot that stands in free space and says so, in frames and by a clock of its own."""

    def __init__(self, node) -> None:
        self.node = node
        self.clock: float | None = None
        """Simulated time to begin with [s]; None is the wall's."""
        self.map_to_odom: tuple[float, float] | None = None
        """Where odometry's frame lies in the map; None is no map."""
        self.lidar: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
        """Where tf has the lidar; None is nowhere."""

    def live(self) -> None:
        """Begin to publish, twenty times a second."""
        from nav_msgs.msg import Odometry
        from rclpy.qos import qos_profile_sensor_data
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import LaserScan
        from tf2_msgs.msg import TFMessage

        create = self.node.create_publisher
        self.clocks, self.transforms = create(Clock, "/clock", 10), create(TFMessage, "/tf", 10)
        self.odometries = create(Odometry, "/odom", 10)
        self.scans = create(LaserScan, "/scan", qos_profile_sensor_data)
        self.node.create_timer(0.05, self.speak)

    def speak(self) -> None:
        from pm01_rl.conversions import (
            odometry_message,
            scan_message,
            time_message,
            transform_message,
        )
        from rosgraph_msgs.msg import Clock
        from tf2_msgs.msg import TFMessage

        from pm01_nav.deploy.messages import Odometry, Scan
        from pm01_nav.robot import load_robot

        now = time.time()
        if self.clock is not None:
            self.clock = now = self.clock + 0.05
            self.clocks.publish(Clock(clock=time_message(now)))
        lidar = load_robot("pm01").lidar
        angles = (lidar.angle_min, lidar.angle_increment, lidar.range_min, lidar.range_max)
        free = np.full(lidar.num_beams, np.inf, dtype=np.float32)
        frames = [transform_message(np.zeros(3), now, "odom", "base_link")]
        if self.map_to_odom is not None:
            place = np.array([*self.map_to_odom, 0.0])
            frames.append(transform_message(place, now, "map", "odom"))
        if self.lidar is not None:
            frames.append(transform_message(np.array(self.lidar), now, "base_link", "laser"))
        self.transforms.publish(TFMessage(transforms=frames))
        odometry = Odometry(now, np.zeros(3), np.zeros(2))
        self.odometries.publish(odometry_message(odometry, "odom", "base_link"))
        self.scans.publish(scan_message(Scan(now, *angles, free), "laser", 0.05))


@pytest.fixture
def body(watcher):
    """Return a robot that stands; ``live`` lets it publish."""
    return Body(watcher)
