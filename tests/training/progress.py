# SPDX-License-Identifier: Apache-2.0
"""A progress display for tests."""

from __future__ import annotations

import os


class Quiet:
    """A progress display that shows nothing, and may stop the run as Ctrl-C would."""

    def __init__(self, interrupt_after: int | None = None):
        self.interrupt_after = interrupt_after
        self.iterations = 0

    def started(self, message):
        pass

    def iteration(self, fraction, row, steps_per_second):
        self.iterations += 1
        if self.iterations == self.interrupt_after:
            os.kill(os.getpid(), 2)  # SIGINT, as Ctrl-C sends it

    def evaluated(self, steps, summary):
        pass

    def warned(self, steps, text):
        pass
