# SPDX-License-Identifier: Apache-2.0
"""Begin and end a node's process so that it can still say stop when it is told to end."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions


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
