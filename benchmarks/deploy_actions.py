# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""Goal after goal for the policy node's action server: answers, ends, memory.

    python benchmarks/deploy_actions.py --policy runs/demo/policy.onnx --goals 5000 --out FILE.json

The goals come one by one, each as soon as the one before is accepted, which it preempts; every
fifth is canceled first, and every hundredth lies where the robot stands, so that it is reached. An
end is right when it is what was done to the goal. It needs ROS 2 with pm01_rl and nav2_msgs.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from deploy_goals import start
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.node import Node
from report import write_report

ENDS = {
    "reached": GoalStatus.STATUS_SUCCEEDED,
    "canceled": GoalStatus.STATUS_CANCELED,
    "preempted": GoalStatus.STATUS_ABORTED,
}


class Client(Node):
    """Sends goals and notes how long their acceptance takes, and how they end."""

    def __init__(self) -> None:
        """Connect."""
        super().__init__("client")
        self.action = ActionClient(self, NavigateToPose, "/navigate_to_pose")
        self.place: tuple[float, float] | None = None
        self.create_subscription(Odometry, "/odom", self._on_odometry, 10)
        self.answers: list[float] = []
        self.expected: list[str] = []
        self.results: list[Any] = []

    def _on_odometry(self, message: Odometry) -> None:
        place = message.pose.pose.position
        self.place = place.x, place.y

    def wait(self, future: Any, seconds: float = 60.0) -> Any:
        """Return what a future brings."""
        rclpy.spin_until_future_complete(self, future, timeout_sec=seconds)
        return future.result()

    def wait_for_node(self) -> None:
        """Wait until goals are accepted."""
        self.action.wait_for_server(60.0)
        while self.place is None or not self.send(1e3, 0.0).accepted:
            rclpy.spin_once(self, timeout_sec=0.1)
        self.answers.clear()

    def send(self, x: float, y: float) -> Any:
        """Send a goal in odometry's frame without a heading; return its handle."""
        goal = NavigateToPose.Goal()
        goal.pose.header.frame_id = "odom"
        goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
        goal.pose.pose.orientation.w = 0.0
        began = time.perf_counter()
        handle = self.wait(self.action.send_goal_async(goal))
        self.answers.append(time.perf_counter() - began)
        return handle

    def drive(self, number: int) -> None:
        """Send goal ``number`` and do to it what it is for."""
        kind = "preempted"
        if number % 100 == 99:
            kind = "reached"
        elif number % 5 == 4:
            kind = "canceled"
        assert self.place is not None
        handle = self.send(*(self.place if kind == "reached" else (1e3, 0.0)))
        assert handle.accepted
        result = handle.get_result_async()
        if kind == "reached":
            self.wait(result)
        elif kind == "canceled":
            self.wait(handle.cancel_goal_async())
        self.expected.append(kind)
        self.results.append(result)


def memory(process: subprocess.Popen[bytes]) -> float:
    """Return how much memory the node below ``ros2 run`` has [MB]."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    pages = int(Path(f"/proc/{children[0]}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def ends(client: Client) -> dict[str, dict[str, int]]:
    """Return for each kind of goal how many ended with which status; 0 is not at all."""
    client.wait(client.send(1e3, 0.0).cancel_goal_async())
    counts: dict[str, Counter[int]] = {kind: Counter() for kind in ENDS}
    for kind, result in zip(client.expected, client.results, strict=True):
        answer = client.wait(result, 10.0)
        counts[kind][0 if answer is None else answer.status] += 1
    return {kind: {str(s): n for s, n in count.items()} for kind, count in counts.items()}


def measure(policy: str, goals: int) -> dict[str, Any]:
    """Send so many goals to a node that drives a simulated robot."""
    given = ("--ros-args", "-p", f"policy:={policy}", "-p", "autostart:=true")
    robot = start("ros2", "run", "pm01_rl", "sim_node", "--ros-args", "-p", "world:=empty")
    node = start("ros2", "run", "pm01_rl", "policy_node", *given)
    client = Client()
    try:
        client.wait_for_node()
        before, began = memory(node), time.monotonic()
        for number in range(goals):
            client.drive(number)
        seconds = time.monotonic() - began
        answers = 1e3 * np.array(client.answers)
        counts = ends(client)
        after = memory(node)
    finally:
        client.destroy_node()
        for process in (robot, node):
            os.killpg(process.pid, signal.SIGKILL)
    wrong = sum(n for kind, c in counts.items() for s, n in c.items() if int(s) != ENDS[kind])
    return {
        "goals": goals,
        "goals_per_second": round(goals / seconds, 1),
        "acceptance_ms": {f"p{p}": round(float(np.percentile(answers, p)), 2) for p in (50, 99)}
        | {"max": round(float(answers.max()), 2)},
        "ends_by_kind_and_status": counts,
        "wrong_ends": wrong,
        "memory_mb": {"before": round(before, 1), "after": round(after, 1)},
    }


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--goals", type=int, default=5000)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    rclpy.init()
    results = measure(arguments.policy, arguments.goals)
    rclpy.shutdown()
    write_report(arguments.out, results)


if __name__ == "__main__":
    main()
