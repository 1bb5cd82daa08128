# SPDX-License-Identifier: Apache-2.0
"""Durations: seconds in every configuration, control steps inside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pm01_nav.errors import InputError

CONTROL_DT = 0.1
"""The control period of our tasks [s], by which early files without one are understood."""
MOST_STEPS = 10**9
"""As many as a duration in steps may have."""


def whole_steps(seconds: float, control_dt: float) -> int:
    """Return how many control steps of ``control_dt`` [s] come nearest to a time; at least one."""
    return max(1, round(seconds / control_dt))


def in_seconds(
    given: Mapping[str, Any], early: Mapping[str, str], control_dt: Any, source: str = ""
) -> dict[str, Any]:
    """Return ``given`` with seconds for what early files counted in control steps.

    ``early`` has the early keys and the present ones. Where ``control_dt`` [s] is no number,
    nothing is converted: whoever checks the task will say so. ``source`` goes before a key.

    Raises:
        InputError: a duration stands there in both ways, or is no whole number of steps.
    """
    changed = dict(given)
    if not isinstance(control_dt, (int, float)):
        return changed
    for name in early.keys() & given.keys():
        key, steps = early[name], changed.pop(name)
        if key in given:
            raise InputError(f"{source}{name}: stands beside {key}; give {key} alone")
        if not _is_count(steps):
            raise InputError(
                f"{source}{name} = {steps!r}: must be a whole number of control steps from 1 to "
                f"{MOST_STEPS}; better give {key}, in seconds"
            )
        # Without the last digits, in which 3 x 0.1 is not 0.3.
        changed[key] = round(float(steps * control_dt), 9)
    return changed


def _is_count(steps: Any) -> bool:
    if isinstance(steps, bool) or not isinstance(steps, (int, float, np.integer)):
        return False
    return bool(1 <= steps <= MOST_STEPS and steps % 1 == 0)
