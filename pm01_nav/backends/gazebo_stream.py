# SPDX-License-Identifier: Apache-2.0
"""Messages by their stamps: a step waits for the scan that belongs to it, and never sleeps."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any


class SilentError(Exception):
    """Nothing came in time that was new enough."""


class StampedStream:
    """The newest message of one topic; filled by the transport's thread, read by ours.

    Messages of a topic come in the order in which they were sent.
    """

    def __init__(self, topic: str, read: Callable[[Any], tuple[int, Any]]) -> None:
        """Hold nothing yet; ``topic`` is for messages to people.

        ``read`` returns the stamp [ns] and the content of a message as it arrives. Of many messages
        only those that somebody asks for are read.
        """
        self.topic = topic
        self._read = read
        self._unread: Any = None
        self._newest: tuple[int, Any] | None = None
        self._arrived = threading.Condition()

    def put(self, message: Any) -> None:
        """Take a message as it arrives."""
        with self._arrived:
            self._unread = message
            self._arrived.notify_all()

    def clear(self) -> None:
        """Forget what came, as after a reset."""
        with self._arrived:
            self._unread = self._newest = None

    def latest(self, stamp: int) -> Any | None:
        """Return the newest message if it is not older than ``stamp`` [ns], or None."""
        with self._arrived:
            newest = self._now()
        return newest[1] if newest is not None and newest[0] >= stamp else None

    def wait(self, stamp: int, timeout_s: float) -> Any:
        """Return the newest message as soon as it is not older than ``stamp`` [ns].

        Raises:
            SilentError: none such came within ``timeout_s`` of real time.
        """
        end = time.monotonic() + timeout_s
        with self._arrived:
            while True:
                newest = self._now()
                if newest is not None and newest[0] >= stamp:
                    return newest[1]
                left = end - time.monotonic()
                if left <= 0.0:
                    raise SilentError(self._complaint(stamp, timeout_s))
                self._arrived.wait(left)

    def _now(self) -> tuple[int, Any] | None:
        if self._unread is not None:
            self._newest, self._unread = self._read(self._unread), None
        return self._newest

    def _complaint(self, stamp: int, timeout_s: float) -> str:
        wanted = f"{self.topic}: no message of {stamp / 1e9:.3f} s or later in {timeout_s:g} s"
        if self._newest is None:
            return f"{wanted}; none at all came"
        return f"{wanted}; the newest is of {self._newest[0] / 1e9:.3f} s"
