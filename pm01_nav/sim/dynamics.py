# SPDX-License-Identifier: Apache-2.0
"""Motion in the plane: lag, limits, and arcs that are exact for a constant twist."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled


@compiled
def clip(value, low, high):
    """Return ``value`` kept within [low, high]."""
    return min(max(value, low), high)


@compiled
def next_speed(speed, command, keep, change_max):
    """Answer a command within one time step.

    ``keep`` = exp(-dt / lag) is the part of the error that a first-order lag leaves;
    ``change_max`` = acceleration limit x dt.
    """
    wanted = command + (speed - command) * keep
    return speed + clip(wanted - speed, -change_max, change_max)


@compiled
def wrap(angle):
    """Return the same direction in [-pi, pi)."""
    if angle < -np.pi or angle >= np.pi:
        return angle - 2.0 * np.pi * np.floor((angle + np.pi) / (2.0 * np.pi))
    return angle


@compiled
def arc(x, y, cos, sin, v, u, w, dt):
    """Move along the arc of a constant twist; return x, y and the new heading's cos, sin.

    ``v`` leads forwards and ``u`` to the left. The chord of an arc of angle 2 a is sin(a) / a as
    long as the way, and leads a away from it.
    """
    a = 0.5 * w * dt
    if abs(a) < 0.1:
        # Taylor series: the next term is below 1e-17. (Products are several times faster here.)
        q = a * a
        sin_over_a = 1.0 - q * (1 / 6) * (
            1.0 - q * (1 / 20) * (1.0 - q * (1 / 42) * (1.0 - q * (1 / 72)))
        )
        cos_a = 1.0 - q * 0.5 * (1.0 - q * (1 / 12) * (1.0 - q * (1 / 30) * (1.0 - q * (1 / 56))))
        sin_a = a * sin_over_a
    else:
        sin_a, cos_a = np.sin(a), np.cos(a)
        sin_over_a = sin_a / a
    ahead, left = v * dt * sin_over_a, u * dt * sin_over_a
    along_cos, along_sin = cos * cos_a - sin * sin_a, sin * cos_a + cos * sin_a
    x += ahead * along_cos - left * along_sin
    y += ahead * along_sin + left * along_cos
    return x, y, along_cos * cos_a - along_sin * sin_a, along_sin * cos_a + along_cos * sin_a
