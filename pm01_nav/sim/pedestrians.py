# SPDX-License-Identifier: Apache-2.0
"""Pedestrians: where they want to go, and how they avoid what is in the way.

Whichever model they follow, they are solid: nobody walks into what stands still, and of the gap
between two each closes half a step at most (buffered Voronoi cells, Zhou et al., RA-L 2, 2017).
Standing still is always allowed, so that neither is ever given up for the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.sim.drive_motion import read_twist
from pm01_nav.sim.orca import avoidance, choose_velocity
from pm01_nav.sim.random import draw_row, uniform
from pm01_nav.sim.social_force import RELAXATION, repulsion, wall_repulsion
from pm01_nav.sim.state import ORCA
from pm01_nav.sim.surroundings import MAX_WALLS, find_walls
from pm01_nav.worlds.mover_arrays import PEDESTRIAN

FloatArray = NDArray[np.float64]
HASTE = 1.3
"""The greatest speed over the preferred one (Helbing and Molnar 1995)."""
ARRIVED = 0.3
"""A pedestrian this near to where it walks goes on to the next place [m]."""
PATIENCE, PATIENCE_FACTOR = 5.0, 2.0
"""It gives a place up after so long [s] and so many times what the straight way takes."""
NEIGHBOURS = 3.0
"""Whom a pedestrian looks at: who comes nearer within this distance of centres [m] ..."""
ARRIVAL = 4.0
"""... fast enough to be there within this time [s], twice the horizon of ORCA, ..."""
BYSTANDERS = 1.5
"""... and everyone within this distance [m]."""
PARTING = 1.0 / HASTE
"""What overlaps parts at the preferred speed at most, this part of the greatest."""
COURTESY = 0.1
"""What a pedestrian leaves free between itself and a robot that it avoids [m]."""
WALL_HORIZON = 0.5
"""In this time a pedestrian closes a gap to what stands still at most [s]."""
X, Y, VX, VY, RADIUS, FAST, WANT_X, WANT_Y, WALKS = range(9)
"""Rows of a table of movers: place, velocity, radius, greatest speed, wanted velocity, and 1 for
a pedestrian, 0 for others."""


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


class Tables(NamedTuple):
    """Room to work out the velocities of one environment's pedestrians."""

    bodies: FloatArray
    """See the names of its rows, shape (9, most movers)."""
    planes: FloatArray
    """Half-planes of permitted velocities of each mover, and a row to spare; see ``orca``."""
    used: NDArray[np.int64]
    """How many of a mover's half-planes are never given up, and how many there are."""
    pairs: NDArray[np.int64]
    """Two neighbours j < k, shape (pairs of movers and one to spare, 2)."""
    px: FloatArray
    """From k to j [m]; then what they do to each other, along with ``py`` and ``vx``."""
    py: FloatArray
    vx: FloatArray
    """Velocity of k less that of j [m/s]."""
    vy: FloatArray
    reach: FloatArray
    """Sum of both radii [m]."""


@compiled(allocates=True)
def new_tables(most):
    """Return tables for up to ``most`` movers."""
    num_pairs = most * (most - 1) // 2 + 1
    numbers = np.empty((5, num_pairs))
    counts = np.empty((most + num_pairs, 2), dtype=np.int64)
    return Tables(
        np.empty((9, most)),
        np.empty((most + 1, 2 * most + MAX_WALLS + 1, 3)),
        counts[:most],
        counts[most:],
        numbers[0],
        numbers[1],
        numbers[2],
        numbers[3],
        numbers[4],
    )


@compiled
def walk(state, i, base, worlds, crowd, tables):
    """Choose the velocities of all pedestrians at once, from where everyone is now."""
    bodies, planes, used = tables.bodies, tables.planes, tables.used
    m, count = worlds.mover_begin[state.world[i]], state.mover_count[i]
    walking = False
    for k in range(count):
        bodies[X, k], bodies[Y, k] = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
        bodies[VX, k], bodies[VY, k] = state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1]
        bodies[RADIUS, k], bodies[WALKS, k] = state.mover_radius[i, k], 0.0
        bodies[FAST, k], used[k, 0], used[k, 1] = 0.0, 0, 0
        if worlds.mover_kind[m + k] == PEDESTRIAN:
            walking = True
            look_ahead(state, i, k, worlds, crowd, bodies)
            look_around(state, i, k, base, worlds, crowd, bodies, planes, used)
    if not walking:
        return
    meet_others(count, crowd, tables)
    for k in range(count):
        if bodies[WALKS, k] > 0.0:
            vx, vy = at_most(bodies[WANT_X, k], bodies[WANT_Y, k], bodies[FAST, k])
            vx, vy = choose_velocity(planes, k, used[k, 0], used[k, 1], vx, vy, bodies[FAST, k])
            state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy


@compiled
def look_ahead(state, i, k, worlds, crowd, bodies):
    """Write the velocity that a pedestrian would have if it were alone."""
    speed = worlds.mover_speed[worlds.mover_begin[state.world[i]] + k]
    state.mover_clock[i, k] -= crowd.dt
    dx = state.mover_target[i, k, 0] - bodies[X, k]
    dy = state.mover_target[i, k, 1] - bodies[Y, k]
    if dx * dx + dy * dy < ARRIVED * ARRIVED or state.mover_clock[i, k] < 0.0:
        begin_leg(state, i, k, worlds)
    vx, vy = wanted_velocity(state, i, k, speed)
    if crowd.model != ORCA:
        # Forces change the velocity that it has.
        part = crowd.dt / RELAXATION
        vx = bodies[VX, k] + part * (vx - bodies[VX, k])
        vy = bodies[VY, k] + part * (vy - bodies[VY, k])
    bodies[WANT_X, k], bodies[WANT_Y, k] = vx, vy
    bodies[FAST, k], bodies[WALKS, k] = HASTE * speed, 1.0


@compiled
def push(bodies, k, ax, ay, dt):
    """Let a pedestrian feel an acceleration [m/s^2] for a control step."""
    bodies[WANT_X, k] += dt * ax
    bodies[WANT_Y, k] += dt * ay


@compiled
def look_around(state, i, k, base, worlds, crowd, bodies, planes, used):
    """Take account of what stands around a pedestrian, and of the robot."""
    x, y, fast = bodies[X, k], bodies[Y, k], bodies[FAST, k]
    reach = bodies[RADIUS, k] + fast * WALL_HORIZON
    walls = find_walls(x, y, bodies[RADIUS, k], reach, worlds, state.world[i], planes, k)
    for j in range(walls):
        if crowd.model != ORCA:
            away = wall_repulsion(planes[k, j, 2])
            push(bodies, k, away * planes[k, j, 0], away * planes[k, j, 1], crowd.dt)
        planes[k, j, 2] = min(-planes[k, j, 2] / WALL_HORIZON, PARTING * fast)
    used[k, 0], used[k, 1] = walls, walls
    px, py = state.pose[i, 0] - x, state.pose[i, 1] - y
    if crowd.avoid_robot and px * px + py * py < NEIGHBOURS * NEIGHBOURS:
        v, u, _ = read_twist(state.twist, i)
        cos, sin = state.heading[i, 0], state.heading[i, 1]
        vx, vy = bodies[VX, k] - (v * cos - u * sin), bodies[VY, k] - (v * sin + u * cos)
        reach = bodies[RADIUS, k] + base.radius + COURTESY
        close = reach + 2.0 * crowd.dt * fast
        if px * px + py * py < close * close:
            keep_apart(bodies, planes, used, k, -px, -py, reach, 0.0, crowd.dt)
        if crowd.model == ORCA:
            nx, ny, short = avoidance(px, py, vx, vy, reach, crowd.dt)
            add_plane(bodies, planes, used, k, nx, ny, short)
        else:
            ax, ay = repulsion(px, py, vx, vy, reach)
            push(bodies, k, ax, ay, crowd.dt)


@compiled
def meet_others(num_movers, crowd, tables):
    """Take account of every two movers that are near each other.

    In rounds, so that the ones with the arithmetic handle several pairs at a time.
    """
    bodies, planes, used, pairs = tables.bodies, tables.planes, tables.used, tables.pairs
    px, py, vx, vy, reach = tables.px, tables.py, tables.vx, tables.vy, tables.reach
    count = find_pairs(num_movers, tables)
    for n in range(count):
        j, k = pairs[n, 0], pairs[n, 1]
        close = reach[n] + 2.0 * crowd.dt * max(bodies[FAST, j], bodies[FAST, k])
        squared = px[n] * px[n] + py[n] * py[n]
        if squared < close * close and bodies[WALKS, j] + bodies[WALKS, k] == 2.0:
            part_j, part_k = PARTING * bodies[FAST, j], PARTING * bodies[FAST, k]
            keep_apart(bodies, planes, used, j, px[n], py[n], reach[n], part_j, crowd.dt)
            keep_apart(bodies, planes, used, k, -px[n], -py[n], reach[n], part_k, crowd.dt)
    if crowd.model == ORCA:
        for n in range(np.uint64(count)):
            px[n], py[n], vx[n] = avoidance(px[n], py[n], vx[n], vy[n], reach[n], crowd.dt)
        for n in range(count):
            j, k = pairs[n, 0], pairs[n, 1]
            # Two pedestrians share what they have to change; others change nothing.
            short = vx[n] / (bodies[WALKS, j] + bodies[WALKS, k])
            add_plane(bodies, planes, used, k, px[n], py[n], short)
            add_plane(bodies, planes, used, j, -px[n], -py[n], short)
    else:
        for n in range(np.uint64(count)):
            px[n], py[n] = repulsion(px[n], py[n], vx[n], vy[n], reach[n])
        for n in range(count):
            push(bodies, pairs[n, 1], px[n], py[n], crowd.dt)
            push(bodies, pairs[n, 0], -px[n], -py[n], crowd.dt)


@compiled
def find_pairs(num_movers, tables):
    """Find the pairs of neighbours of which at least one walks; return how many.

    Those that do not come nearer matter at a short distance only. A pair is always written and
    only sometimes kept: a branch would be mispredicted too often.
    """
    bodies, pairs, excess = tables.bodies, tables.pairs, tables.reach
    count = 0
    for k in range(num_movers):
        for j in range(np.uint64(k)):
            dx, dy = bodies[X, j] - bodies[X, k], bodies[Y, j] - bodies[Y, k]
            vx, vy = bodies[VX, k] - bodies[VX, j], bodies[VY, k] - bodies[VY, j]
            coming = min(ARRIVAL * (dx * vx + dy * vy), NEIGHBOURS * NEIGHBOURS)
            far_squared = max(coming, BYSTANDERS * BYSTANDERS)
            walkers = bodies[WALKS, j] + bodies[WALKS, k]
            excess[j] = dx * dx + dy * dy - far_squared if walkers > 0.0 else 0.0
        for j in range(k):
            pairs[count, 0], pairs[count, 1] = j, k
            count += int(excess[j] < 0.0)
    for n in range(count):
        j, k = pairs[n, 0], pairs[n, 1]
        tables.px[n], tables.py[n] = bodies[X, j] - bodies[X, k], bodies[Y, j] - bodies[Y, k]
        tables.vx[n], tables.vy[n] = bodies[VX, k] - bodies[VX, j], bodies[VY, k] - bodies[VY, j]
        tables.reach[n] = bodies[RADIUS, j] + bodies[RADIUS, k]
    return count


@compiled
def keep_apart(bodies, planes, used, k, px, py, reach, parting, dt):
    """Let pedestrian k close half of the gap to another in this step, and no more.

    (px, py) leads from the other to it [m]. One that is nearer than ``reach`` moves away, though
    it need not be faster than ``parting`` [m/s].
    """
    distance = max(np.sqrt(px * px + py * py), 1e-9)
    row, last = used[k, 0], used[k, 1]
    for c in range(3):
        planes[k, last, c] = planes[k, row, c]
    planes[k, row, 0], planes[k, row, 1] = px / distance, py / distance
    planes[k, row, 2] = min((reach - distance) / (2.0 * dt), parting)
    used[k, 0], used[k, 1] = row + 1, last + 1


@compiled
def add_plane(bodies, planes, used, k, nx, ny, short):
    """Add the half-plane whose border lies ``short`` [m/s] along (nx, ny) from k's velocity.

    One that no velocity of pedestrian k can violate is left out.
    """
    least = nx * bodies[VX, k] + ny * bodies[VY, k] + short
    row = used[k, 1]
    planes[k, row, 0], planes[k, row, 1], planes[k, row, 2] = nx, ny, least
    used[k, 1] = row + int(least > -bodies[FAST, k])


@compiled
def at_most(vx, vy, speed_max):
    """Return a velocity, shortened to a speed if it is faster [m/s]."""
    squared = vx * vx + vy * vy
    if squared <= speed_max * speed_max:
        return vx, vy
    scale = speed_max / np.sqrt(squared)
    return vx * scale, vy * scale
