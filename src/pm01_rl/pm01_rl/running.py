# SPDX-License-Identifier: Apache-2.0
"""What the nodes share: how a process begins and ends, so that it can still say stop, and QoS."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

try:
    from rclpy.event_handler import SubscriptionEventCallbacks
except ImportError:  # Humble
    from rclpy.qos_event import SubscriptionEventCallbacks

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""What was said last is said to whoever comes later."""
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
"""Without the warning that a publisher's promises do not match."""


@contextmanager
def ros() -> Iterator[None]:
    """Initialise rclpy; interrupts and terminations end the block, and only then rclpy."""
    # rclpy's own handlers would close the topics first, and the robot would go on.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        yield
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


def spin(node: Node, executor: Executor) -> None:
    """Let an executor run a node's callbacks until it is told to end."""
    while rclpy.ok():
        _spin(node, executor)


def _spin(node: Node, executor: Executor) -> None:
    try:
        executor.spin()
    except rclpy_implementation.RCLError as error:
        # Humble's lifecycle nodes raise when a client asks for a transition that the present state
        # does not have; that must not end the process.
        node.get_logger().error(f"refused: {error}")


def _interrupt(number: int, frame: Any) -> None:
    raise KeyboardInterrupt
