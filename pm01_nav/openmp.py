# SPDX-License-Identifier: Apache-2.0
"""How OpenMP's threads wait for work; the runtimes read it once, when torch or numba load them."""

from __future__ import annotations

import os

SPIN_COUNT = 40_000
"""Looks for new work before a waiting thread sleeps: 1 to 2 ms.

That is the time between two steps of a batch while a learner collects experience; to wake a
sleeping thread costs a fifth of a step.
"""


def wait_briefly() -> None:
    """Let waiting threads sleep after a moment, unless the user has said otherwise.

    Threads that spin on and on, as they do by default, halve everybody's speed on a busy machine.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", str(SPIN_COUNT))
