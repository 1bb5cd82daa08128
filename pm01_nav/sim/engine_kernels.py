# SPDX-License-Identifier: Apache-2.0
"""What is left to compute where a physics engine moves the robots and casts their beams."""

from __future__ import annotations

from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.kernels import locate, read
from pm01_nav.sim.movers import step_movers
from pm01_nav.sim.pedestrians import new_tables
from pm01_nav.sim.trail import begin_trail


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
        if first:
            begin_trail(state, i)
        read(state, i, lidar, trail)
