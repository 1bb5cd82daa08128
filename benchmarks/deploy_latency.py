# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""How long it takes from a scan to the command that answers it, on one core.

    python benchmarks/deploy_latency.py --policy runs/demo/policy.onnx --out FILE.json

``direct`` is the controller alone: the scan is taken in, then comes a control step. ``node`` is the
policy node through rclpy: from before a ``LaserScan`` is published until the ``Twist`` is received,
both by a node in the same process. The timer, which lets a scan wait for the next control step, is
off there: each scan is answered at once.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry as OdometryMessage
from pm01_rl.conversions import odometry_message, scan_message, time_message
from pm01_rl.policy_node import PolicyNode
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from report import write_report
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.controller import Goal
from pm01_nav.deploy.simulated_robot import SimulatedRobot, simulated_robot

WARM_UP = 100
"""The first steps are not counted: caches fill, and DDS finds its peers."""


def percentiles(seconds: list[float]) -> dict[str, float]:
    """Return percentiles in milliseconds."""
    values = 1e3 * np.array(seconds[WARM_UP:])
    return {f"p{p:g}_ms": round(float(np.percentile(values, p)), 3) for p in (50, 95, 99, 99.9)}


def to_next_scan(robot: SimulatedRobot) -> None:
    """Let a simulated robot go on until it has a new scan."""
    while not robot.step():
        pass


def direct(policy: str, steps: int) -> dict[str, Any]:
    """Time the controller alone."""
    controller = load_controller(policy, same_clock=True)
    robot = simulated_robot("static", controller.robot, seed=1, dt=0.05)
    times, cpu, elsewhere = [], [], False
    for _ in range(steps):
        to_next_scan(robot)
        if controller.goal is None:
            # A goal is set one scan after a reset, which is a jump of odometry and ends goals.
            if elsewhere:
                controller.set_goal(Goal(*map(float, robot.goal)))
            else:
                robot.reset()
            elsewhere = not elsewhere
        controller.see_odometry(robot.odometry(), robot.time)
        scan = robot.scan()
        began, began_cpu = time.perf_counter(), time.thread_time()
        controller.see_scan(scan, robot.time)
        command = controller.step(robot.time).verdict.command
        cpu.append(time.thread_time() - began_cpu)
        times.append(time.perf_counter() - began)
        robot.command(*command)
    return {"steps": steps, "wall": percentiles(times), "cpu": percentiles(cpu)}


class Peer:
    """The policy node without its timers, and a robot's topics, in one process and one thread."""

    def __init__(self, policy: str) -> None:
        """Activate the node; simulated time lets the robot live as fast as it is answered."""
        self.node = PolicyNode(
            parameter_overrides=[
                Parameter("policy", value=policy),
                Parameter("use_sim_time", value=True),
            ]
        )
        self.node.trigger_configure()
        self.node.trigger_activate()
        for timer in self.node.timers:
            timer.cancel()
        # It comes after the node's own subscription, which has taken the scan in by then.
        self.node.create_subscription(
            LaserScan, "scan", lambda _: self.node._control(), qos_profile_sensor_data
        )
        peer = rclpy.create_node("peer", start_parameter_services=False, enable_rosout=False)
        self.clock = peer.create_publisher(Clock, "/clock", 1)
        self.scans = peer.create_publisher(LaserScan, "scan", qos_profile_sensor_data)
        self.odometry = peer.create_publisher(OdometryMessage, "odom", 10)
        self.goals = peer.create_publisher(PoseStamped, "goal_pose", 1)
        self.commands: list[Twist] = []
        peer.create_subscription(Twist, "cmd_vel", self.commands.append, 1)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.executor.add_node(peer)

    def spin_until(self, condition: Callable[[], bool]) -> None:
        """Handle messages until something holds, or for a second."""
        end = time.perf_counter() + 1.0
        while not condition() and time.perf_counter() < end:
            self.executor.spin_once(timeout_sec=0.1)

    def prepare(self, robot: SimulatedRobot) -> None:
        """Tell the node the time and the odometry that belong to the next scan."""
        now, supervisor = robot.time, self.node.controller.supervisor
        self.clock.publish(Clock(clock=time_message(now)))
        self.odometry.publish(odometry_message(robot.odometry(), "odom", "base_link"))
        self.spin_until(lambda: self.node.get_clock().now().nanoseconds >= 1e9 * now - 1.0)
        self.spin_until(lambda: supervisor.odometry and supervisor.odometry.stamp > now - 1e-6)

    def answer(self, scan: LaserScan) -> tuple[float, float]:
        """Publish a scan; return how long its command took, by the wall and of this thread [s]."""
        self.commands.clear()
        began, began_cpu = time.perf_counter(), time.thread_time()
        self.scans.publish(scan)
        self.spin_until(lambda: bool(self.commands))
        cpu = time.thread_time() - began_cpu
        return time.perf_counter() - began, cpu


def through_node(policy: str, steps: int) -> dict[str, Any]:
    """Time the policy node through rclpy."""
    rclpy.init()
    peer = Peer(policy)
    robot = simulated_robot("static", peer.node.controller.robot, seed=1, dt=0.05)
    times, cpu, moving, elsewhere = [], [], 0, False
    for _ in range(steps):
        to_next_scan(robot)
        if peer.node.controller.goal is None:
            if elsewhere:
                goal = PoseStamped()
                goal.pose.position.x, goal.pose.position.y = map(float, robot.goal)
                goal.pose.orientation.w = 0.0
                peer.goals.publish(goal)
            else:
                robot.reset()
            elsewhere = not elsewhere
        peer.prepare(robot)
        wall, own = peer.answer(scan_message(robot.scan(), "base_scan", 0.1))
        times.append(wall)
        cpu.append(own)
        for command in peer.commands:
            robot.command(command.linear.x, command.angular.z)
            moving += command != Twist()
    peer.node.trigger_deactivate()
    rclpy.shutdown()
    report = {"steps": steps, "moving_commands": moving, "wall": percentiles(times)}
    return report | {"cpu": percentiles(cpu)}


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {0})
    results = {"direct": direct(arguments.policy, arguments.steps)}
    results["node"] = through_node(arguments.policy, arguments.steps)
    write_report(arguments.out, results)


if __name__ == "__main__":
    main()
