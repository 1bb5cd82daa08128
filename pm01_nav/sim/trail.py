# SPDX-License-Identifier: Apache-2.0
"""Where the robot has been in this episode, as it can remember it from its odometry."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import to_base
from pm01_nav.sim.lidar import direction


@compiled
def begin_trail(state, i):
    """Forget the last episode."""
    state.age[i] = 0
    state.trail_length[i] = 0


@compiled
def follow_trail(state, i, trail, x, y, cos, sin):
    """Note the present place when it is time to, then look back at all noted places.

    ``x``, ``y``, ``cos``, ``sin`` are the robot's place and heading by odometry.
    """
    if state.age[i] % trail.interval_steps == 0:
        slot = state.trail_length[i] % state.trail.shape[1]
        state.trail[i, slot, 0], state.trail[i, slot, 1] = x, y
        state.trail_length[i] += 1
    state.age[i] += 1
    look_back(state, i, trail, x, y, cos, sin)


@compiled
def look_back(state, i, trail, x, y, cos, sin):
    """Sum up how much of the trail lies in each sector, 0 to 1, and how familiar this place is.

    ``task.trail.visited_sectors`` and ``familiarity`` are the same for a policy on a robot and say
    what they mean.
    """
    sectors, capacity = state.visited.shape[1] - 1, state.trail.shape[1]
    for s in range(sectors):
        state.visited[i, s] = 0.0
    nearest = trail.near
    per_near, per_reach, per_radian = 1.0 / trail.near, 1.0 / trail.reach, sectors / (2.0 * np.pi)
    latest = (state.trail_length[i] - 1) % capacity
    for k in range(min(state.trail_length[i], capacity)):
        dx, dy = to_base(state.trail[i, k, 0] - x, state.trail[i, k, 1] - y, cos, sin)
        if dx * dx + dy * dy >= trail.reach * trail.reach:
            continue
        distance = np.sqrt(dx * dx + dy * dy)
        later = latest - k if k <= latest else latest - k + capacity
        if later >= trail.settled_places:
            nearest = min(nearest, distance)
        weight = min(distance * per_near, 1.0) * (1.0 - distance * per_reach)
        place = direction(dx, dy) * per_radian + 0.5 * sectors - 0.5
        right = np.floor(place)
        share = place - right
        left = int(right) + 1  # 0 to ``sectors``, which is 0 again; remainders take long
        state.visited[i, left - 1 if left > 0 else sectors - 1] += np.float32(
            weight * (1.0 - share)
        )
        state.visited[i, left if left < sectors else 0] += np.float32(weight * share)
    for s in range(sectors):
        state.visited[i, s] /= np.float32(1.0) + state.visited[i, s]
    state.visited[i, sectors] = np.float32(1.0 - nearest / trail.near)
