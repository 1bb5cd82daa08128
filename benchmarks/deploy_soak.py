# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""Let the policy node drive ``sim_node`` for hours of simulated time: memory, missed deadlines.

    python benchmarks/deploy_soak.py --policy runs/demo/policy.onnx --hours 1 --out FILE.json

Node and robot are processes of their own. A deadline is missed when a control step comes more than
half a period after its time, by the simulated clock.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from deploy_goals import LATCHED, start
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.node import Node
from report import write_report
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

TIME_LIMIT_S = 60.0
"""Simulated time for one goal."""
SAMPLE_S = 60.0
"""Simulated time between two looks at the memory."""
WARM_UP_S = 300.0
"""Simulated time after which memory should grow no more."""


def resident_mb(process: int) -> float:
    """Return the memory that a process and its children use now [MB]."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6 + sum(resident_mb(int(c)) for c in children)


class Judge(Node):
    """Sends goals, and reads what the policy node says of itself."""

    def __init__(self) -> None:
        """Listen to diagnostics, goals and collisions."""
        super().__init__("judge")
        self.time, self.values = 0.0, {}
        self.goal: PoseStamped | None = None
        self.collisions = 0
        self.reset = self.create_client(Trigger, "/sim_node/reset")
        self.action = ActionClient(self, NavigateToPose, "/navigate_to_pose")
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 1)
        self.create_subscription(PoseStamped, "/sim_node/goal", self._on_goal, LATCHED)
        self.create_subscription(UInt32, "/sim_node/collisions", self._on_collisions, LATCHED)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp
        self.time = stamp.sec + 1e-9 * stamp.nanosec
        self.values = {pair.key: pair.value for pair in message.status[0].values}

    def _on_goal(self, message: PoseStamped) -> None:
        self.goal = message

    def _on_collisions(self, message: UInt32) -> None:
        self.collisions = message.data

    def drive(self) -> bool:
        """Drive to one goal; tell whether the robot arrived."""
        self.goal = None
        self.reset.call_async(Trigger.Request())
        self._spin(lambda: self.goal is not None, 30.0)
        # The reset is a jump of odometry, which ends goals.
        began = self.time
        self._spin(lambda: self.time > began + 1.5, 30.0)
        sent = self.action.send_goal_async(NavigateToPose.Goal(pose=self.goal))
        self._spin(sent.done, 30.0)
        ended = sent.result().get_result_async()
        if not self._spin(ended.done, TIME_LIMIT_S):
            self._spin(sent.result().cancel_goal_async().done, 30.0)
            self._spin(ended.done, 30.0)
        return ended.result().status == GoalStatus.STATUS_SUCCEEDED

    def _spin(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Handle messages until something holds, or for so long of simulated time."""
        began = self.time
        while not condition() and self.time - began < seconds:
            rclpy.spin_once(self, timeout_sec=0.1)
        return condition()


def soak(judge: Judge, pids: dict[str, int], seconds: float) -> dict[str, Any]:
    """Drive from goal to goal for so long of simulated time."""
    goals = arrived = 0
    memory: dict[str, list[float]] = {name: [] for name in pids}
    began, sampled, wall = judge.time, judge.time, time.monotonic()
    while judge.time - began < seconds:
        arrived += judge.drive()
        goals += 1
        if judge.time - sampled > SAMPLE_S and judge.time - began > WARM_UP_S:
            sampled = judge.time
            for name, pid in pids.items():
                memory[name].append(round(resident_mb(pid), 2))
    steps, late = int(judge.values["control_steps"]), int(judge.values["late_steps"])
    driven = judge.time - began
    return {
        "simulated_seconds": round(driven),
        "times_real_time": round(driven / (time.monotonic() - wall), 1),
        "goals": goals,
        "arrived": arrived,
        "simulation_steps_in_contact": judge.collisions,
        "control_steps": steps,
        "missed_deadlines": late,
        "missed_in_10_thousand": round(1e4 * late / steps, 2),
        "step_p99_ms": float(judge.values["step_p99_ms"]),
        "memory_mb": {n: {"first": m[0], "most": max(m), "last": m[-1]} for n, m in memory.items()},
        "memory_growth_percent": {
            n: round(100.0 * (max(m) / m[0] - 1.0), 2) for n, m in memory.items()
        },
    }


def main() -> None:
    """Start both nodes, drive, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--hours", type=float, default=1.0, help="of simulated time")
    parser.add_argument("--factor", type=float, default=20.0, help="times real time")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    rclpy.init()
    run = ("ros2", "run", "pm01_rl")
    simulated = ("-p", f"real_time_factor:={arguments.factor}", "-p", "step:=0.05")
    given = ("-p", f"policy:={arguments.policy}", "-p", "use_sim_time:=true")
    processes = {
        "sim_node": start(*run, "sim_node", "--ros-args", *simulated),
        "policy_node": start(*run, "policy_node", "--ros-args", *given, "-p", "autostart:=true"),
    }
    judge = Judge()
    try:
        judge.reset.wait_for_service(120.0)
        while not judge.values:
            rclpy.spin_once(judge, timeout_sec=0.1)
        pids = {name: process.pid for name, process in processes.items()}
        results = soak(judge, pids, 3600.0 * arguments.hours)
    finally:
        for process in processes.values():
            os.killpg(process.pid, signal.SIGKILL)
    write_report(arguments.out, {"factor_wanted": arguments.factor} | results)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
