# SPDX-License-Identifier: Apache-2.0
"""Step and reset the whole batch: one parallel loop over environments.

Not every batch has robots with errors (``errors``, ``drawn``, ``ranges``) or obstacles that move
(``crowd``, ``tables``). Whatever it lacks is ``ABSENT``, the empty tuple: a tuple's length is known
to the compiler, which leaves the code for it out, and other batches neither compile nor run it.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import clearance, polar
from pm01_nav.sim.drive_errors import begin_commands, drive, true_base, true_crowd, true_time
from pm01_nav.sim.drive_motion import next_twist, read_twist, within, write_twist
from pm01_nav.sim.dynamics import arc, wrap
from pm01_nav.sim.lidar import add_noise, cast_scan, nearest_in_sectors
from pm01_nav.sim.lidar_errors import disturb, hand_out, true_lidar
from pm01_nav.sim.mover_starts import draw_start, place_start
from pm01_nav.sim.movers import cast_movers, mover_clearance, step_movers
from pm01_nav.sim.odometry import advance_odometry, begin_odometry, measure
from pm01_nav.sim.path_distance import read_distance, spread_distance
from pm01_nav.sim.pedestrians import new_tables
from pm01_nav.sim.perturbation import draw_errors
from pm01_nav.sim.random import draw_row, uniform
from pm01_nav.sim.sweep import sweep_scan
from pm01_nav.sim.trail import begin_trail, follow_trail

ABSENT = ()
"""What a kernel is handed in place of errors or movers that a batch does not have."""
CHUNK = 16
"""Environments that a thread steps in one go."""
GOAL_DRAWS = 256
"""Draws of a goal at an allowed distance; then the one that misses it least is taken."""


@compiled(parallel=True)
def step_batch(state, errors, drawn, command, base, lidar, worlds, time, trail, crowd):
    """Apply one command (num_envs, axes) [m/s, rad/s] to every environment for a control step."""
    num_envs = state.pose.shape[0]
    for chunk in prange((num_envs + CHUNK - 1) // CHUNK):
        some = chunk * CHUNK, min((chunk + 1) * CHUNK, num_envs)
        if len(crowd) == 0:
            step_some(
                state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd, ABSENT
            )
        else:
            step_among_movers(
                state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd
            )


@compiled(inline=False, allocates=True)
def step_among_movers(state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd):
    """Step some environments with room for their movers, which all of them use in turn."""
    tables = new_tables(state.mover_position.shape[1])
    step_some(state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd, tables)


@compiled
def step_some(state, errors, drawn, some, command, base, lidar, worlds, time, trail, crowd, tables):
    """Step the environments from the first to the second of ``some``."""
    for i in range(some[0], some[1]):
        x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
        advance(state, errors, drawn, i, command, base, worlds, time, crowd, tables)
        if len(errors) > 0:
            observe_wrongly(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, False)
    if len(errors) == 0:
        observe(state, some[0], some[1], base, lidar, worlds, trail)


@compiled
def reset_some(
    state,
    errors,
    drawn,
    ranges,
    indices,
    base,
    lidar,
    worlds,
    trail,
    goal_distance,
    scratch,
    crowd,
):
    """Start a new episode, with new errors, in the environments ``indices`` (n,).

    ``goal_distance`` (2,): least and greatest distance from the start to the goal [m]; ``ranges``
    is what the errors are drawn from.
    """
    for i in indices:
        place_anew(state, errors, drawn, ranges, i, base, worlds, goal_distance, crowd)
        begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch)


@compiled
def observe_some(state, errors, drawn, indices, base, lidar, worlds, trail, scratch):
    """Begin episodes in environments whose poses and goals were set from outside.

    Errors stay those of the present episodes.
    """
    for i in indices:
        begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch)


@compiled(parallel=True)
def true_ranges(state, base, lidar, worlds, ranges):
    """Write into ``ranges`` (like ``state.ranges``) what a flawless lidar would measure [m]."""
    for i in prange(state.pose.shape[0]):
        look(state, i, lidar, worlds, ranges)


@compiled
def advance(state, errors, drawn, i, command, base, worlds, time, crowd, tables):
    """Move the movers and the robot of one environment, and its odometry along."""
    if len(errors) == 0:
        drift = move_movers(state, i, base, worlds, crowd, tables)
        move(state, i, command, base, worlds, time, drift)
    else:
        key, count = state.rng_key, state.rng_count
        x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
        drive(errors, drawn, i, command, base, key, count)
        own_time = true_time(drawn, i, time, key, count)
        drift = move_movers(state, i, base, worlds, true_crowd(crowd, own_time), tables)
        move(state, i, errors.command, true_base(drawn, i, base), worlds, own_time, drift)
        advance_odometry(state, errors, drawn, i, x, y, yaw)


@compiled
def move_movers(state, i, base, worlds, crowd, tables):
    """Move what moves in one environment; return the speed of the fastest [m/s]."""
    if len(crowd) > 0 and state.mover_count[i] > 0:
        return step_movers(state, i, base, worlds, crowd, tables)
    return 0.0


@compiled
def move(state, i, command, base, worlds, time, drift):
    """Integrate one environment; an obstacle stops the robot where it last was free.

    ``drift`` is the speed of the fastest mover [m/s], all of which have made their step already.
    """
    v, u, w = read_twist(command, i)
    target = within(v, u, w, base)
    x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
    v, u, w = read_twist(state.twist, i)
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    # No point of the footprint can come nearer than `slack` to an obstacle unseen.
    slack = state.clearance[i]
    state.contact[i] = False
    for n in range(time.substeps):
        v_next, u_next, w_next = next_twist(v, u, w, target, base, time)
        v_mean, u_mean, w_mean = 0.5 * (v + v_next), 0.5 * (u + u_next), 0.5 * (w + w_next)
        x_next, y_next, cos_next, sin_next = arc(x, y, cos, sin, v_mean, u_mean, w_mean, time.dt)
        speed = abs(v_mean) + abs(u_mean)  # or less
        slack -= (speed + abs(w_mean) * base.radius + drift) * time.dt
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
                v, u, w = 0.0, 0.0, 0.0
                break
        x, y, cos, sin = x_next, y_next, cos_next, sin_next
        v, u, w = v_next, u_next, w_next
        yaw += w_mean * time.dt
    yaw = wrap(yaw)
    state.pose[i, 0], state.pose[i, 1], state.pose[i, 2] = x, y, yaw
    # Afresh from the yaw: products of many small turns would drift from it.
    state.heading[i, 0], state.heading[i, 1] = np.cos(yaw), np.sin(yaw)
    write_twist(state.twist, i, v, u, w)


@compiled(inline=False)
def observe(state, begin, end, base, lidar, worlds, trail):
    """Measure scan, clearance and goal of the environments ``begin`` to ``end`` at their poses.

    It stands apart because it takes long to compile and is needed in several kernels.
    """
    for i in range(begin, end):
        locate(state, i, base, worlds)
        look(state, i, lidar, worlds, state.ranges)
        read(state, i, lidar, trail)


@compiled(inline=False)
def observe_wrongly(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, first):
    """Measure clearance and goal truly, then what sensors say after a step from (x, y, yaw).

    ``first`` tells whether an episode begins.
    """
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


@compiled
def look(state, i, lidar, worlds, ranges):
    """Write the exact ranges of one environment; on a GPU a thread has some of the beams only."""
    x, y = state.pose[i, 0], state.pose[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    cast_scan(x, y, cos, sin, lidar, worlds, state.world[i], ranges, i)
    if state.mover_count[i] > 0:
        cast_movers(x, y, cos, sin, lidar, state, ranges, i)


@compiled
def read(state, i, lidar, trail):
    """Make of the exact ranges of one environment what is measured and remembered."""
    if lidar.noise_std > 0.0:
        add_noise(lidar, state.ranges, state.rng_key, state.rng_count, i)
    nearest_in_sectors(lidar, state.ranges, state.nearest, i)
    if state.visited.shape[1] > 0:
        x, y = state.pose[i, 0], state.pose[i, 1]
        follow_trail(state, i, trail, x, y, state.heading[i, 0], state.heading[i, 1])


@compiled
def locate(state, i, base, worlds):
    """Measure clearance and goal of one environment at its pose."""
    x, y = state.pose[i, 0], state.pose[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    state.clearance[i] = clearance(x, y, cos, sin, base, worlds, state.world[i])
    if state.mover_count[i] > 0:
        near = mover_clearance(x, y, cos, sin, base, state, i, 0.0)
        state.clearance[i] = min(state.clearance[i], near)
    distance, bearing = polar(state.goal[i, 0] - x, state.goal[i, 1] - y, cos, sin)
    state.goal_polar[i, 0], state.goal_polar[i, 1] = distance, bearing
    read_distance(state, i, worlds)


@compiled
def place_anew(state, errors, drawn, ranges, i, base, worlds, goal_distance, crowd):
    """Draw world, start, goal and errors of an episode."""
    choose_world(state, i, worlds)
    if len(crowd) == 0:
        x, y = draw_start(state, i, worlds)
    else:
        x, y = place_start(state, i, base, worlds)
    place(state, i, x, y, worlds, goal_distance)
    if len(errors) > 0:
        draw_errors(errors, drawn, ranges, state.rng_key, state.rng_count, i)


@compiled
def begin(state, errors, drawn, i, base, lidar, worlds, trail, scratch):
    """Begin an episode at the present pose, and look around."""
    begin_episode(state, errors, drawn, i, worlds, scratch)
    if len(errors) == 0:
        observe(state, i, i + 1, base, lidar, worlds, trail)
    else:
        x, y, yaw = state.pose[i, 0], state.pose[i, 1], state.pose[i, 2]
        observe_wrongly(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, True)


@compiled(inline=False)
def begin_episode(state, errors, drawn, i, worlds, scratch):
    """Prepare what one environment remembers and is paid by, once start and goal are known.

    No command is on its way, and odometry has not drifted.
    """
    begin_trail(state, i)
    # So it stays where the raster is closed around the start; else it is read there.
    dx, dy = state.goal[i, 0] - state.pose[i, 0], state.goal[i, 1] - state.pose[i, 1]
    state.path_distance[i] = np.sqrt(dx * dx + dy * dy)
    if state.path_field.shape[1] > 0:
        spread_distance(state, i, worlds, scratch)
    if len(errors) > 0:
        begin_commands(errors, i)
        begin_odometry(state, errors, drawn, i, state.rng_key, state.rng_count)


@compiled
def choose_world(state, i, worlds):
    """Draw a world, unless one is fixed."""
    if state.world[i] < 0:
        number = uniform(state.rng_key, state.rng_count, i)
        w = np.searchsorted(worlds.cumulative_weight, number, side="right")
        state.world[i] = min(w, worlds.cumulative_weight.shape[0] - 1)


@compiled
def place(state, i, x, y, worlds, goal_distance):
    """Draw a goal and a heading for a robot that starts at (x, y); stand still there."""
    key, count, w = state.rng_key, state.rng_count, state.world[i]
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
    write_twist(state.twist, i, 0.0, 0.0, 0.0)
    state.contact[i] = False
