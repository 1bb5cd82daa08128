# SPDX-License-Identifier: Apache-2.0
"""Drive a robot over a link: hand over what comes, step at the policy's rate, send the commands."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from pm01_nav.deploy.controller import Controller, Goal, Status
from pm01_nav.deploy.link import Event, Inbox, Link
from pm01_nav.deploy.ros_messages import odometry_from_ros, scan_from_ros, seconds
from pm01_nav.deploy.safety import STOP
from pm01_nav.deploy.watchdog import Watchdog
from pm01_nav.errors import InputError

Listener = Callable[[Status], None]


class Driver:
    """One controller, one link, one loop; a watchdog in a thread of its own."""

    def __init__(
        self, controller: Controller, link: Link, *, sim_time: bool = False, record: Any = None
    ) -> None:
        """Drive by the wall's time, or with ``sim_time`` by what the topic ``clock`` says.

        ``record`` gets every event and command by ``event`` and ``command``, to write them down.
        """
        self.controller = controller
        self.steps = 0
        self.late_steps = 0
        """Steps that came more than half a control step after their time."""
        self._link = link
        self._inbox = Inbox()
        self._sim_time = sim_time
        self._clock = -math.inf
        self._record = record
        self._ended = threading.Event()

    def end(self) -> None:
        """Let ``run`` end soon; safe from any thread and from signal handlers."""
        self._ended.set()

    def run(self, goals: Iterator[Goal] | None = None, listener: Listener | None = None) -> None:
        """Drive to ``goals``, one after the other, or to those from the topic until ``end``.

        ``listener`` hears of every step. The robot stands afterwards.
        """
        watchdog = Watchdog(lambda: self._link.tell(STOP))
        self._link.open(self._inbox)
        try:
            if not self._sim_time:
                watchdog.start()
            self._loop(goals, listener, watchdog)
        finally:
            watchdog.end()
            self._link.tell(STOP)
            self._link.close()

    def _loop(
        self, goals: Iterator[Goal] | None, listener: Listener | None, watchdog: Watchdog
    ) -> None:
        controller = self.controller
        due = self._now()
        if goals is not None and not self._next_goal(goals):
            return
        while not self._ended.is_set():
            self._hear(due)
            now = self._now()
            if now < due:
                continue
            self.late_steps += due > -math.inf and now - due > 0.5 * controller.control_dt
            self.steps += 1
            status = controller.step(now)
            self._link.tell(status.verdict.command)
            watchdog.feed()
            if self._record is not None:
                self._record.command(status.verdict.command, now)
            if listener is not None:
                listener(status)
            ended = status.arrived or status.dropped
            if ended and goals is not None and not self._next_goal(goals):
                return
            due = max(due + controller.control_dt, now - controller.control_dt)

    def _next_goal(self, goals: Iterator[Goal]) -> bool:
        goal = next(goals, None)
        if goal is not None:
            self.controller.set_goal(goal)
        return goal is not None

    def _now(self) -> float:
        return self._clock if self._sim_time else time.monotonic()

    def _hear(self, due: float) -> None:
        """Handle what comes until the next step is due, and all that has come by then."""
        wait = 0.05 if self._sim_time else min(due - time.monotonic(), 0.05)
        event = self._inbox.get(wait)
        while event is not None:
            self._handle(event)
            event = self._inbox.get(0.0)

    def _handle(self, event: Event) -> None:
        controller, message = self.controller, event.message
        if event.kind == "lost":
            # What was measured before the connection was lost says nothing of what comes after.
            controller.cancel()
            return
        arrived = self._clock if self._sim_time else event.arrived
        if self._record is not None:
            self._record.event(event.kind, message, arrived)
        if event.kind in ("scan", "odometry") and arrived == -math.inf:
            return
        if event.kind == "scan":
            controller.see_scan(scan_from_ros(message), arrived)
        elif event.kind == "odometry":
            controller.see_odometry(odometry_from_ros(message), arrived)
        elif event.kind == "clock":
            self._clock = seconds(message.clock)
        elif event.kind == "goal":
            self._take_goal(message)
        elif event.kind == "emergency_stop":
            controller.set_emergency(bool(message.data))

    def _take_goal(self, message: Any) -> None:
        """Take a goal that is given in the odometry frame; there is no tf here for others."""
        place = message.pose.position
        try:
            self.controller.set_goal(Goal(float(place.x), float(place.y)))
        except InputError:
            self.controller.cancel()
