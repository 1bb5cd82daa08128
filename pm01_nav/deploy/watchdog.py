# SPDX-License-Identifier: Apache-2.0
"""Tell the motors to stop when whoever should tell them has fallen silent."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

from pm01_nav.deploy.safety import WATCHDOG_S

LOOK_S = 0.02
"""Time between two looks: with them the stop comes within 200 ms [s]."""


class Watchdog:
    """A thread that calls ``stop`` as long as ``feed`` was not called for ``WATCHDOG_S``.

    It guards against a control loop that hangs. Against a process that dies only the base itself,
    or a process in front of it, can guard.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        """Call ``stop``, from a thread of its own, when it is time."""
        self._stop = stop
        self._fed = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self.barked = 0
        """How often it had to speak."""

    def start(self) -> None:
        """Begin to watch."""
        self.feed()
        self._thread.start()

    def feed(self) -> None:
        """Say that the robot was just told something."""
        self._fed = time.monotonic()

    def end(self) -> None:
        """Watch no longer."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_S):
            if time.monotonic() - self._fed > WATCHDOG_S:
                self.barked += 1
                # Whatever fails now, a link that is just being lost, may work at the next look.
                with suppress(Exception):
                    self._stop()
