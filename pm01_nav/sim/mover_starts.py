# SPDX-License-Identifier: Apache-2.0
"""Where movers are when an episode begins, and a start for the robot out of their reach."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.movers import on_track
from pm01_nav.sim.pedestrians import begin_leg, draw_place, wanted_velocity
from pm01_nav.sim.random import draw_row, uniform
from pm01_nav.worlds.mover_arrays import PEDESTRIAN, TRACK

MOVER_DRAWS, START_DRAWS = 4, 16
"""Draws of the movers, and for each of a start out of their reach; then the best is taken."""
START_GAP = 0.2
"""Movers keep at least this free beside the robot when it starts [m]."""
START_TIME = 1.0
"""For so long none of them can reach a start [s]."""
PLACE_DRAWS = 64
"""Draws of another place for a pedestrian; then the one with most room is taken."""


@compiled
def draw_start(state, i, worlds):
    """Draw a start from those of the present world; return x, y [m]."""
    key, count, w = state.rng_key, state.rng_count, state.world[i]
    start = draw_row(worlds.start_begin, w, uniform(key, count, i))
    x = worlds.starts[start, 0] + worlds.jitter[w, 0] * (2.0 * uniform(key, count, i) - 1.0)
    y = worlds.starts[start, 1] + worlds.jitter[w, 0] * (2.0 * uniform(key, count, i) - 1.0)
    return x, y


@compiled(inline=False)
def place_start(state, i, base, worlds):
    """Start the movers and draw a place for the robot that they do not reach at once.

    Returns the place x, y [m]. Where every draw is within reach, pedestrians make way.
    """
    best, best_x, best_y = -np.inf, 0.0, 0.0
    chosen = state.rng_count[i]
    for _ in range(MOVER_DRAWS):
        before = state.rng_count[i]
        start_movers(state, i, worlds)
        for _ in range(START_DRAWS):
            x, y = draw_start(state, i, worlds)
            spare = spare_room(state, i, x, y, base.radius, worlds)
            if spare >= 0.0:
                return x, y
            if spare > best:
                best, best_x, best_y, chosen = spare, x, y, before
    # The movers of the best draw once more, by their place in the random stream.
    after = state.rng_count[i]
    state.rng_count[i] = chosen
    start_movers(state, i, worlds)
    state.rng_count[i] = after
    make_way(state, i, best_x, best_y, base.radius, worlds)
    return best_x, best_y


@compiled(inline=False)
def start_movers(state, i, worlds):
    """Put the movers of the present world where an episode finds them."""
    m = worlds.mover_begin[state.world[i]]
    state.mover_count[i] = worlds.mover_begin[state.world[i] + 1] - m
    for k in range(state.mover_count[i]):
        row = worlds.mover_point_begin[m + k]
        x, y = worlds.mover_points[row, 0], worlds.mover_points[row, 1]
        vx = worlds.mover_speed[m + k] * worlds.mover_direction[m + k, 0]
        vy = worlds.mover_speed[m + k] * worlds.mover_direction[m + k, 1]
        state.mover_radius[i, k] = worlds.mover_radius[m + k]
        state.mover_leg[i, k] = 0
        state.mover_clock[i, k] = 0.0
        state.mover_target[i, k, 0] = worlds.mover_direction[m + k, 0]
        state.mover_target[i, k, 1] = worlds.mover_direction[m + k, 1]
        if worlds.mover_kind[m + k] == TRACK:
            if worlds.mover_random_phase:
                # Uniform on the time of a round.
                number = uniform(state.rng_key, state.rng_count, i)
                state.mover_clock[i, k] = number * worlds.mover_period[m + k]
            x, y, vx, vy = on_track(worlds, m + k, state.mover_clock[i, k])
        state.mover_position[i, k, 0], state.mover_position[i, k, 1] = x, y
        if worlds.mover_kind[m + k] == PEDESTRIAN:
            begin_leg(state, i, k, worlds)
            vx, vy = wanted_velocity(state, i, k, worlds.mover_speed[m + k])
        state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy
    for k in range(state.mover_count[i], state.mover_velocity.shape[1]):
        state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = 0.0, 0.0


@compiled
def spare_room(state, i, x, y, radius, worlds):
    """Return how much further than needed the nearest mover is from a start [m]."""
    m = worlds.mover_begin[state.world[i]]
    spare = np.inf
    for k in range(state.mover_count[i]):
        need = START_GAP + START_TIME * worlds.mover_speed[m + k]
        spare = min(spare, gap_to(state, i, k, x, y, radius) - need)
    return spare


@compiled
def gap_to(state, i, k, x, y, radius):
    """Return the distance between mover k and a disc at (x, y) [m]."""
    dx, dy = state.mover_position[i, k, 0] - x, state.mover_position[i, k, 1] - y
    return np.sqrt(dx * dx + dy * dy) - state.mover_radius[i, k] - radius


@compiled(inline=False)
def make_way(state, i, x, y, radius, worlds):
    """Move the pedestrians that stand on the robot at (x, y) to other places with room."""
    m = worlds.mover_begin[state.world[i]]
    for k in range(state.mover_count[i]):
        walks = worlds.mover_kind[m + k] == PEDESTRIAN
        if not walks or gap_to(state, i, k, x, y, radius) >= START_GAP:
            continue
        best, best_x, best_y = -np.inf, 0.0, 0.0
        for _ in range(PLACE_DRAWS):
            here_x, here_y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
            place_x, place_y = draw_place(state, i, worlds, here_x, here_y)
            room = room_for(state, i, k, place_x, place_y, x, y, radius)
            if room > best:
                best, best_x, best_y = room, place_x, place_y
            if room >= 0.0:
                break
        state.mover_position[i, k, 0], state.mover_position[i, k, 1] = best_x, best_y
        state.mover_leg[i, k] = 0
        begin_leg(state, i, k, worlds)
        vx, vy = wanted_velocity(state, i, k, worlds.mover_speed[m + k])
        state.mover_velocity[i, k, 0], state.mover_velocity[i, k, 1] = vx, vy


@compiled
def room_for(state, i, k, place_x, place_y, x, y, radius):
    """Return the room that mover k has at a place, beside a robot at (x, y) and the others [m]."""
    r = state.mover_radius[i, k]
    robot_gap = np.sqrt((place_x - x) ** 2 + (place_y - y) ** 2) - r - radius
    room = robot_gap - START_GAP
    for j in range(state.mover_count[i]):
        if j != k:
            room = min(room, gap_to(state, i, j, place_x, place_y, r))
    return room
