# SPDX-License-Identifier: Apache-2.0
"""How old a topic's newest message is, by clocks that need not agree.

Stamps are of the robot's clock, arrivals of ours. The quickest message so far, of whatever topic,
tells how far the two clocks are apart; what comes later than that is late. So a message that waited
in a queue is old when it arrives, a sensor that repeats its last message grows old, and a sensor
whose messages always take longer than those of another is as much older.
"""

from __future__ import annotations

import math
from enum import Enum

CLOCK_DRIFT = 1e-3
"""Two clocks may run apart by this share; quartz clocks do so by less than a tenth of it."""


class Arrival(Enum):
    """What a message's stamp says."""

    NEW = "new"
    OLD = "old"
    """A duplicate, overtaken by a newer one, or without a usable stamp: to be ignored."""
    JUMP = "jump"
    """The robot's clock jumped; ages count from this message."""


class RobotClock:
    """How far a robot's clock is from ours, by all of its topics together."""

    def __init__(self, *, same_clock: bool = False) -> None:
        """With ``same_clock``, as in simulated time, the two are one and there is no guess."""
        self._same_clock = same_clock
        self._heard = -math.inf
        self._offset = 0.0 if same_clock else math.inf

    @property
    def offset(self) -> float:
        """Our time less the robot's [s]; infinite before the first message."""
        return self._offset

    def meet(self, delay: float, now: float) -> None:
        """Note that a message came ``delay`` [s], by both clocks, after its stamp at ``now``."""
        if self._same_clock:
            return
        drift = CLOCK_DRIFT * max(0.0, now - self._heard)
        self._offset = min(self._offset + drift, delay)
        self._heard = now

    def forget(self) -> None:
        """Begin anew with the next message."""
        if not self._same_clock:
            self._offset = math.inf


class Stream:
    """The messages of one topic."""

    def __init__(self, clock: RobotClock | None = None, *, jump_s: float = 1.0) -> None:
        """Measure ages by ``clock``, which the topics of one robot share.

        Stamps that are off by more than ``jump_s`` [s] are a jump of it.
        """
        self._clock = clock or RobotClock()
        self._jump_s = jump_s
        self._stamp = -math.inf

    @property
    def begun(self) -> bool:
        """Whether there has been a message."""
        return self._stamp > -math.inf

    def accept(self, stamp: float, now: float) -> Arrival:
        """Take in a message stamped ``stamp`` that arrived at ``now`` [s]."""
        if not math.isfinite(stamp + now):
            return Arrival.OLD
        delay, known = now - stamp, math.isfinite(self._clock.offset)
        ahead_of_time = known and delay < self._clock.offset - self._jump_s
        if ahead_of_time or stamp < self._stamp - self._jump_s:
            self._clock.forget()
            self._stamp = stamp
            self._clock.meet(delay, now)
            return Arrival.JUMP
        if stamp <= self._stamp:
            return Arrival.OLD
        self._stamp = stamp
        self._clock.meet(delay, now)
        return Arrival.NEW

    def age(self, now: float) -> float:
        """Return how old the newest message is at ``now`` [s]; infinite if there was none."""
        return now - self._stamp - self._clock.offset if self.begun else math.inf

    def forget(self) -> None:
        """Begin anew with the next message."""
        self._stamp = -math.inf
