# SPDX-License-Identifier: Apache-2.0
"""What bases make of commands: the kernels' part of ``drives``.

Within the kernels a twist is always forwards, to the left, and the turn (v, u, w). A drive that
cannot go sideways has no such number in its commands and twists, and its u is 0.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.drives import ELLIPSE
from pm01_nav.sim.dynamics import clip, next_speed


@compiled
def read_twist(values, i):
    """Return v, u, w of row i of commands or twists (num_envs, axes)."""
    if values.shape[1] == 3:
        return values[i, 0], values[i, 1], values[i, 2]
    return values[i, 0], 0.0, values[i, 1]


@compiled
def write_twist(values, i, v, u, w):
    """Write v, u, w into row i of commands or twists (num_envs, axes)."""
    values[i, 0], values[i, values.shape[1] - 1] = v, w
    if values.shape[1] == 3:
        values[i, 1] = u


@compiled
def within(v, u, w, base):
    """Return what the base follows of a commanded v, u, w; see ``Drive.clip``."""
    v = clip(v, base.linear_min, base.linear_max)
    u = clip(u, -base.lateral_max, base.lateral_max)
    w = clip(w, -base.angular_max, base.angular_max)
    if base.envelope == ELLIPSE and (v != 0.0 or u != 0.0):
        reach = -base.linear_min if v < 0.0 else base.linear_max
        ahead = 0.0 if v == 0.0 else v / reach
        excess = max(np.sqrt(ahead * ahead + (u / base.lateral_max) ** 2), 1.0)
        v, u = v / excess, u / excess
    return v, u, w


@compiled
def next_twist(v, u, w, target, base, time):
    """Return v, u, w after one integration step in which the base aims at ``target``."""
    keep, dt = time.lag_keep, time.dt
    return (
        next_speed(v, target[0], keep, base.linear_acceleration * dt),
        next_speed(u, target[1], keep, base.lateral_acceleration * dt),
        next_speed(w, target[2], keep, base.angular_acceleration * dt),
    )
