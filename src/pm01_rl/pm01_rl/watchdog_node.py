# SPDX-License-Identifier: Apache-2.0
"""A process of its own before the base: it passes commands on, and stops when none come any more.

Many bases, and Gazebo's, go on with the last command for ever. When the policy's process is killed
nobody is left in it to say stop.
"""

from __future__ import annotations

import time

import rclpy
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pm01_rl.parameters import positive
from pm01_rl.running import ros


class WatchdogNode(Node):
    """From ``cmd_vel_in`` to ``cmd_vel``."""

    def __init__(self) -> None:
        """Begin to listen."""
        super().__init__("watchdog_node")
        self.declare_parameter("timeout", 0.15, positive("Silence after which it stops [s].", 5.0))
        self._heard = -1e9
        self._out = self.create_publisher(Twist, "cmd_vel", QoSProfile(depth=1))
        self.create_subscription(Twist, "cmd_vel_in", self._on_command, QoSProfile(depth=1))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(0.02, self._look, clock=steady)

    def _on_command(self, command: Twist) -> None:
        self._heard = time.monotonic()
        self._out.publish(command)

    def _look(self) -> None:
        if time.monotonic() - self._heard > self.get_parameter("timeout").value:
            self._out.publish(Twist())


def main() -> None:
    """Run the node until it is told to end."""
    with ros():
        rclpy.spin(WatchdogNode())
