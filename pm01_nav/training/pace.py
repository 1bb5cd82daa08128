# SPDX-License-Identifier: Apache-2.0
"""When something that takes time is to be done again."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

SHARE = 0.01
"""The most of a run's time that saving may take; what takes longer is done less often."""


class Pace:
    """Every so many seconds, or less often where it would take more than ``SHARE`` of the time."""

    def __init__(self, every: float) -> None:
        """Count from now; it is due at once, since it was never done."""
        self._every, self._pause = every, 0.0
        self._done_at = time.perf_counter()

    def due(self, ahead: float = 0.0) -> bool:
        """Tell whether to do it now, if the next occasion is ``ahead`` seconds away."""
        return time.perf_counter() - self._done_at + ahead >= self._pause

    @contextmanager
    def spent(self) -> Iterator[None]:
        """Do it in this context."""
        began = time.perf_counter()
        yield
        self._done_at = time.perf_counter()
        self._pause = max(self._every, (self._done_at - began) / SHARE)
