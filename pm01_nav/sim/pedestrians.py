# SPDX-License-Identifier: Apache-2.0
"""Pedestrians: where they want to go, and how they avoid what is in the way.

Whichever model they follow, they are solid: nobody walks into what stands still, and of the gap
between two each closes half a step at most (buffered Voronoi cells, Zhou et al., RA-L 2, 2017).
Standing still is always allowed, so that neither is ever given up for the other.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.orca import avoidance, choose_velocity
from pm01_nav.sim.random import draw_row, uniform
from pm01_nav.sim.social_force import RELAXATION, repulsion, wall_repulsion
from pm01_nav.sim.state import ORCA
from pm01_nav.sim.surroundings import MAX_WALLS, find_walls
from pm01_nav.worlds.mover_arrays import PEDESTRIAN

HASTE = 1.3
"""The greatest speed over the preferred one (Helbing and Molnar 1995)."""
ARRIVED = 0.3
"""A pedestrian this near to where it walks goes on to the next place [m]."""
PATIENCE, PATIENCE_FACTOR = 5.0, 2.0
"""It gives a place up after so long [s] and so many times what the straight way takes."""
NEIGHBOURS = 3.0
"""Whom a pedestrian looks at: all nearer than this, centre to centre [m]."""
PARTING = 1.0 / HASTE
"""What overlaps parts at the preferred speed at most, this part of the greatest."""
WALL_HORIZON = 0.5
"""In this time a pedestrian closes a gap to what stands still at most [s]."""
X, Y, VX, VY, RADIUS, FAST, WANT_X, WANT_Y, WALKS = range(9)
"""Columns of a table of movers: place, velocity, radius, greatest speed, wanted velocity, and 1 for
a pedestrian, 0 for others."""


@compiled(inline=False, allocates=False)
def begin_leg(state, i, k, worlds):
    """Send a pedestrian to its next waypoint, or to a place drawn from its world."""
    m = worlds.mover_begin[state.world[i]] + k
    first = worlds.mover_point_begin[m]
    count = worlds.mover_point_begin[m + 1] - first
    x, y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
    if count > 1:
        state.mover_leg[i, k] = (state.mover_leg[i, k] + 1) % count
        row = first + state.mover_leg[i, k]
        goal_x, goal_y = worlds.mover_points[row, 0], worlds.mover_points[row, 1]
    else:
        goal_x, goal_y = draw_place(state, i, worlds, x, y)
    state.mover_target[i, k, 0], state.mover_target[i, k, 1] = goal_x, goal_y
    straight = np.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2) / worlds.mover_speed[m]
    state.mover_clock[i, k] = PATIENCE + PATIENCE_FACTOR * straight


@compiled(allocates=False)
def draw_place(state, i, worlds, x, y):
    """Draw a place in which pedestrians have room; without any, return (x, y)."""
    w = state.world[i]
    if worlds.mover_place_begin[w + 1] == worlds.mover_place_begin[w]:
        return x, y
    number = uniform(state.rng_key, state.rng_count, i)
    row = draw_row(worlds.mover_place_begin, w, number)
    return worlds.mover_places[row, 0], worlds.mover_places[row, 1]


@compiled(allocates=False)
def wanted_velocity(state, i, k, speed):
    """Return the velocity straight to where a pedestrian walks [m/s]."""
    dx = state.mover_target[i, k, 0] - state.mover_position[i, k, 0]
    dy = state.mover_target[i, k, 1] - state.mover_position[i, k, 1]
    scale = speed / max(np.sqrt(dx * dx + dy * dy), 1e-9)
    return dx * scale, dy * scale


@compiled(inline=False, allocates=True)
def walk(state, i, base, worlds, crowd):
    """Choose the velocities of all pedestrians at once, from where everyone is now."""
    count = state.mover_count[i]
    bodies = np.empty((count, 9))
    planes = np.empty((count + 1, 2 * count + MAX_WALLS, 3))
    used = np.empty((count, 2), dtype=np.int64)
    walk_with(state, i, base, worlds, crowd, bodies, planes, used)


@compiled(inline=False, allocates=False)
def walk_with(state, i, base, worlds, crowd, bodies, planes, used):
    """Choose the velocities; the last three arguments are tables to work with.

    Passing the whole state on to a function that is not inlined would cost more than the function.
    """
    m, count = worlds.mover_begin[state.world[i]], state.mover_count[i]
    walking = False
    for k in range(count):
        bodies[k, X], bodies[k, Y] = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
        bodies[k, VX], bodies[k, VY] = state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1]
        bodies[k, RADIUS], bodies[k, WALKS] = state.mover_radius[i, k], 0.0
        if worlds.mover_kind[m + k] == PEDESTRIAN:
            walking = True
            look_ahead(state, i, k, worlds, crowd, bodies)
            look_around(state, i, k, base, worlds, crowd, bodies, planes, used)
    if not walking:
        return
    meet_others(bodies, crowd, planes, used)
    for k in range(count):
        if bodies[k, WALKS] > 0.0:
            vx, vy = at_most(bodies[k, WANT_X], bodies[k, WANT_Y], bodies[k, FAST])
            vx, vy = choose_velocity(planes, k, used[k, 0], used[k, 1], vx, vy, bodies[k, FAST])
            state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy


@compiled(allocates=False)
def look_ahead(state, i, k, worlds, crowd, bodies):
    """Write the velocity that a pedestrian would have if it were alone."""
    speed = worlds.mover_speed[worlds.mover_begin[state.world[i]] + k]
    state.mover_clock[i, k] -= crowd.dt
    dx = state.mover_target[i, k, 0] - bodies[k, X]
    dy = state.mover_target[i, k, 1] - bodies[k, Y]
    if dx * dx + dy * dy < ARRIVED * ARRIVED or state.mover_clock[i, k] < 0.0:
        begin_leg(state, i, k, worlds)
    vx, vy = wanted_velocity(state, i, k, speed)
    if crowd.model != ORCA:
        # Forces change the velocity that it has.
        part = crowd.dt / RELAXATION
        vx = bodies[k, VX] + part * (vx - bodies[k, VX])
        vy = bodies[k, VY] + part * (vy - bodies[k, VY])
    bodies[k, WANT_X], bodies[k, WANT_Y] = vx, vy
    bodies[k, FAST], bodies[k, WALKS] = HASTE * speed, 1.0


@compiled(allocates=False)
def push(bodies, k, ax, ay, dt):
    """Let a pedestrian feel an acceleration [m/s^2] for a control step."""
    bodies[k, WANT_X] += dt * ax
    bodies[k, WANT_Y] += dt * ay


@compiled(allocates=False)
def look_around(state, i, k, base, worlds, crowd, bodies, planes, used):
    """Take account of what stands around a pedestrian, and of the robot."""
    x, y, fast = bodies[k, X], bodies[k, Y], bodies[k, FAST]
    reach = bodies[k, RADIUS] + fast * WALL_HORIZON
    walls = find_walls(x, y, bodies[k, RADIUS], reach, worlds, state.world[i], planes, k)
    for j in range(walls):
        if crowd.model != ORCA:
            away = wall_repulsion(planes[k, j, 2])
            push(bodies, k, away * planes[k, j, 0], away * planes[k, j, 1], crowd.dt)
        planes[k, j, 2] = min(-planes[k, j, 2] / WALL_HORIZON, PARTING * fast)
    used[k, 0], used[k, 1] = walls, walls
    px, py = state.pose[i, 0] - x, state.pose[i, 1] - y
    if crowd.avoid_robot and px * px + py * py < NEIGHBOURS * NEIGHBOURS:
        vx = bodies[k, VX] - state.twist[i, 0] * state.heading[i, 0]
        vy = bodies[k, VY] - state.twist[i, 0] * state.heading[i, 1]
        reach = bodies[k, RADIUS] + base.radius
        if crowd.model == ORCA:
            nx, ny, short = avoidance(px, py, vx, vy, reach, crowd.dt)
            add_plane(bodies, planes, used, k, nx, ny, short)
        else:
            ax, ay = repulsion(px, py, vx, vy, reach)
            push(bodies, k, ax, ay, crowd.dt)


@compiled(allocates=False)
def meet_others(bodies, crowd, planes, used):
    """Take account of every two movers that are near each other."""
    for k in range(bodies.shape[0]):
        for j in range(k):
            px, py = bodies[j, X] - bodies[k, X], bodies[j, Y] - bodies[k, Y]
            squared = px * px + py * py
            walkers = bodies[j, WALKS] + bodies[k, WALKS]
            if squared >= NEIGHBOURS * NEIGHBOURS or walkers == 0.0:
                continue
            vx, vy = bodies[k, VX] - bodies[j, VX], bodies[k, VY] - bodies[j, VY]
            reach = bodies[j, RADIUS] + bodies[k, RADIUS]
            if walkers == 2.0:
                close = reach + 2.0 * crowd.dt * max(bodies[j, FAST], bodies[k, FAST])
                if squared < close * close:
                    keep_apart(bodies, planes, used, j, px, py, reach, crowd.dt)
                    keep_apart(bodies, planes, used, k, -px, -py, reach, crowd.dt)
            if crowd.model == ORCA:
                nx, ny, short = avoidance(px, py, vx, vy, reach, crowd.dt)
                # Two pedestrians share what they have to change; others change nothing.
                short /= walkers
                if bodies[k, WALKS] > 0.0:
                    add_plane(bodies, planes, used, k, nx, ny, short)
                if bodies[j, WALKS] > 0.0:
                    add_plane(bodies, planes, used, j, -nx, -ny, short)
            else:
                ax, ay = repulsion(px, py, vx, vy, reach)
                push(bodies, k, ax, ay, crowd.dt)
                push(bodies, j, -ax, -ay, crowd.dt)


@compiled(allocates=False)
def keep_apart(bodies, planes, used, k, px, py, reach, dt):
    """Let pedestrian k close half of the gap to another in this step, and no more.

    (px, py) leads from the other to it [m]. Two that overlap part at their preferred speed at most.
    """
    distance = max(np.sqrt(px * px + py * py), 1e-9)
    row, last = used[k, 0], used[k, 1]
    for c in range(3):
        planes[k, last, c] = planes[k, row, c]
    planes[k, row, 0], planes[k, row, 1] = px / distance, py / distance
    planes[k, row, 2] = min((reach - distance) / (2.0 * dt), PARTING * bodies[k, FAST])
    used[k, 0], used[k, 1] = row + 1, last + 1


@compiled(allocates=False)
def add_plane(bodies, planes, used, k, nx, ny, short):
    """Add the half-plane whose border lies ``short`` [m/s] along (nx, ny) from k's velocity.

    One that no velocity of pedestrian k can violate is left out.
    """
    least = nx * bodies[k, VX] + ny * bodies[k, VY] + short
    if least > -bodies[k, FAST]:
        row = used[k, 1]
        planes[k, row, 0], planes[k, row, 1], planes[k, row, 2] = nx, ny, least
        used[k, 1] = row + 1


@compiled(allocates=False)
def at_most(vx, vy, speed_max):
    """Return a velocity, shortened to a speed if it is faster [m/s]."""
    squared = vx * vx + vy * vy
    if squared <= speed_max * speed_max:
        return vx, vy
    scale = speed_max / np.sqrt(squared)
    return vx * scale, vy * scale
