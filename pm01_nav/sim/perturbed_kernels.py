# SPDX-License-Identifier: Apache-2.0
"""Step and reset robots that differ from their description, each in its own way.

The nominal kernels stay as they are, and as fast: a perturbed robot is moved by the same ``move``,
with a base and a time step of its own.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.drive_errors import begin_commands, drive, true_base, true_crowd, true_time
from pm01_nav.sim.kernels import CHUNK, begin_episode, choose_world, locate, move, place
from pm01_nav.sim.lidar import cast_scan, nearest_in_sectors
from pm01_nav.sim.lidar_errors import disturb, hand_out, true_lidar
from pm01_nav.sim.mover_starts import place_start
from pm01_nav.sim.movers import cast_movers, step_movers
from pm01_nav.sim.odometry import advance_odometry, begin_odometry, measure
from pm01_nav.sim.pedestrians import new_tables
from pm01_nav.sim.perturbation import draw_errors
from pm01_nav.sim.sweep import sweep_scan
from pm01_nav.sim.trail import follow_trail


@compiled(parallel=True, allocates=True)
def step_batch(state, errors, drawn, command, base, lidar, worlds, time, trail, crowd):
    """Apply one command (num_envs, 2) [m/s, rad/s] to every environment for a control step."""
    num_envs = state.pose.shape[0]
    for chunk in prange((num_envs + CHUNK - 1) // CHUNK):
        some = chunk * CHUNK, min((chunk + 1) * CHUNK, num_envs)
        tables = new_tables(state.mover_position.shape[1])
        step_some(
            state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd, tables
        )


@compiled(inline=False)
def step_some(state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd, tables):
    """Step the environments from the first to the second of ``some``; see ``crowd_kernels``."""
    for i in range(some[0], some[1]):
        x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
        move_wrongly(state, errors, drawn, i, command, base, worlds, time, crowd, tables)
        observe(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, False)


@compiled
def move_wrongly(state, errors, drawn, i, command, base, worlds, time, crowd, tables):
    """Move the movers and the robot of one environment, and its odometry along."""
    key, count = state.rng_key, state.rng_count
    x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
    drive(errors, drawn, i, command, base, key, count)
    own_time = true_time(drawn, i, time, key, count)
    drift = 0.0
    if state.mover_count[i] > 0:
        own_crowd = true_crowd(crowd, own_time)
        drift = step_movers(state, i, base, worlds, own_crowd, tables)
    move(state, i, errors.command, true_base(drawn, i, base), worlds, own_time, drift)
    advance_odometry(state, errors, drawn, i, x, y, yaw)


@compiled
def reset_some(
    state, errors, drawn, ranges, indices, base, lidar, worlds, trail, goal_distance, scratch
):
    """Start a new episode, with new errors, in the environments ``indices`` (n,).

    ``ranges`` is what the errors are drawn from; the rest is as for robots without errors.
    """
    for i in indices:
        place_anew(state, errors, drawn, ranges, i, base, worlds, goal_distance)
        begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch)


@compiled
def place_anew(state, errors, drawn, ranges, i, base, worlds, goal_distance):
    """Draw world, start, goal and errors of an episode."""
    choose_world(state, i, worlds)
    x, y = place_start(state, i, base, worlds)
    place(state, i, x, y, worlds, goal_distance)
    draw_errors(errors, drawn, ranges, state.rng_key, state.rng_count, i)


@compiled
def observe_some(state, errors, drawn, indices, base, lidar, worlds, trail, scratch):
    """Begin anew at poses that were set from outside, with the errors of the present episodes."""
    for i in indices:
        begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch)


@compiled
def begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch):
    """Stand still at the present pose and look around."""
    stand(state, errors, drawn, i, worlds, scratch)
    x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
    observe(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, True)


@compiled
def stand(state, errors, drawn, i, worlds, scratch):
    """Forget the last episode: no command is on its way, and odometry has not drifted."""
    begin_episode(state, i, worlds, scratch)
    begin_commands(errors, i)
    begin_odometry(state, errors, drawn, i, state.rng_key, state.rng_count)


@compiled(inline=False)
def observe(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, first):
    """Measure clearance and goal truly, then what sensors say after a step from (x, y, yaw)."""
    key, count = state.rng_key, state.rng_count
    locate(state, i, true_base(drawn, i, base), worlds)
    measure(state, errors, drawn, i)
    own_lidar = true_lidar(drawn, i, lidar)
    sweep_scan(state, errors, drawn, i, x, y, yaw, own_lidar, worlds)
    disturb(drawn, own_lidar, state.ranges, key, count, i)
    hand_out(state, errors, drawn, i, own_lidar, first)
    nearest_in_sectors(lidar, state.ranges, state.nearest, i)
    if state.visited.shape[1] > 0:
        x, y, yaw = (
            errors.odometry_pose[i, 0],
            errors.odometry_pose[i, 1],
            errors.odometry_pose[i, 2],
        )
        follow_trail(state, i, trail, x, y, np.cos(yaw), np.sin(yaw))


@compiled(parallel=True)
def true_ranges(state, base, lidar, worlds, ranges):
    """Write into ``ranges`` (like ``state.ranges``) what a flawless lidar would measure [m]."""
    for i in prange(state.pose.shape[0]):
        x, y = state.pose[i, 0], state.pose[i, 1]
        cos, sin = state.heading[i, 0], state.heading[i, 1]
        cast_scan(x, y, cos, sin, lidar, worlds, state.world[i], ranges, i)
        cast_movers(x, y, cos, sin, lidar, state, ranges, i)
