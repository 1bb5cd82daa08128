# SPDX-License-Identifier: Apache-2.0
"""How old a topic's newest message is, by clocks that need not agree.

Stamps are of the robot's clock, arrivals of ours. The quickest message so far tells how far the two
clocks are apart; what comes later than that is late. So a message that waited in a queue is old
when it arrives, and a sensor that repeats its last message grows old.
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


class Stream:
    """The messages of one topic."""

    def __init__(self, jump_s: float = 1.0, *, same_clock: bool = False) -> None:
        """Take stamps that are off by more than ``jump_s`` [s] for a jump of the clock.

        With ``same_clock``, as in simulated time, stamps and arrivals are of one clock: a stamp's
        age needs no guess.
        """
        self._jump_s = jump_s
        self._same_clock = same_clock
        self._stamp = -math.inf
        self._arrived = -math.inf
        self._offset = 0.0

    @property
    def begun(self) -> bool:
        """Whether there has been a message."""
        return self._stamp > -math.inf

    def accept(self, stamp: float, now: float) -> Arrival:
        """Take in a message stamped ``stamp`` that arrived at ``now`` [s]."""
        if not math.isfinite(stamp + now):
            return Arrival.OLD
        if not self.begun:
            self._begin(stamp, now)
            return Arrival.NEW
        delay = now - stamp
        ahead_of_time = delay < self._offset - self._jump_s
        if ahead_of_time or stamp < self._stamp - self._jump_s:
            self._begin(stamp, now)
            return Arrival.JUMP
        if stamp <= self._stamp:
            return Arrival.OLD
        drift = CLOCK_DRIFT * max(0.0, now - self._arrived)
        if not self._same_clock:
            self._offset = min(self._offset + drift, delay)
        self._stamp, self._arrived = stamp, now
        return Arrival.NEW

    def _begin(self, stamp: float, now: float) -> None:
        self._stamp, self._arrived = stamp, now
        self._offset = 0.0 if self._same_clock else now - stamp

    def age(self, now: float) -> float:
        """Return how old the newest message is at ``now`` [s]; infinite if there was none."""
        if not self.begun:
            return math.inf
        return now - self._stamp - self._offset

    def stamp_at(self, now: float) -> float:
        """Return the time by the robot's clock at ``now`` [s]."""
        return now - self._offset

    def forget(self) -> None:
        """Begin anew with the next message."""
        self._stamp = -math.inf
