# SPDX-License-Identifier: Apache-2.0
"""What the nodes share: how a process begins and ends, so that it can still say stop, and QoS."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
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


def _interrupt(number: int, frame: Any) -> None:
    raise KeyboardInterrupt
