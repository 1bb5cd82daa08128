# SPDX-License-Identifier: Apache-2.0
"""The same functions on a GPU: one thread an environment, or some beams of one.

Nothing is computed here. A step is three kernels, since the scan has more threads than the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda as numba_cuda

from pm01_nav.sim.kernels import (
    advance,
    begin_episode,
    locate,
    look,
    observe_wrongly,
    place_anew,
    read,
)
from pm01_nav.sim.lidar import reading
from pm01_nav.sim.pedestrians import Tables
from pm01_nav.sim.state import LidarParams

cuda: Any = numba_cuda
"""numba describes ``cuda.grid`` to type checkers as it never is."""


def move_all(state, errors, drawn, command, came_from, base, worlds, time, crowd, tables):
    """Apply commands (num_envs, axes) [m/s, rad/s]; see ``kernels.step_batch``.

    Each thread has a row of ``tables`` and, of many robots among movers, several. ``came_from``
    (num_envs, 3) keeps the last poses of robots with errors.
    """
    thread, threads = cuda.grid(1), cuda.gridsize(1)
    own = tables_of(tables, thread)
    for i in range(thread, state.pose.shape[0], threads):
        if len(errors) > 0:
            keep_pose(state, i, came_from)
        advance(state, errors, drawn, i, command, base, worlds, time, crowd, own)
        if len(errors) == 0:
            locate(state, i, base, worlds)


def look_some(state, indices, lidar, worlds, ranges, width):
    """Write the exact ranges of the environments ``indices`` (n,), ``width`` beams a thread.

    A negative index stands for no environment.
    """
    parts = (ranges.shape[1] + width - 1) // width
    thread = cuda.grid(1)
    row, part = thread // parts, thread % parts
    if row < indices.shape[0] and indices[row] >= 0:
        begin = part * width
        end = min(begin + width, ranges.shape[1])
        look(state, indices[row], part_of(lidar, begin, end), worlds, ranges[:, begin:end])


def read_some(state, indices, lidar, trail):
    """Make of exact ranges what the environments ``indices`` (n,) measure and remember."""
    row = cuda.grid(1)
    if row < indices.shape[0] and indices[row] >= 0:
        read(state, indices[row], lidar, trail)


def reset_some(
    state,
    errors,
    drawn,
    ranges,
    indices,
    came_from,
    base,
    worlds,
    goal_distance,
    scratch,
    crowd,
):
    """Start new episodes in the environments ``indices`` (n,); see ``kernels.reset_some``."""
    row = cuda.grid(1)
    if row < indices.shape[0] and indices[row] >= 0:
        i = indices[row]
        place_anew(state, errors, drawn, ranges, i, base, worlds, goal_distance, crowd)
        begin_at_rest(state, errors, drawn, i, came_from, base, worlds, scratch)


def begin_some(state, errors, drawn, indices, came_from, base, worlds, scratch):
    """Begin episodes at poses that were set from outside; see ``kernels.observe_some``."""
    row = cuda.grid(1)
    if row < indices.shape[0] and indices[row] >= 0:
        begin_at_rest(state, errors, drawn, indices[row], came_from, base, worlds, scratch)


def observe_some_wrongly(
    state, errors, drawn, indices, came_from, base, lidar, worlds, trail, first
):
    """Measure what the sensors of robots with errors say; see ``kernels.observe_wrongly``."""
    row = cuda.grid(1)
    if row < indices.shape[0] and indices[row] >= 0:
        i = indices[row]
        x, y, yaw = came_from[i, 0], came_from[i, 1], came_from[i, 2]
        observe_wrongly(state, errors, drawn, i, x, y, yaw, base, lidar, worlds, trail, first)


def read_scans(ranges, scan, range_min, range_max):
    """Write into ``scan`` what the lidars read, a thread a beam; see ``lidar.read_scans``."""
    thread = cuda.grid(1)
    i, k = thread // scan.shape[1], thread % scan.shape[1]
    if i < scan.shape[0]:
        scan[i, k] = reading(ranges[i, k], np.float32(range_min), np.float32(range_max))


@cuda.jit(device=True)
def begin_at_rest(state, errors, drawn, i, came_from, base, worlds, scratch):
    """Begin an episode at the present pose; robots with errors look around later."""
    begin_episode(state, errors, drawn, i, worlds, scratch)
    if len(errors) == 0:
        locate(state, i, base, worlds)
    else:
        keep_pose(state, i, came_from)


@cuda.jit(device=True)
def keep_pose(state, i, came_from):
    """Note where a robot is before it moves."""
    for axis in range(3):
        came_from[i, axis] = state.pose[i, axis]


@cuda.jit(device=True)
def part_of(lidar, begin, end):
    """Return the lidar that has the beams [begin, end) only."""
    return LidarParams(
        lidar.cos[begin:end],
        lidar.sin[begin:end],
        min(end, lidar.num_beams) - begin,
        lidar.angle_min + begin / lidar.beams_per_radian,
        lidar.beams_per_radian,
        lidar.range_min,
        lidar.range_max,
        lidar.x,
        lidar.y,
        lidar.mount_cos,
        lidar.mount_sin,
        lidar.noise_std,
        lidar.normal_values,
    )


@cuda.jit(device=True)
def tables_of(tables, thread):
    """Return one thread's room from tables that have a row for each."""
    if len(tables) == 0:
        return tables
    return Tables(
        tables.bodies[thread],
        tables.planes[thread],
        tables.used[thread],
        tables.pairs[thread],
        tables.px[thread],
        tables.py[thread],
        tables.vx[thread],
        tables.vy[thread],
        tables.reach[thread],
    )
