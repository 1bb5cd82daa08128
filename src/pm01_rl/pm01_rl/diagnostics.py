# SPDX-License-Identifier: Apache-2.0
"""How the policy node fares, for ``/diagnostics``."""

from __future__ import annotations

from collections import deque

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from pm01_nav.deploy.controller import Status
from pm01_nav.deploy.safety import Reason

QUIET = frozenset((Reason.NO_GOAL, Reason.SLOWED))
"""Reasons that nobody needs to look into."""
ERRORS = frozenset((Reason.POLICY_FAILED, Reason.EMERGENCY_STOP, Reason.WRONG_MOUNT))
"""Reasons that somebody must do something about."""

ROUNDING = 1e-6
"""Of times in [s]; a simulated clock ticks in halves of the period, so that equality is common."""


class Timing:
    """How long control steps take and how punctual they are."""

    def __init__(self, control_dt: float) -> None:
        """Take a step for late that comes more than half of ``control_dt`` [s] after its time."""
        self._control_dt = control_dt
        self._seconds: deque[float] = deque(maxlen=1000)
        self._last: float | None = None
        self.steps = 0
        self.late = 0

    def note(self, now: float, seconds: float) -> None:
        """Note a step at ``now`` [s] that took ``seconds``."""
        if self._last is not None and now - self._last > 1.5 * self._control_dt + ROUNDING:
            self.late += 1
        self._last = now
        self.steps += 1
        self._seconds.append(seconds)

    def percentile(self, percent: float) -> float:
        """Return a percentile of how long the last thousand steps took [s]."""
        return float(np.percentile(self._seconds, percent)) if self._seconds else 0.0


def diagnostics(
    stamp: Time, status: Status | None, timing: Timing, notes: dict[str, str]
) -> DiagnosticArray:
    """Return one message about the latest step, with ``notes`` beside it."""
    reasons = status.verdict.reasons if status else ()
    said = [reason.value for reason in reasons]
    bad = any(reason not in QUIET for reason in reasons)
    if notes["second_publishers"]:
        bad = True
        said.append(f"commands come from {notes['second_publishers']}, too")
    level = DiagnosticStatus.WARN if bad else DiagnosticStatus.OK
    if notes["other_servers"] or not ERRORS.isdisjoint(reasons):
        level = DiagnosticStatus.ERROR
    values = notes | {
        "goal_distance": f"{status.goal_distance:.2f}" if status else "",
        "control_steps": str(timing.steps),
        "late_steps": str(timing.late),
        "step_p50_ms": f"{1e3 * timing.percentile(50):.2f}",
        "step_p99_ms": f"{1e3 * timing.percentile(99):.2f}",
    }
    entry = DiagnosticStatus(
        level=level,
        name="pm01_rl: policy",
        message="; ".join(said) or "driving",
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[entry])
    message.header.stamp = stamp
    return message
