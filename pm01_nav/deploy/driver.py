# SPDX-License-Identifier: Apache-2.0
"""Drive a robot over a link: hand over what comes, step at the policy's rate, send the commands."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from pm01_nav.deploy.controller import Controller, Status
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.link import Event, Inbox, Link
from pm01_nav.deploy.messages import (
    heading_of,
    odometry_from_ros,
    scan_from_ros,
    seconds,
)
from pm01_nav.deploy.safety import STOP
from pm01_nav.deploy.watchdog import Turn, Watchdog
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
        self.refused: str | None = None
        """Why the last goal from the topic was not taken."""
        self._link = link
        self._inbox = Inbox()
        self._sim_time = sim_time
        self._clock = -math.inf
        if sim_time:
            controller.clock = self._newest_clock
        self._record = record
        self._ended = threading.Event()
        self._frame = ""
        """Of the odometry: the only one in which a goal can be taken."""

    def end(self) -> None:
        """Let ``run`` end soon; safe from any thread and from signal handlers."""
        self._ended.set()

    def run(self, goals: Iterable[Goal] | None = None, listener: Listener | None = None) -> None:
        """Drive to ``goals``, one after the other, or to those from the topic until ``end``.

        ``listener`` hears of every step. Of ``goals`` the first that is given up is the last: what
        made the robot give it up, an emergency stop, a jump, a long silence, may have moved it all.
        The robot stands afterwards.
        """
        watchdog = Watchdog(lambda: self._link.tell(STOP))
        self._link.open(self._inbox)
        try:
            if not self._sim_time:
                watchdog.start()
            if goals is not None:
                self.controller.set_goals(goals)
            self._loop(goals is not None, listener, watchdog)
        finally:
            watchdog.end()
            self._link.tell(STOP)
            self._link.close()

    def _loop(self, to_the_last: bool, listener: Listener | None, watchdog: Watchdog) -> None:
        controller, period = self.controller, self.controller.control_dt
        due = self._now()
        turn = Turn(time.monotonic())
        while not self._ended.is_set() and (controller.goal is not None or not to_the_last):
            self._hear(due)
            now = self._now()
            # Further away than one step it is only when the clock went back: that needs a step now.
            if 0.0 < due - now <= period:
                continue
            self.late_steps += due > -math.inf and now - due > 0.5 * period
            self.steps += 1
            status = controller.step(now, link_age=self._link.age())
            driving = controller.goal is not None or controller.supervisor.emergency
            if turn.is_ours(driving, time.monotonic()):
                self._link.tell(status.verdict.command)
                if self._record is not None:
                    self._record.command(status.verdict.command, now)
            watchdog.feed(driving)
            if listener is not None:
                listener(status)
            # Time that was lost is lost.
            due = due + period if 0.0 <= now - due < period else now + period

    def _now(self) -> float:
        return self._clock if self._sim_time else time.monotonic()

    def _newest_clock(self) -> float:
        """Return the simulated time, also while a step keeps us from handling what comes [s]."""
        event = self._inbox.newest("clock")
        return self._clock if event is None else seconds(event.message.clock)

    def _hear(self, due: float) -> None:
        """Handle what has come; with nothing there wait for it, until the next step at most."""
        wait = 0.05 if self._sim_time else min(due - time.monotonic(), 0.05)
        for event in self._inbox.take(wait):
            self._handle(event)

    def _handle(self, event: Event) -> None:
        controller, message = self.controller, event.message
        arrived = self._clock if self._sim_time else event.arrived
        if self._record is not None:
            self._record.event(event.kind, message, arrived)
        if event.kind in ("scan", "odometry") and arrived == -math.inf:
            return
        if event.kind == "scan":
            controller.see_scan(scan_from_ros(message), arrived)
        elif event.kind == "odometry":
            self._frame = message.header.frame_id
            controller.see_odometry(odometry_from_ros(message, controller.axes), arrived)
        elif event.kind == "clock":
            self._clock = seconds(message.clock)
        elif event.kind == "goal":
            self._take_goal(message)
        elif event.kind == "emergency_stop":
            controller.set_emergency(bool(message.data))

    def _take_goal(self, message: Any) -> None:
        """Take a goal that is given in the odometry frame; instead of any other the robot stands.

        There is no tf here: the same numbers in another frame are another place.
        """
        pose, frame = message.pose, message.header.frame_id
        if frame not in ("", self._frame):
            self.controller.cancel()
            self.refused = f"a goal in the frame {frame!r}; odometry's is {self._frame!r}"
            return
        try:
            place = pose.position
            self.controller.set_goal(Goal(float(place.x), float(place.y), heading_of(pose)))
            self.refused = None
        except InputError as error:
            self.controller.cancel()
            self.refused = str(error)
