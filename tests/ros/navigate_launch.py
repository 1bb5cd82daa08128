# SPDX-License-Identifier: Apache-2.0
"""For ``launch_test``: navigate.launch.py as a user launches it, with a robot that this file plays.

``test_launch.py`` runs it; PM01_TEST_POLICY names the policy's file.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
import unittest
from pathlib import Path

import numpy as np
import rclpy
from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import PoseStamped, Twist
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry as OdometryMessage
from pm01_rl.conversions import odometry_message, scan_message
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.robot import load_robot


def generate_test_description() -> LaunchDescription:
    """Launch the policy node and its watchdog, without a robot."""
    share = Path(get_package_share_directory("pm01_rl"))
    navigate = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / "launch" / "navigate.launch.py")),
        launch_arguments={"policy": os.environ["PM01_TEST_POLICY"]}.items(),
    )
    return LaunchDescription([navigate, ReadyToTest()])


class TestNavigation(unittest.TestCase):
    """The steps of a robot's day, in order."""

    @classmethod
    def setUpClass(cls) -> None:
        rclpy.init()
        cls.node = rclpy.create_node("robot")
        cls.commands = []
        cls.place = None
        cls.node.create_subscription(
            Twist, "/cmd_vel", lambda m: cls.commands.append((time.monotonic(), m.linear.x)), 10
        )
        cls.node.create_subscription(OdometryMessage, "/odom", cls.on_odometry, 10)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.node.destroy_node()
        rclpy.shutdown()

    @classmethod
    def on_odometry(cls, message: OdometryMessage) -> None:
        pose, twist = message.pose.pose, message.twist.twist
        yaw = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
        cls.place = np.array([pose.position.x, pose.position.y, yaw])
        cls.speed = twist.linear.x

    def wait_for(self, condition, seconds: float = 60.0) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(self.node, timeout_sec=0.02)
            if condition():
                return True
        return False

    def moves(self) -> bool:
        return bool(self.commands) and self.commands[-1][1] > 0.05

    def test_1_the_node_is_up(self) -> None:
        client = self.node.create_client(GetState, "/policy_node/get_state")
        assert self.wait_for(client.service_is_ready)

        def active() -> bool:
            future = client.call_async(GetState.Request())
            return self.wait_for(future.done) and future.result().current_state.label == "active"

        assert self.wait_for(active)
        assert not self.moves()

    def test_2_a_scan_is_answered_within_200_ms(self) -> None:
        robot = load_robot("pm01")
        goals = self.node.create_publisher(PoseStamped, "/goal_pose", 1)
        odometry = self.node.create_publisher(OdometryMessage, "/odom", 10)
        scans = self.node.create_publisher(LaserScan, "/scan", qos_profile_sensor_data)
        ready = (goals, odometry, scans)
        assert self.wait_for(lambda: all(p.get_subscription_count() > 0 for p in ready))
        goal = PoseStamped()
        goal.pose.position.x = 30.0
        goals.publish(goal)
        for _ in range(20):
            ours = Odometry(time.time(), np.zeros(3), np.zeros(2))
            odometry.publish(odometry_message(ours, "odom", "base_link"))
            self.wait_for(lambda: False, 0.05)
        # All is there but a scan, so the robot stands; with the first one it goes.
        assert not self.moves()
        lidar = robot.lidar
        free = np.full(lidar.num_beams, np.inf, dtype=np.float32)
        angles = (lidar.angle_min, lidar.angle_increment, lidar.range_min, lidar.range_max)
        ours = Scan(time.time(), *angles, free)
        sent = time.monotonic()
        scans.publish(scan_message(ours, "base_scan", 0.1))
        assert self.wait_for(self.moves, 5.0)
        assert self.commands[-1][0] - sent < 0.2
        # And without further ones it stands again.
        assert self.wait_for(lambda: not self.moves(), 2.0)

    def test_3_a_goal_3_m_away_is_reached_and_a_killed_sensor_stops(self) -> None:
        sim = subprocess.Popen(
            ["ros2", "run", "pm01_rl", "sim_node", "--ros-args", "-p", "world:=empty"],
            start_new_session=True,
        )
        try:
            type(self).place = None
            assert self.wait_for(lambda: self.place is not None)
            # The simulated robot's clock is another than that of the step before: a jump.
            self.wait_for(lambda: False, 1.0)
            self.drive_3_m()
            self.send(100.0, 100.0)
            assert self.wait_for(lambda: self.moves() and self.speed > 0.05)
            os.killpg(sim.pid, signal.SIGKILL)
            killed = time.monotonic()
            assert self.wait_for(lambda: not self.moves(), 5.0)
            # Odometry may be 0.3 s old, a control step is 0.1 s, the rest is a busy machine's.
            assert self.commands[-1][0] - killed < 0.8
        finally:
            if sim.poll() is None:
                os.killpg(sim.pid, signal.SIGKILL)
            sim.wait()

    def drive_3_m(self) -> None:
        x, y, yaw = self.place
        target = np.array([x + 3.0 * np.cos(yaw + 0.5), y + 3.0 * np.sin(yaw + 0.5)])
        future = self.send(*target).get_result_async()
        assert self.wait_for(future.done, 120.0)
        assert future.result().status == 4  # SUCCEEDED
        assert np.hypot(*(self.place[:2] - target)) < 0.35

    def send(self, x: float, y: float):
        client = ActionClient(self.node, NavigateToPose, "/navigate_to_pose")
        assert self.wait_for(client.server_is_ready)
        goal = NavigateToPose.Goal()
        goal.pose.header.frame_id = "odom"
        goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
        future = client.send_goal_async(goal)
        assert self.wait_for(future.done)
        assert future.result().accepted
        return future.result()
