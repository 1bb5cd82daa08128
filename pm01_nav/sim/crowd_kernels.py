# SPDX-License-Identifier: Apache-2.0
"""Step and reset robots in worlds in which something moves."""

from __future__ import annotations

from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.kernels import CHUNK, begin_episode, choose_world, move, observe, place
from pm01_nav.sim.mover_starts import place_start
from pm01_nav.sim.movers import step_movers
from pm01_nav.sim.pedestrians import new_tables


@compiled(parallel=True, allocates=True)
def step_batch(state, command, base, lidar, worlds, time, trail, crowd):
    """Apply one command (num_envs, 2) [m/s, rad/s] to every environment for a control step."""
    num_envs = state.pose.shape[0]
    for chunk in prange((num_envs + CHUNK - 1) // CHUNK):
        some = chunk * CHUNK, min((chunk + 1) * CHUNK, num_envs)
        tables = new_tables(state.mover_position.shape[1])
        step_some(state, some, command, base, lidar, worlds, time, trail, crowd, tables)


@compiled(inline=False)
def step_some(state, some, command, base, lidar, worlds, time, trail, crowd, tables):
    """Step the environments from the first to the second of ``some``.

    ``tables`` is room for their movers.
    """
    for i in range(some[0], some[1]):
        drift = 0.0
        if state.mover_count[i] > 0:
            drift = step_movers(state, i, base, worlds, crowd, tables)
        move(state, i, command, base, worlds, time, drift)
    observe(state, some[0], some[1], base, lidar, worlds, trail)


@compiled
def reset_some(state, indices, base, lidar, worlds, trail, goal_distance, scratch):
    """Start a new episode in the environments ``indices`` (n,); see ``kernels``."""
    for i in indices:
        choose_world(state, i, worlds)
        x, y = place_start(state, i, base, worlds)
        place(state, i, x, y, worlds, goal_distance)
        begin_episode(state, i, worlds, scratch)
        observe(state, i, i + 1, base, lidar, worlds, trail)
