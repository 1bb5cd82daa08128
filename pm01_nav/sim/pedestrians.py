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
WALL_HORIZON = 0.5
"""In this time a pedestrian closes a gap to what stands still at most [s]."""


@compiled
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


@compiled
def draw_place(state, i, worlds, x, y):
    """Draw a place in which pedestrians have room; without any, return (x, y)."""
    w = state.world[i]
    if worlds.mover_place_begin[w + 1] == worlds.mover_place_begin[w]:
        return x, y
    number = uniform(state.rng_key, state.rng_count, i)
    row = draw_row(worlds.mover_place_begin, w, number)
    return worlds.mover_places[row, 0], worlds.mover_places[row, 1]


@compiled
def wanted_velocity(state, i, k, speed):
    """Return the velocity straight to where a pedestrian walks [m/s]."""
    dx = state.mover_target[i, k, 0] - state.mover_position[i, k, 0]
    dy = state.mover_target[i, k, 1] - state.mover_position[i, k, 1]
    scale = speed / max(np.sqrt(dx * dx + dy * dy), 1e-9)
    return dx * scale, dy * scale


@compiled(inline=False)
def walk(state, i, base, worlds, crowd):
    """Choose the velocities of all pedestrians at once, from where everyone is now."""
    m, count = worlds.mover_begin[state.world[i]], state.mover_count[i]
    wanted = np.empty((count, 2))
    planes = np.empty((count + 1, 2 * count + MAX_WALLS, 3))
    used = np.zeros((count, 2), dtype=np.int64)
    walking = False
    for k in range(count):
        if worlds.mover_kind[m + k] == PEDESTRIAN:
            walking = True
            look_ahead(state, i, k, worlds, crowd, wanted[k])
            look_around(state, i, k, base, worlds, crowd, wanted[k], planes[k], used[k])
    if not walking:
        return
    meet_others(state, i, worlds, crowd, wanted, planes, used)
    for k in range(count):
        if worlds.mover_kind[m + k] == PEDESTRIAN:
            speed_max = HASTE * worlds.mover_speed[m + k]
            wanted_x, wanted_y = at_most(wanted[k, 0], wanted[k, 1], speed_max)
            vx, vy = choose_velocity(
                planes[k], used[k, 0], used[k, 1], wanted_x, wanted_y, speed_max, planes[count]
            )
            state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy


@compiled
def look_ahead(state, i, k, worlds, crowd, wanted):
    """Write the velocity that a pedestrian would have if it were alone."""
    m = worlds.mover_begin[state.world[i]] + k
    state.mover_clock[i, k] -= crowd.dt
    dx = state.mover_target[i, k, 0] - state.mover_position[i, k, 0]
    dy = state.mover_target[i, k, 1] - state.mover_position[i, k, 1]
    if dx * dx + dy * dy < ARRIVED * ARRIVED or state.mover_clock[i, k] < 0.0:
        begin_leg(state, i, k, worlds)
    vx, vy = wanted_velocity(state, i, k, worlds.mover_speed[m])
    if crowd.model != ORCA:
        # Forces change the velocity that it has.
        part = crowd.dt / RELAXATION
        vx = state.mover_velocity[i, k, 0] + part * (vx - state.mover_velocity[i, k, 0])
        vy = state.mover_velocity[i, k, 1] + part * (vy - state.mover_velocity[i, k, 1])
    wanted[0], wanted[1] = vx, vy


@compiled
def look_around(state, i, k, base, worlds, crowd, wanted, planes, used):
    """Take account of what stands around a pedestrian, and of the robot."""
    speed = worlds.mover_speed[worlds.mover_begin[state.world[i]] + k]
    used[:] = find_walls(state, i, k, HASTE * speed * WALL_HORIZON, worlds, planes)
    for j in range(used[0]):
        if crowd.model != ORCA:
            push = crowd.dt * wall_repulsion(planes[j, 2])
            wanted[0], wanted[1] = wanted[0] + push * planes[j, 0], wanted[1] + push * planes[j, 1]
        planes[j, 2] = min(-planes[j, 2] / WALL_HORIZON, speed)
    if not crowd.avoid_robot:
        return
    px = state.pose[i, 0] - state.mover_position[i, k, 0]
    py = state.pose[i, 1] - state.mover_position[i, k, 1]
    if px * px + py * py < NEIGHBOURS * NEIGHBOURS:
        vx = state.mover_velocity[i, k, 0] - state.twist[i, 0] * state.heading[i, 0]
        vy = state.mover_velocity[i, k, 1] - state.twist[i, 0] * state.heading[i, 1]
        reach = state.mover_radius[i, k] + base.radius
        if crowd.model == ORCA:
            nx, ny, short = avoidance(px, py, vx, vy, reach, crowd.dt)
            add_plane(planes, used, nx, ny, state.mover_velocity[i, k], short, HASTE * speed)
        else:
            ax, ay = repulsion(px, py, vx, vy, reach)
            wanted[0], wanted[1] = wanted[0] + crowd.dt * ax, wanted[1] + crowd.dt * ay


@compiled(inline=False)
def meet_others(state, i, worlds, crowd, wanted, planes, used):
    """Take account of every two movers that are near each other."""
    position, velocity = state.mover_position[i], state.mover_velocity[i]
    kinds = worlds.mover_kind[worlds.mover_begin[state.world[i]] :]
    speeds = worlds.mover_speed[worlds.mover_begin[state.world[i]] :]
    for k in range(state.mover_count[i]):
        for j in range(k):
            px, py = position[j, 0] - position[k, 0], position[j, 1] - position[k, 1]
            squared = px * px + py * py
            if squared >= NEIGHBOURS * NEIGHBOURS:
                continue
            j_walks, k_walks = kinds[j] == PEDESTRIAN, kinds[k] == PEDESTRIAN
            vx, vy = velocity[k, 0] - velocity[j, 0], velocity[k, 1] - velocity[j, 1]
            reach = state.mover_radius[i, j] + state.mover_radius[i, k]
            if j_walks and k_walks:
                close = reach + 2.0 * HASTE * max(speeds[j], speeds[k]) * crowd.dt
                if squared < close * close:
                    keep_apart(px, py, reach, speeds[j], crowd.dt, planes[j], used[j], 1.0)
                    keep_apart(px, py, reach, speeds[k], crowd.dt, planes[k], used[k], -1.0)
            if crowd.model == ORCA:
                # Two pedestrians share what they have to change, others change nothing.
                part = 0.5 if j_walks and k_walks else 1.0
                nx, ny, short = avoidance(px, py, vx, vy, reach, crowd.dt)
                if k_walks:
                    fast = HASTE * speeds[k]
                    add_plane(planes[k], used[k], nx, ny, velocity[k], part * short, fast)
                if j_walks:
                    fast = HASTE * speeds[j]
                    add_plane(planes[j], used[j], -nx, -ny, velocity[j], part * short, fast)
            else:
                ax, ay = repulsion(px, py, vx, vy, reach)
                wanted[k, 0], wanted[k, 1] = (
                    wanted[k, 0] + crowd.dt * ax,
                    wanted[k, 1] + crowd.dt * ay,
                )
                wanted[j, 0], wanted[j, 1] = (
                    wanted[j, 0] - crowd.dt * ax,
                    wanted[j, 1] - crowd.dt * ay,
                )


@compiled
def keep_apart(px, py, reach, speed, dt, planes, used, side):
    """Let a pedestrian close half of the gap to another in this step, and no more.

    The other is in the direction ``-side`` x (px, py). What overlaps parts at the preferred speed
    at most.
    """
    distance = max(np.sqrt(px * px + py * py), 1e-9)
    planes[used[1]] = planes[used[0]]
    row = used[0]
    planes[row, 0], planes[row, 1] = side * px / distance, side * py / distance
    planes[row, 2] = min((reach - distance) / (2.0 * dt), speed)
    used[0] += 1
    used[1] += 1


@compiled
def add_plane(planes, used, nx, ny, velocity, short, speed_max):
    """Add the half-plane whose border lies ``short`` [m/s] along (nx, ny) from a velocity.

    One that no velocity up to ``speed_max`` can violate is left out.
    """
    least = nx * velocity[0] + ny * velocity[1] + short
    if least > -speed_max:
        planes[used[1], 0], planes[used[1], 1], planes[used[1], 2] = nx, ny, least
        used[1] += 1


@compiled
def at_most(vx, vy, speed_max):
    """Return a velocity, shortened to a speed if it is faster [m/s]."""
    squared = vx * vx + vy * vy
    if squared <= speed_max * speed_max:
        return vx, vy
    scale = speed_max / np.sqrt(squared)
    return vx * scale, vy * scale
