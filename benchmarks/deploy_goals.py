# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""Drive ``sim_node`` to goal after goal in three ways: rclpy, DDS, rosbridge.

    python benchmarks/deploy_goals.py --policy runs/demo/policy.onnx --goals 50 --out FILE.json

It needs ROS 2 with pm01_rl, nav2_msgs and rosbridge_server. Each goal is one episode of the suite
``static``: another world, start and goal.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from report import write_report
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PORTS = {"rosbridge": 9187, "rosbridge_sim_time": 9188}
WAYS = {"rclpy": 3.0, "dds": 3.0, "rosbridge": 1.0, "rosbridge_sim_time": 1.0}
"""How many times faster than real time the robot lives. A bridge is driven through as a robot is:
at real time, by our own clock or by the robot's (``--sim-time``), and each goal is a drive of its
own."""
DRIVES_OF_A_BRIDGE = 10
"""rosbridge of Humble may hang when a client leaves (seen after 17 and 43 drives, whether they took
leave or not) and answers nobody any more; so it is started anew after so many."""
TIME_LIMIT_S = 60.0
"""Simulated time for one goal."""


class Judge(Node):
    """Resets the simulated robot, sends goals, and watches."""

    def __init__(self) -> None:
        """Listen to the simulated robot."""
        super().__init__("judge")
        self.goal: PoseStamped | None = None
        self.collisions = 0
        self.time = 0.0
        self.place = np.zeros(2)
        self.speed = 0.0
        self.create_subscription(PoseStamped, "/sim_node/goal", self._on_goal, LATCHED)
        self.create_subscription(UInt32, "/sim_node/collisions", self._on_collision, LATCHED)
        self.create_subscription(Odometry, "/odom", self._on_odometry, 10)
        self.reset = self.create_client(Trigger, "/sim_node/reset")
        self.goals = self.create_publisher(PoseStamped, "/goal_pose", 1)
        self.action = ActionClient(self, NavigateToPose, "/navigate_to_pose")

    def _on_goal(self, message: PoseStamped) -> None:
        self.goal = message

    def _on_collision(self, message: UInt32) -> None:
        self.collisions = message.data

    def _on_odometry(self, message: Odometry) -> None:
        stamp, place = message.header.stamp, message.pose.pose.position
        self.time = stamp.sec + 1e-9 * stamp.nanosec
        self.place = np.array([place.x, place.y])
        self.speed = abs(message.twist.twist.linear.x) + abs(message.twist.twist.angular.z)

    def spin(self, seconds: float) -> None:
        """Handle messages for so long of simulated time."""
        until, patience = self.time + seconds, time.monotonic() + 60.0
        while self.time < until and time.monotonic() < patience:
            rclpy.spin_once(self, timeout_sec=0.1)

    def wait(self, future: Any) -> Any:
        """Return what a future brings."""
        rclpy.spin_until_future_complete(self, future, timeout_sec=120.0)
        return future.result()

    def new_episode(self) -> None:
        """Put the robot into another world and take its goal."""
        self.goal = None
        self.wait(self.reset.call_async(Trigger.Request()))
        while self.goal is None:
            rclpy.spin_once(self, timeout_sec=0.1)
        self.spin(1.0)

    def drive(self, way: str, policy: str) -> dict[str, Any]:
        """Send the goal and watch until the robot stands there, or time is up."""
        assert self.goal is not None
        started, before = self.time, self.collisions
        target = self.goal.pose.position
        handle = driver = end = None
        self.goal.pose.orientation.w = 0.0  # no heading: the policy is measured, not the turn
        if way == "rclpy":
            handle = self.wait(self.action.send_goal_async(NavigateToPose.Goal(pose=self.goal)))
            end = handle.get_result_async()
        elif way == "dds":
            # Odometry is exact here, and its frame the world's; pm01 drive takes no other.
            self.goal.header.frame_id = "odom"
            self.goals.publish(self.goal)
        else:
            goal = ("--goal", str(target.x), str(target.y))
            driver = start(*drive_command(way, policy), *goal)
        distance = np.inf
        while self.time - started < TIME_LIMIT_S:
            rclpy.spin_once(self, timeout_sec=0.1)
            distance = float(np.hypot(*(self.place - [target.x, target.y])))
            if distance < 0.4 and self.speed < 0.02:
                break
        result = {
            "reached": distance < 0.4,
            "seconds": round(self.time - started, 2),
            "collisions": self.collisions - before,
        }
        if handle is not None:
            if not result["reached"]:
                self.wait(handle.cancel_goal_async())
            result["action_status"] = self.wait(end).status
        if driver is not None:
            stop(driver)
        return result


def start(*command: str) -> subprocess.Popen[bytes]:
    """Start a process in a group of its own."""
    return subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Stop a drive as its user would, by Ctrl-C; at once if that takes long."""
    os.killpg(process.pid, signal.SIGINT)
    try:
        process.wait(timeout=10.0)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def drive_command(way: str, policy: str) -> tuple[str, ...]:
    """Return how ``pm01 drive`` is called."""
    call = (sys.executable, "-c", "from pm01_nav.cli import main; main()", "drive", policy)
    if way == "dds":
        return (*call, "--dds", "--sim-time")
    by = ("--sim-time",) if way == "rosbridge_sim_time" else ()
    return (*call, "--rosbridge", f"ws://127.0.0.1:{PORTS[way]}", *by)


def drivers(way: str, policy: str) -> list[subprocess.Popen[bytes]]:
    """Start what drives the robot, or what each drive to a goal goes through."""
    if way == "rclpy":
        given = ("-p", f"policy:={policy}", "-p", "use_sim_time:=true", "-p", "autostart:=true")
        return [start("ros2", "run", "pm01_rl", "policy_node", "--ros-args", *given)]
    if way == "dds":
        return [start(*drive_command(way, policy))]
    bridge = ("-p", "address:=127.0.0.1", "-p", f"port:={PORTS[way]}")
    return [start("ros2", "run", "rosbridge_server", "rosbridge_websocket", "--ros-args", *bridge)]


def measure(way: str, policy: str, goals: int) -> dict[str, Any]:
    """Drive to so many goals in one way."""
    # Odometry at 20 Hz of simulated time, so that several times real time stays a modest rate.
    given = ("-p", f"real_time_factor:={WAYS[way]}", "-p", "step:=0.05", "-p", "seed:=7")
    processes = [start("ros2", "run", "pm01_rl", "sim_node", "--ros-args", *given)]
    judge = Judge()
    try:
        judge.reset.wait_for_service(60.0)
        processes += drivers(way, policy)
        time.sleep(10.0)
        episodes = []
        for number in range(goals):
            if way in PORTS and number and number % DRIVES_OF_A_BRIDGE == 0:
                stop(processes.pop())
                processes += drivers(way, policy)
                time.sleep(10.0)
            judge.new_episode()
            episodes.append(judge.drive(way, policy))
            print(way, len(episodes), episodes[-1], flush=True)
    finally:
        judge.destroy_node()
        for process in processes:
            os.killpg(process.pid, signal.SIGKILL)
    reached = [e["seconds"] for e in episodes if e["reached"]]
    return {
        "way": way,
        "goals": goals,
        "reached": len(reached),
        "episodes_with_contact": sum(e["collisions"] > 0 for e in episodes),
        "steps_in_contact": sum(e["collisions"] for e in episodes),
        "median_seconds": float(np.median(reached)) if reached else None,
        "real_time_factor": WAYS[way],
        "episodes": episodes,
    }


def main() -> None:
    """Measure all ways, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--goals", type=int, default=50)
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    rclpy.init()
    results = []
    for way in arguments.ways:
        results.append(measure(way, arguments.policy, arguments.goals))
        write_report(arguments.out, {"results": results})
    rclpy.shutdown()


if __name__ == "__main__":
    main()
