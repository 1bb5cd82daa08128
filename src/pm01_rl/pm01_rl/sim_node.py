# SPDX-License-Identifier: Apache-2.0
"""The planar simulator as a ROS 2 robot: clock, scan, odometry and tf out, cmd_vel in."""

from __future__ import annotations

import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from pm01_nav.deploy.simulated_robot import SimulatedRobot, simulated_robot
from pm01_nav.errors import InputError
from pm01_rl.conversions import (
    odometry_message,
    quaternion,
    scan_message,
    time_message,
    transform_message,
)
from pm01_rl.parameters import described, positive
from pm01_rl.running import LATCHED, ros


class SimNode(Node):
    """One simulated robot in a world with moving time."""

    def __init__(self) -> None:
        """Declare parameters and put the robot into its world."""
        super().__init__("sim_node")
        self._declare()
        self.robot = self._make_robot()
        self.period = self._value("step") / self._value("real_time_factor")
        """Wall time from one step to the next [s]."""
        self._frames = (str(self._value("odom_frame")), str(self._value("base_frame")))
        self._clock_out = self.create_publisher(Clock, "/clock", 10)
        self._scan_out = self.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self._odometry_out = self.create_publisher(OdometryMessage, "odom", 10)
        self._transforms_out = self.create_publisher(TFMessage, "/tf", 100)
        self._fixed_out = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._goal_out = self.create_publisher(PoseStamped, "~/goal", LATCHED)
        self._collisions_out = self.create_publisher(UInt32, "~/collisions", LATCHED)
        kind = TwistStamped if self._value("cmd_vel_stamped") else Twist
        self.create_subscription(kind, "cmd_vel", self._on_command, 1)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._announce()

    def _declare(self) -> None:
        declare = self.declare_parameter
        declare("world", "static", described("A suite's name, or a world's file."))
        declare("robot", "", described("A robot's name, or its YAML; empty: pm01."))
        declare("seed", 0, ParameterDescriptor(description="Chooses world, start and goal."))
        declare("step", 0.02, positive("Simulated time of a step [s]: odometry's period.", 1.0))
        declare("scan_period", 0.1, positive("Simulated time between two scans [s].", 10.0))
        declare("real_time_factor", 1.0, positive("Times as fast as the wall's clock.", 1000.0))
        declare("cmd_vel_timeout", 0.2, positive("Without commands the base stops [s].", 10.0))
        declare("cmd_vel_stamped", False, described("Commands are TwistStamped, not Twist."))
        declare("randomization", "off", described("off, on, or a YAML of what is wrong."))
        declare("odom_frame", "odom", described("The frame of odometry."))
        declare("base_frame", "base_link", described("The robot's frame."))
        declare("scan_frame", "base_scan", described("The lidar's frame."))

    def _value(self, name: str) -> object:
        return self.get_parameter(name).value

    def _make_robot(self) -> SimulatedRobot:
        return simulated_robot(
            self._value("world"),
            self._value("robot") or "pm01",
            seed=self._value("seed"),
            dt=self._value("step"),
            scan_period=self._value("scan_period"),
            command_timeout=self._value("cmd_vel_timeout"),
            randomization=self._value("randomization"),
        )

    def _announce(self) -> None:
        """Publish what stays: where the lidar is, and where one may go."""
        lidar, now = self.robot.robot.lidar, self.robot.time
        mount = np.array([lidar.x, lidar.y, lidar.yaw])
        frame = str(self._value("scan_frame"))
        fixed = transform_message(mount, now, self._frames[1], frame)
        fixed.transform.rotation = quaternion(lidar.yaw, upside_down=lidar.upside_down)
        self._fixed_out.publish(TFMessage(transforms=[fixed]))
        goal = PoseStamped()
        goal.header.stamp, goal.header.frame_id = time_message(now), "map"
        goal.pose.position.x, goal.pose.position.y = map(float, self.robot.goal)
        self._goal_out.publish(goal)
        self._collisions_out.publish(UInt32(data=self.robot.collisions))

    def _on_command(self, message: Twist | TwistStamped) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        planar = (twist.linear.x, twist.linear.y, twist.angular.z)
        self.robot.command(*self.robot.drive.from_planar(planar))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.robot.reset()
        self._announce()
        response.success, response.message = True, "another start, another goal"
        return response

    def step(self) -> None:
        """Move on by one step and publish what the sensors say."""
        robot, (odom, base) = self.robot, self._frames
        collisions = robot.collisions
        new_scan = robot.step()
        self._clock_out.publish(Clock(clock=time_message(robot.time)))
        odometry = robot.odometry()
        self._odometry_out.publish(odometry_message(odometry, odom, base))
        moving = transform_message(odometry.pose, robot.time, odom, base)
        drift = transform_message(robot.odometry_frame(), robot.time, "map", odom)
        self._transforms_out.publish(TFMessage(transforms=[drift, moving]))
        if new_scan:
            frame = str(self._value("scan_frame"))
            self._scan_out.publish(
                scan_message(robot.scan(), frame, float(self._value("scan_period")))
            )
        if robot.collisions != collisions:
            self._collisions_out.publish(UInt32(data=robot.collisions))


def run(node: SimNode) -> None:
    """Step in time with the wall's clock, and hear commands in between."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    due = time.monotonic()
    while rclpy.ok():
        executor.spin_once(timeout_sec=max(0.0, due - time.monotonic()))
        now = time.monotonic()
        if now >= due:
            node.step()
            # Time that was lost is lost: a robot does not hurry to make up for it.
            due = max(due + node.period, now - node.period)


def main() -> None:
    """Run the node until it is told to end."""
    with ros():
        try:
            node = SimNode()
        except InputError as error:
            raise SystemExit(f"error: {error}") from None
        try:
            run(node)
        finally:
            node.destroy_node()
