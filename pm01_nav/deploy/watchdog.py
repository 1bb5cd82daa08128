# SPDX-License-Identifier: Apache-2.0
"""Who may be heard by the motors, and when: silence with nothing to do, a stop after a hang.

A base often has several who drive it in turn: a person, Nav2, a policy. Whoever has nothing to do
must be silent, or its stops chop the others' drive.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from pm01_nav.deploy.safety import WATCHDOG_S

LOOK_S = 0.02
"""Time between two looks: with them the stop comes within 200 ms [s]."""
STOP_FOR_S = 1.0
"""A stop is repeated for so long, since a message may be lost, and then silence begins [s]."""


class Turn:
    """Tell whose turn it is: ours on the way to a goal and while we stop after it."""

    def __init__(self, now: float) -> None:
        """Begin at ``now`` [s] with a stop: nobody knows what the base was told before."""
        self._drove = now

    def is_ours(self, driving: bool, now: float) -> bool:
        """Tell whether to send a command at ``now`` [s]."""
        # A clock that went back must not make us talk until it has caught up.
        if driving or now < self._drove:
            self._drove = now
        return now - self._drove <= STOP_FOR_S


class Guard:
    """Decide when a base must be told to stop because nobody tells it anything any more."""

    def __init__(self, timeout_s: float = WATCHDOG_S) -> None:
        """Allow silences of ``timeout_s`` [s]."""
        self.timeout_s = timeout_s
        self._heard = -math.inf
        self._moves = False

    def hear(self, moves: bool, now: float) -> None:
        """Note that the base was told something at ``now`` [s], and whether that moves it."""
        self._heard, self._moves = now, moves

    def must_stop(self, now: float) -> bool:
        """Tell whether to say stop at ``now`` [s]."""
        silence = now - self._heard
        if not self._moves or 0.0 <= silence <= self.timeout_s:
            return False
        if silence < 0.0:
            # The clock went back; the stop is repeated from here on.
            silence, self._heard = self.timeout_s, now - self.timeout_s
        self._moves = silence <= self.timeout_s + STOP_FOR_S
        return self._moves


class Watchdog:
    """A thread that calls ``stop`` when ``feed`` was not called for ``WATCHDOG_S`` on the way.

    It guards against a control loop that hangs. Against a process that dies only the base itself,
    or a process in front of it, can guard.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        """Call ``stop``, from a thread of its own, when it is time."""
        self._stop = stop
        self._guard = Guard()
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def feed(self, driving: bool = True) -> None:
        """Say that the loop is alive, and whether the robot drives."""
        with self._lock:
            self._guard.hear(driving, time.monotonic())

    def end(self) -> None:
        """Watch no longer."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_S):
            with self._lock:
                must_stop = self._guard.must_stop(time.monotonic())
            if must_stop:
                # Whatever fails now, a link that is just being lost, may work at the next look.
                with suppress(Exception):
                    self._stop()
