# SPDX-License-Identifier: Apache-2.0
"""Messages by their stamps: a step waits for the scan that belongs to it, and never sleeps."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any

KEPT = 64
"""Messages of a topic that wait to be read."""


class SilentError(Exception):
    """Nothing came in time that was new enough."""


class StampedStream:
    """The latest messages of one topic; filled by the transport's thread, read by ours."""

    def __init__(self, topic: str) -> None:
        """Hold nothing yet; ``topic`` is for messages to people."""
        self.topic = topic
        self._messages: deque[tuple[int, Any]] = deque(maxlen=KEPT)
        self._arrived = threading.Condition()

    def put(self, stamp: int, message: Any) -> None:
        """Add a message with its stamp [ns]."""
        with self._arrived:
            self._messages.append((stamp, message))
            self._arrived.notify_all()

    def clear(self) -> None:
        """Forget what came, as after a reset."""
        with self._arrived:
            self._messages.clear()

    def latest(self, stamp: int) -> Any | None:
        """Return the newest message that is not older than ``stamp`` [ns], or None."""
        with self._arrived:
            return self._newest(stamp)

    def wait(self, stamp: int, timeout_s: float) -> Any:
        """Return the newest message that is not older than ``stamp`` [ns], as soon as there is one.

        Raises:
            SilentError: none came within ``timeout_s`` of real time.
        """
        with self._arrived:
            came = self._arrived.wait_for(lambda: self._newest(stamp) is not None, timeout_s)
            if not came:
                raise SilentError(self._complaint(stamp, timeout_s))
            return self._newest(stamp)

    def _newest(self, stamp: int) -> Any | None:
        fresh = [entry for entry in self._messages if entry[0] >= stamp]
        return max(fresh, key=lambda entry: entry[0])[1] if fresh else None

    def _complaint(self, stamp: int, timeout_s: float) -> str:
        wanted = f"{self.topic}: no message of {stamp / 1e9:.3f} s or later in {timeout_s:g} s"
        if not self._messages:
            return f"{wanted}; none at all came"
        newest = max(entry[0] for entry in self._messages)
        return f"{wanted}; the newest is of {newest / 1e9:.3f} s"
