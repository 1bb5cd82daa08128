# SPDX-License-Identifier: Apache-2.0
"""Choose by measurement how many threads step a batch."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numba

from pm01_nav.compilation import threadless

TRIALS = 6
"""Calls with each number of threads before the choice is made."""
CLEAR_GAIN = 1.3
"""All threads must be at least this much faster than one to be used.

Waking them costs about 0.1 ms, and while another process keeps the cores busy each call waits for
the slower thread.
"""


class ThreadChoice:
    """Run a parallel kernel with one thread or with all, whichever proves faster.

    The results do not depend on it: each environment is one thread's work.
    """

    def __init__(self, *, alone: bool = False) -> None:
        """Start with nothing measured; ``alone`` has nothing to share out and starts no threads."""
        self.alone = alone
        available = 1 if alone else numba.get_num_threads()
        self._seconds = {threads: [math.inf] for threads in sorted({1, available})}
        self.threads = 1 if available == 1 else 0
        """The choice; 0 while it is still measured."""

    def version(self, kernel: Any) -> Any:
        """Return a parallel kernel as it is to be called: without threads if there are none."""
        return threadless(kernel) if self.alone else kernel

    def anew(self) -> ThreadChoice:
        """Return a choice for the same batch that has measured nothing."""
        return ThreadChoice(alone=self.alone)

    def __call__(self, kernel: Callable[..., None], *arguments: object) -> None:
        """Call ``kernel`` with the chosen number of threads, or as one more trial."""
        if self.alone:
            kernel(*arguments)
            return
        before = numba.get_num_threads()
        threads = min(self.threads or self._next_trial(), before)
        if threads == before and self.threads:
            kernel(*arguments)
            return
        numba.set_num_threads(threads)
        try:
            began = time.perf_counter()
            kernel(*arguments)
            if not self.threads:
                self._note(threads, time.perf_counter() - began)
        finally:
            numba.set_num_threads(before)

    def _next_trial(self) -> int:
        return min(self._seconds, key=lambda threads: len(self._seconds[threads]))

    def _note(self, threads: int, seconds: float) -> None:
        self._seconds.setdefault(threads, [math.inf]).append(seconds)
        if all(len(times) > TRIALS for times in self._seconds.values()):
            best = {n: min(times) for n, times in self._seconds.items()}
            most = max(best)
            self.threads = most if best[1] > CLEAR_GAIN * best[most] else 1
