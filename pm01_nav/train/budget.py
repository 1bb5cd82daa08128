# SPDX-License-Identifier: Apache-2.0
"""How long a run may go on."""

from __future__ import annotations

import time

from pm01_nav.train.config import RunConfig


class Budget:
    """How much of a run's steps and seconds is spent."""

    def __init__(self, config: RunConfig, started_at: float, spent_before: float) -> None:
        """Count seconds from ``started_at`` (``perf_counter``) on top of ``spent_before``."""
        self._steps, self._seconds = config.train.steps, config.train.time_budget
        self._started_at = started_at - spent_before
        self.steps_done = 0

    @property
    def seconds(self) -> float:
        """Seconds spent so far."""
        return time.perf_counter() - self._started_at

    def fraction(self) -> float:
        """Return the spent part of what runs out first, 0 to 1 and beyond."""
        by_steps = self.steps_done / self._steps if self._steps else 0.0
        by_time = self.seconds / self._seconds if self._seconds else 0.0
        return max(by_steps, by_time)
