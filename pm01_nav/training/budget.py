# SPDX-License-Identifier: Apache-2.0
"""How long a run may go on."""

from __future__ import annotations

import time

from pm01_nav.compilation import seconds_compiling
from pm01_nav.training.config import RunConfig


class Budget:
    """How much of a run's steps and seconds is spent."""

    def __init__(self, config: RunConfig, started_at: float, spent_before: float = 0.0) -> None:
        """Count seconds from ``started_at`` (``perf_counter``) on top of ``spent_before``.

        What is compiled from now on is compiled once for all runs, and not counted.
        """
        self._steps, self._seconds = config.train.steps, config.train.time_budget
        self._started_at = started_at - spent_before
        self._compiled_before = seconds_compiling()
        self.compiled_elsewhere = 0.0
        """Seconds that were spent compiling for another device than the CPU."""
        self.steps_done = 0
        self.learning_since = 0.0
        """Seconds that were spent when learning began."""

    @property
    def seconds(self) -> float:
        """Seconds spent so far."""
        return time.perf_counter() - self._started_at - self.compiled

    @property
    def compiled(self) -> float:
        """Seconds that were spent compiling since the budget was made."""
        return seconds_compiling() - self._compiled_before + self.compiled_elsewhere

    def fraction(self) -> float:
        """Return the spent part of what runs out first, 0 to 1 and beyond."""
        by_time = self.seconds / self._seconds if self._seconds else 0.0
        return max(self._by_steps(), by_time)

    def learning_fraction(self) -> float:
        """Return how far learning has come, 0 to 1; what falls over a run falls with this.

        Start-up is no part of it: of a budget of 15 s it takes a third, and the learning rate
        would never be what it was set to.
        """
        by_time = 0.0
        if self._seconds:
            room = self._seconds - self.learning_since
            by_time = (self.seconds - self.learning_since) / room if room > 0.0 else 1.0
        return min(max(self._by_steps(), by_time, 0.0), 1.0)

    def _by_steps(self) -> float:
        return self.steps_done / self._steps if self._steps else 0.0
