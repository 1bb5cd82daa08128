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
def follow_trail(state, i, trail):
    """Note the present place when it is time to, then look back at all noted places."""
    if state.age[i] % trail.interval_steps == 0:
        slot = state.trail_length[i] % state.trail.shape[1]
        state.trail[i, slot, 0], state.trail[i, slot, 1] = state.pose[i, 0], state.pose[i, 1]
        state.trail_length[i] += 1
    state.age[i] += 1
    look_back(state, i, trail)


@compiled
def look_back(state, i, trail):
    """Sum up how much of the trail lies in each sector around the robot, 0 to 1.

    ``task.trail.visited_sectors`` is the same for a policy on a robot and says what it means.
    """
    x, y = state.pose[i, 0], state.pose[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    sectors = state.visited.shape[1]
    for s in range(sectors):
        state.visited[i, s] = 0.0
    for k in range(min(state.trail_length[i], state.trail.shape[1])):
        dx, dy = to_base(state.trail[i, k, 0] - x, state.trail[i, k, 1] - y, cos, sin)
        distance = np.sqrt(dx * dx + dy * dy)
        if distance < trail.reach:
            weight = min(distance / trail.near, 1.0) * (1.0 - distance / trail.reach)
            place = (direction(dx, dy) / (2.0 * np.pi) + 0.5) * sectors - 0.5
            right = int(np.floor(place))
            share = place - right
            state.visited[i, right % sectors] += np.float32(weight * (1.0 - share))
            state.visited[i, (right + 1) % sectors] += np.float32(weight * share)
    for s in range(sectors):
        state.visited[i, s] /= np.float32(1.0) + state.visited[i, s]
