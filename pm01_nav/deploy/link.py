# SPDX-License-Identifier: Apache-2.0
"""What a drive needs of a connection to a robot, whichever way it goes."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from pm01_nav.deploy.safety import Command

CAPACITY = 1000
"""Messages that may wait; more means that nobody reads, and the oldest are worth nothing."""


@dataclass(frozen=True)
class Topics:
    """The names of a robot's topics."""

    scan: str = "scan"
    odometry: str = "odom"
    command: str = "cmd_vel"
    goal: str = "goal_pose"
    emergency_stop: str = "emergency_stop"
    clock: str = "clock"
    stamped: bool = False
    """Whether commands are TwistStamped."""


class Event(NamedTuple):
    """Something that came from the robot."""

    kind: str
    """scan, odometry, goal, emergency_stop or clock."""
    message: Any
    """With ROS's field names, for ``messages`` to read."""
    arrived: float
    """By the monotonic clock [s]."""


@dataclass
class Inbox:
    """Events from a link's threads, in the order in which they came."""

    _events: deque[Event] = field(default_factory=lambda: deque(maxlen=CAPACITY))
    _lock: threading.Condition = field(default_factory=threading.Condition)

    def put(self, kind: str, message: Any) -> None:
        """Add an event; where nobody reads, the oldest one goes."""
        event = Event(kind, message, time.monotonic())
        with self._lock:
            self._events.append(event)
            self._lock.notify()

    def take(self, timeout: float) -> list[Event]:
        """Return all that has come, oldest first; with nothing there wait up to ``timeout`` [s]."""
        with self._lock:
            if not self._events and timeout > 0.0:
                self._lock.wait(timeout)
            events = list(self._events)
            self._events.clear()
        return events

    def newest(self, kind: str) -> Event | None:
        """Return the newest event of a kind that waits, if any, and leave it there."""
        with self._lock:
            return next((event for event in reversed(self._events) if event.kind == kind), None)


class Link(Protocol):
    """A connection that looks after itself: it reconnects, with growing pauses."""

    def open(self, inbox: Inbox) -> None:
        """Begin to connect, and to put what comes into ``inbox``."""
        ...

    def tell(self, command: Command) -> None:
        """Send a command; without a connection it is lost."""
        ...

    def age(self) -> float:
        """Return how long ago the newest of what has come back from the robot was sent [s].

        It is 0 where nothing comes back.
        """
        ...

    def close(self) -> None:
        """Disconnect."""
        ...
