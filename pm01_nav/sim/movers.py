# SPDX-License-Identifier: Apache-2.0
"""Obstacles that move: step them, measure the distance to them, let the lidar see them.

In between two control steps a mover goes straight from its old to its new place.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.bounce import bounce
from pm01_nav.sim.collision import point_to_polygon, to_base
from pm01_nav.sim.lidar import cast_disc
from pm01_nav.sim.pedestrians import walk
from pm01_nav.worlds.mover_arrays import BOUNCE, TRACK


@compiled(inline=False)
def step_movers(state, i, base, worlds, crowd, tables):
    """Move all movers of one environment for a control step; ``tables`` is room to work in.

    Returns the speed of the fastest [m/s], infinity if one jumped from its track's end to its
    beginning.
    """
    count = state.mover_count[i]
    m = worlds.mover_begin[state.world[i]]
    walk(state, i, base, worlds, crowd, tables)
    fastest_squared = 0.0
    for k in range(count):
        kind = worlds.mover_kind[m + k]
        if kind == TRACK:
            if follow_track(state, i, k, m + k, crowd.dt, worlds):
                fastest_squared = np.inf
        elif kind == BOUNCE:
            fly(state, i, k, crowd.dt * worlds.mover_speed[m + k], crowd.dt, worlds)
        else:
            state.mover_position[i, k, 0] += crowd.dt * state.mover_velocity[i, k, 0]
            state.mover_position[i, k, 1] += crowd.dt * state.mover_velocity[i, k, 1]
        vx, vy = state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1]
        fastest_squared = max(fastest_squared, vx * vx + vy * vy)
    return np.sqrt(fastest_squared)


@compiled
def fly(state, i, k, length, dt, worlds):
    """Move a bouncing mover by ``length`` [m]; its velocity is that from its old to its new place.

    Its target holds the direction that it flies on in.
    """
    x, y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
    ux, uy, r = state.mover_target[i, k, 0], state.mover_target[i, k, 1], state.mover_radius[i, k]
    new_x, new_y, ux, uy = bounce(x, y, ux, uy, length, r, worlds, state.world[i])
    state.mover_position[i, k, 0], state.mover_position[i, k, 1] = new_x, new_y
    state.mover_velocity[i, k, 0] = (new_x - x) / dt
    state.mover_velocity[i, k, 1] = (new_y - y) / dt
    state.mover_target[i, k, 0], state.mover_target[i, k, 1] = ux, uy


@compiled
def follow_track(state, i, k, m, dt, worlds):
    """Move mover k, row m of the pool, along its track; return whether it jumped."""
    x, y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
    clock = state.mover_clock[i, k] + dt
    period = worlds.mover_period[m]
    jumped = worlds.mover_jumps[m] and clock >= period
    if clock >= period > 0.0:
        clock -= np.floor(clock / period) * period
    state.mover_clock[i, k] = clock
    new_x, new_y, vx, vy = on_track(worlds, m, clock)
    if not jumped:
        vx, vy = (new_x - x) / dt, (new_y - y) / dt
    state.mover_position[i, k, 0], state.mover_position[i, k, 1] = new_x, new_y
    state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy
    return jumped


@compiled
def on_track(worlds, m, clock):
    """Return where a track is at a time of its round [s], and its velocity: x, y, vx, vy."""
    first, period = worlds.mover_point_begin[m], worlds.mover_period[m]
    pieces = worlds.mover_point_begin[m + 1] - first - 1
    if period <= 0.0:
        return worlds.mover_points[first, 0], worlds.mover_points[first, 1], 0.0, 0.0
    part = clock / period * pieces
    row = min(int(part), pieces - 1)
    part -= row
    x, y = worlds.mover_points[first + row, 0], worlds.mover_points[first + row, 1]
    dx = worlds.mover_points[first + row + 1, 0] - x
    dy = worlds.mover_points[first + row + 1, 1] - y
    return x + part * dx, y + part * dy, dx * pieces / period, dy * pieces / period


@compiled(inline=False)
def mover_clearance(x, y, cos, sin, base, state, i, ago):
    """Return the distance from the footprint to the nearest mover [m], 1e9 if there is none.

    Movers are taken where they were ``ago`` seconds before the end of the control step.
    """
    best = 1e9
    polygon = base.vertices.shape[0] > 0
    for k in range(state.mover_count[i]):
        dx = state.mover_position[i, k, 0] - ago * state.mover_velocity[i, k, 0] - x
        dy = state.mover_position[i, k, 1] - ago * state.mover_velocity[i, k, 1] - y
        r = state.mover_radius[i, k]
        distance = np.sqrt(dx * dx + dy * dy) - r - base.radius
        if polygon and distance < best:
            dx, dy = to_base(dx, dy, cos, sin)
            distance = point_to_polygon(dx, dy, base) - r
        best = min(best, distance)
    return best - base.padding


@compiled(inline=False)
def cast_movers(x, y, cos, sin, lidar, state, ranges, i):
    """Shorten the beams of environment i (see ``cast_scan``) that meet a mover."""
    x, y = x + cos * lidar.x - sin * lidar.y, y + sin * lidar.x + cos * lidar.y
    cos, sin = (
        cos * lidar.mount_cos - sin * lidar.mount_sin,
        sin * lidar.mount_cos + cos * lidar.mount_sin,
    )
    for k in range(state.mover_count[i]):
        dx, dy = state.mover_position[i, k, 0] - x, state.mover_position[i, k, 1] - y
        r = state.mover_radius[i, k]
        reach = lidar.range_max + r
        if dx * dx + dy * dy <= reach * reach:
            dx, dy = to_base(dx, dy, cos, sin)
            cast_disc(dx, dy, r, lidar, ranges, i)
