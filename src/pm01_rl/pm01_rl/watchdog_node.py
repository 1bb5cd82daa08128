# SPDX-License-Identifier: Apache-2.0
"""A process of its own before the base: it passes commands on, and stops what is left moving.

Many bases, and Gazebo's, go on with the last command for ever. When the policy's process is killed
nobody is left in it to say stop.
"""

from __future__ import annotations

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pm01_nav.deploy.safety import STOP, WATCHDOG_S
from pm01_nav.deploy.watchdog import LOOK_S, Guard
from pm01_rl.conversions import command_message
from pm01_rl.parameters import described, positive
from pm01_rl.running import ros

NEWEST = QoSProfile(depth=1)


class WatchdogNode(Node):
    """From ``cmd_vel_in`` to ``cmd_vel``."""

    def __init__(self) -> None:
        """Begin to listen."""
        super().__init__("watchdog_node")
        declare, fixed = self.declare_parameter, {"read_only": True}
        text = "Silence after a command that moves the base, until it is stopped [s]."
        declare("timeout", WATCHDOG_S, positive(text, 5.0))
        declare("cmd_vel_stamped", False, described("TwistStamped, not Twist.", **fixed))
        declare("base_frame", "base_link", described("The robot's frame.", **fixed))
        self._kind = TwistStamped if self.get_parameter("cmd_vel_stamped").value else Twist
        # In simulated time it is the robot's seconds that count, however fast they go.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._clock = self.get_clock() if self.get_parameter("use_sim_time").value else steady
        self._guard = Guard()
        self._out = self.create_publisher(self._kind, "cmd_vel", NEWEST)
        self.create_subscription(self._kind, "cmd_vel_in", self._on_command, NEWEST)
        self.create_timer(LOOK_S, self._look, clock=self._clock)

    def _now(self) -> float:
        return self._clock.now().nanoseconds * 1e-9

    def _on_command(self, command: Twist | TwistStamped) -> None:
        twist = command.twist if isinstance(command, TwistStamped) else command
        moves = bool(twist.linear.x or twist.linear.y or twist.angular.z)
        self._guard.hear(moves, self._now())
        self._out.publish(command)

    def _look(self) -> None:
        self._guard.timeout_s = float(self.get_parameter("timeout").value)
        if self._guard.must_stop(self._now()):
            self.stop()

    def stop(self) -> None:
        """Say stop."""
        stamp, frame = self.get_clock().now().to_msg(), str(self.get_parameter("base_frame").value)
        self._out.publish(command_message(self._kind, STOP, stamp, frame))


def main() -> None:
    """Run the node until it is told to end; the robot then stands."""
    with ros():
        node = WatchdogNode()
        try:
            rclpy.spin(node)
        finally:
            node.stop()
            node.destroy_node()
