# SPDX-License-Identifier: Apache-2.0
"""Step and reset the whole batch: one parallel loop over environments."""

from __future__ import annotations

import numpy as np
from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import clearance, to_base
from pm01_nav.sim.dynamics import arc, clip, next_speed, wrap
from pm01_nav.sim.lidar import add_noise, cast_scan, nearest_in_sectors, read_scan
from pm01_nav.sim.mover_starts import place_start
from pm01_nav.sim.movers import cast_movers, mover_clearance, step_movers
from pm01_nav.sim.path_distance import read_distance, spread_distance
from pm01_nav.sim.pedestrians import new_tables
from pm01_nav.sim.random import draw_row, uniform
from pm01_nav.sim.trail import begin_trail, follow_trail

CHUNK = 16
"""Environments that a thread steps in one go."""
GOAL_DRAWS = 256
"""Draws of a goal at an allowed distance; then the one that misses it least is taken."""


@compiled(parallel=True, allocates=True)
def step_batch(state, command, base, lidar, worlds, time, crowd, trail):
    """Apply one command (num_envs, 2) [m/s, rad/s] to every environment for a control step."""
    num_envs = state.pose.shape[0]
    for chunk in prange((num_envs + CHUNK - 1) // CHUNK):
        begin, end = chunk * CHUNK, min((chunk + 1) * CHUNK, num_envs)
        tables = new_tables(state.mover_position.shape[1])
        step_some(state, begin, end, command, base, lidar, worlds, time, crowd, trail, tables)


@compiled(inline=False)
def step_some(state, begin, end, command, base, lidar, worlds, time, crowd, trail, tables):
    """Step the environments ``begin`` to ``end``; ``tables`` is room for their movers."""
    for i in range(begin, end):
        drift = 0.0
        if state.mover_count[i] > 0:
            drift = step_movers(state, i, base, worlds, crowd, tables)
        move(state, i, command, base, worlds, time, drift)
        observe(state, i, base, lidar, worlds, trail)


def _reset(state, indices, base, lidar, worlds, trail, goal_distance, scratch):
    """Start a new episode in the environments ``indices`` (n,).

    ``goal_distance`` (2,): least and greatest distance from the start to the goal [m].
    """
    for k in prange(indices.shape[0]):
        i = indices[k]
        place(state, i, base, worlds, goal_distance)
        begin_episode(state, i, worlds, scratch)
        observe(state, i, base, lidar, worlds, trail)


reset_many = compiled(parallel=True)(_reset)
# Waking the other threads takes longer than a few resets.
reset_few = compiled(_reset)


@compiled(parallel=True)
def observe_batch(state, indices, base, lidar, worlds, trail, scratch):
    """Begin episodes in environments whose poses and goals were set from outside."""
    for k in prange(indices.shape[0]):
        begin_episode(state, indices[k], worlds, scratch)
        observe(state, indices[k], base, lidar, worlds, trail)


@compiled
def move(state, i, command, base, worlds, time, drift):
    """Integrate one environment; an obstacle stops the robot where it last was free.

    ``drift`` is the speed of the fastest mover [m/s], all of which have made their step already.
    """
    linear = clip(command[i, 0], base.linear_min, base.linear_max)
    angular = clip(command[i, 1], -base.angular_max, base.angular_max)
    x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
    v, w = state.twist[i, 0], state.twist[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    # No point of the footprint can come nearer than `slack` to an obstacle unseen.
    slack = state.clearance[i]
    state.contact[i] = False
    for n in range(time.substeps):
        v_next = next_speed(v, linear, time.lag_keep, base.linear_acceleration * time.dt)
        w_next = next_speed(w, angular, time.lag_keep, base.angular_acceleration * time.dt)
        v_mean, w_mean = 0.5 * (v + v_next), 0.5 * (w + w_next)
        x_next, y_next, cos_next, sin_next = arc(x, y, cos, sin, v_mean, w_mean, time.dt)
        slack -= (abs(v_mean) + abs(w_mean) * base.radius + drift) * time.dt
        if slack <= 0.0:
            slack = clearance(x_next, y_next, cos_next, sin_next, base, worlds, state.world[i])
            if state.mover_count[i] > 0:
                ago = (time.substeps - 1 - n) * time.dt
                slack = min(
                    slack,
                    mover_clearance(x_next, y_next, cos_next, sin_next, base, state, i, ago),
                )
            if slack <= 0.0:
                state.contact[i] = True
                v, w = 0.0, 0.0
                break
        x, y, cos, sin, v, w = x_next, y_next, cos_next, sin_next, v_next, w_next
        yaw += w_mean * time.dt
    yaw = wrap(yaw)
    state.pose[i, 0], state.pose[i, 1], state.pose[i, 2] = x, y, yaw
    # Afresh from the yaw: products of many small turns would drift from it.
    state.heading[i, 0], state.heading[i, 1] = np.cos(yaw), np.sin(yaw)
    state.twist[i, 0], state.twist[i, 1] = v, w


@compiled
def observe(state, i, base, lidar, worlds, trail):
    """Measure scan, clearance and goal of one environment at its pose."""
    x, y = state.pose[i, 0], state.pose[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    state.clearance[i] = clearance(x, y, cos, sin, base, worlds, state.world[i])
    cast_scan(x, y, cos, sin, lidar, worlds, state.world[i], state.ranges, i)
    if state.mover_count[i] > 0:
        near = mover_clearance(x, y, cos, sin, base, state, i, 0.0)
        state.clearance[i] = min(state.clearance[i], near)
        cast_movers(x, y, cos, sin, lidar, state, i)
    if lidar.noise_std > 0.0:
        add_noise(lidar, state.ranges, state.rng_key, state.rng_count, i)
    read_scan(lidar, state.ranges, state.scan, i)
    nearest_in_sectors(state.scan, state.nearest, i)
    dx, dy = state.goal[i, 0] - x, state.goal[i, 1] - y
    ahead, left = to_base(dx, dy, cos, sin)
    state.goal_polar[i, 0] = np.sqrt(dx * dx + dy * dy)
    state.goal_polar[i, 1] = np.arctan2(left, ahead)
    read_distance(state, i, worlds)
    if state.visited.shape[1] > 0:
        follow_trail(state, i, trail)


@compiled
def begin_episode(state, i, worlds, scratch):
    """Prepare what one environment remembers and is paid by, once start and goal are known."""
    begin_trail(state, i)
    if state.path_field.shape[1] > 0:
        spread_distance(state, i, worlds, scratch)


@compiled
def place(state, i, base, worlds, goal_distance):
    """Draw a world (unless one is fixed), a start, a goal and a heading; stand still there."""
    key, count = state.rng_key, state.rng_count
    w = state.world[i]
    if w < 0:
        w = np.searchsorted(worlds.cumulative_weight, uniform(key, count, i), side="right")
        w = min(w, worlds.cumulative_weight.shape[0] - 1)
        state.world[i] = w
    x, y = place_start(state, i, base, worlds)
    least_miss = np.inf
    for _ in range(GOAL_DRAWS):
        goal = draw_row(worlds.goal_begin, w, uniform(key, count, i))
        goal_x = worlds.goals[goal, 0] + worlds.jitter[w, 1] * (2.0 * uniform(key, count, i) - 1.0)
        goal_y = worlds.goals[goal, 1] + worlds.jitter[w, 1] * (2.0 * uniform(key, count, i) - 1.0)
        distance = np.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        miss = max(goal_distance[0] - distance, distance - goal_distance[1], 0.0)
        if miss < least_miss:
            least_miss = miss
            state.goal[i, 0], state.goal[i, 1] = goal_x, goal_y
        if miss == 0.0:
            break
    yaw = np.pi * (2.0 * uniform(key, count, i) - 1.0)
    if not np.isnan(worlds.start_yaw[w]):
        yaw = wrap(worlds.start_yaw[w])
    state.pose[i, 0], state.pose[i, 1], state.pose[i, 2] = x, y, yaw
    state.heading[i, 0], state.heading[i, 1] = np.cos(yaw), np.sin(yaw)
    state.twist[i, 0], state.twist[i, 1] = 0.0, 0.0
    state.contact[i] = False
