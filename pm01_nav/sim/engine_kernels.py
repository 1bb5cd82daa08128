# SPDX-License-Identifier: Apache-2.0
"""What is left to compute where a physics engine moves the robots and casts their beams."""

from __future__ import annotations

from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.kernels import locate
from pm01_nav.sim.lidar import add_noise, nearest_in_sectors
from pm01_nav.sim.movers import step_movers
from pm01_nav.sim.pedestrians import new_tables
from pm01_nav.sim.trail import begin_trail, follow_trail


@compiled(parallel=True, allocates=True)
def move_obstacles(state, base, worlds, crowd):
    """Move the obstacles of every environment that move, for a control step."""
    for i in prange(state.pose.shape[0]):
        if state.mover_count[i] > 0:
            tables = new_tables(state.mover_position.shape[1])
            step_movers(state, i, base, worlds, crowd, tables)


@compiled
def perceive(state, indices, base, lidar, worlds, trail, first):
    """Measure what the environments ``indices`` (n,) are owed at their poses and exact ranges.

    ``first`` tells whether an episode begins.
    """
    for i in indices:
        locate(state, i, base, worlds)
        if lidar.noise_std > 0.0:
            add_noise(lidar, state.ranges, state.rng_key, state.rng_count, i)
        nearest_in_sectors(lidar, state.ranges, state.nearest, i)
        if first:
            begin_trail(state, i)
        if state.visited.shape[1] > 0:
            x, y = state.pose[i, 0], state.pose[i, 1]
            follow_trail(state, i, trail, x, y, state.heading[i, 0], state.heading[i, 1])
