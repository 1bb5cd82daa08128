# SPDX-License-Identifier: Apache-2.0
"""Scans of a lidar that turns while the robot drives: each part is cast from a place of its own.

An obstacle is first looked for from the middle of the sweep, in an angle so wide that it covers
what any part may see of it; then it is cast exactly, part by part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import segment, to_base
from pm01_nav.sim.dynamics import arc, wrap
from pm01_nav.sim.lidar import (
    FEW_BEAMS,
    cast_disc_beams,
    cast_segment_beams,
    covered,
    direction,
    edge_on,
    ray_to_grid,
    whole_blocks,
)
from pm01_nav.sim.lidar_errors import SEGMENT_NUMBERS, absorb, is_dark, patch_number
from pm01_nav.sim.perturbation import SLICES
from pm01_nav.sim.views import listed, view_cell
from pm01_nav.worlds.views import MARGIN

INSIDE = 1e-6
"""So far behind its first point a cell that was hit is looked up [m]."""


class Sweep(NamedTuple):
    """How a scan is cut into parts."""

    poses: NDArray[np.float64]
    """x, y, cos, sin of the lidar in the world, shape (num_envs, SLICES, 4)."""
    beams: int
    """Beams in each part but the last, whole blocks."""
    middle: int
    """The part from which obstacles are looked for."""
    travel: float
    """No part is cast from further away from the middle one [m]."""
    turn: float
    """No part is turned further from the middle one [rad]."""


@compiled
def sweep_scan(state, errors, drawn, i, x, y, yaw, lidar, worlds):
    """Write the exact ranges of environment i, which came from the pose (x, y, yaw) in this step.

    Infinity where nothing is hit within range_max, or a dark obstacle swallows the beam.
    """
    w, ranges, dark_ranges = state.world[i], state.ranges, errors.dark_ranges
    sweep = place_slices(state, errors, drawn, i, x, y, yaw, lidar)
    for k in range(ranges.shape[1]):
        ranges[i, k], dark_ranges[i, k] = np.inf, np.inf
    cell = sweep_cell(sweep, i, lidar, worlds, w)
    first, last = listed(worlds.seen_disc_begin, cell)
    for n in range(first, last):
        k = np.uint64(worlds.seen_discs[n])
        target = dark_ranges if is_dark(errors, drawn, i, k) else ranges
        sweep_disc(
            worlds.discs[k, 0], worlds.discs[k, 1], worlds.discs[k, 2], sweep, lidar, target, i
        )
    first, last = listed(worlds.seen_segment_begin, cell)
    for n in range(first, last):
        k = np.uint64(worlds.seen_segments[n])
        target = (
            dark_ranges if is_dark(errors, drawn, i, np.uint64(SEGMENT_NUMBERS) + k) else ranges
        )
        x1, y1, x2, y2 = segment(worlds, k)
        sweep_segment(x1, y1, x2, y2, sweep, lidar, target, i)
    for k in range(state.mover_count[i]):  # Where they are at the end of the step.
        x, y = state.mover_position[i, k, 0], state.mover_position[i, k, 1]
        sweep_disc(x, y, state.mover_radius[i, k], sweep, lidar, ranges, i)
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        sweep_grid(errors, drawn, i, sweep, lidar, worlds, w, ranges)
    if drawn.dark_share[i] > 0.0:
        absorb(errors, drawn, ranges, i)


@compiled
def sweep_cell(sweep, i, lidar, worlds, w):
    """Return the cell that lists all that is seen from the places of a sweep."""
    x, y = sweep.poses[i, sweep.middle, 0], sweep.poses[i, sweep.middle, 1]
    reach = lidar.range_max if sweep.travel <= MARGIN else np.inf
    return view_cell(x, y, reach, worlds, w)


@compiled
def place_slices(state, errors, drawn, i, x, y, yaw, lidar):
    """Find where each part of the scan is taken: on the arc of this step's motion.

    The last ``scan_sweep`` control steps go by while the beams turn, and a part is taken in the
    middle of its time. What lies before this step is reckoned back along its arc.
    """
    share, num_beams = drawn.scan_sweep[i], lidar.num_beams
    slices = SLICES if share > 0.0 else 1
    beams = whole_blocks((num_beams + slices - 1) // slices)
    slices = (num_beams + beams - 1) // beams
    turn = wrap(state.pose[i, 2] - yaw)
    middle = yaw + 0.5 * turn
    dx, dy = state.pose[i, 0] - x, state.pose[i, 1] - y
    ahead, left = to_base(dx, dy, np.cos(middle), np.sin(middle))
    if abs(turn) >= 1e-6:
        ahead = ahead * 0.5 * turn / np.sin(0.5 * turn)
        left = left * 0.5 * turn / np.sin(0.5 * turn)
    if state.twist.shape[1] < 3:  # What is left is rounding.
        left = 0.0
    x, y = state.pose[i, 0], state.pose[i, 1]
    cos, sin = state.heading[i, 0], state.heading[i, 1]
    for s in range(slices):
        ago = share * (1.0 - middle_of(s, beams, num_beams))
        px, py, c, n = arc(x, y, cos, sin, ahead, left, turn, -ago)
        errors.slice_pose[i, s, 0] = px + c * lidar.x - n * lidar.y
        errors.slice_pose[i, s, 1] = py + n * lidar.x + c * lidar.y
        errors.slice_pose[i, s, 2] = c * lidar.mount_cos - n * lidar.mount_sin
        errors.slice_pose[i, s, 3] = n * lidar.mount_cos + c * lidar.mount_sin
    reference = middle_of(slices // 2, beams, num_beams)
    early = reference - middle_of(0, beams, num_beams)
    late = middle_of(slices - 1, beams, num_beams) - reference
    turn = share * max(early, late) * abs(turn)
    arm = np.sqrt(lidar.x * lidar.x + lidar.y * lidar.y)
    travel = share * max(early, late) * (abs(ahead) + abs(left)) + turn * arm
    return Sweep(errors.slice_pose, beams, slices // 2, travel, turn)


@compiled
def middle_of(s, beams, num_beams):
    """Return when in the sweep the middle of part s is measured, from 0 to 1."""
    return 0.5 * (s * beams + min((s + 1) * beams, num_beams)) / num_beams


@compiled
def from_slice(x, y, poses, i, s):
    """Express a point of the world in the lidar's frame in part s of the scan [m]."""
    return to_base(x - poses[i, s, 0], y - poses[i, s, 1], poses[i, s, 2], poses[i, s, 3])


@compiled
def half_angle(radius, distance):
    """Return at least the half angle under which a disc is seen: asin(radius / distance)."""
    sine = radius / distance
    return sine + (0.5 * np.pi - 1.0) * sine * sine * sine


@compiled
def sweep_disc(x, y, r, sweep, lidar, ranges, i):
    """Shorten the beams that meet a disc at (x, y) in the world."""
    ahead, left = from_slice(x, y, sweep.poses, i, sweep.middle)
    squared = ahead * ahead + left * left
    # Seen from within ``travel`` the disc covers no more than one that is so much larger.
    wide = r + sweep.travel
    reach = lidar.range_max + wide
    if squared > reach * reach:
        return
    if squared <= wide * wide or lidar.num_beams <= FEW_BEAMS:
        sweep_disc_beams(x, y, r, sweep, lidar, ranges, i, 0, ranges.shape[1])
        return
    half = half_angle(wide, np.sqrt(squared)) + sweep.turn
    first, last, wrapped = covered(direction(ahead, left) - half, 2.0 * half, lidar)
    sweep_disc_beams(x, y, r, sweep, lidar, ranges, i, first, last)
    sweep_disc_beams(x, y, r, sweep, lidar, ranges, i, 0, wrapped)


@compiled
def sweep_disc_beams(x, y, r, sweep, lidar, ranges, i, begin, end):
    """Test a disc against the beams [begin, end), each part from its own place."""
    for s in range(begin // sweep.beams, (end + sweep.beams - 1) // sweep.beams):
        ahead, left = from_slice(x, y, sweep.poses, i, s)
        first, last = max(begin, s * sweep.beams), min(end, (s + 1) * sweep.beams)
        if ahead * ahead + left * left <= r * r:
            for k in range(first, last):
                ranges[i, k] = 0.0
        else:
            cast_disc_beams(ahead, left, r, lidar, ranges, i, first, last)


@compiled
def sweep_segment(x1, y1, x2, y2, sweep, lidar, ranges, i):
    """Shorten the beams that meet a segment between two points of the world."""
    a1, l1 = from_slice(x1, y1, sweep.poses, i, sweep.middle)
    a2, l2 = from_slice(x2, y2, sweep.poses, i, sweep.middle)
    ex, ey = a2 - a1, l2 - l1
    along = min(max(-(a1 * ex + l1 * ey) / max(ex * ex + ey * ey, 1e-18), 0.0), 1.0)
    near_x, near_y = a1 + along * ex, l1 + along * ey
    squared = near_x * near_x + near_y * near_y
    reach = lidar.range_max + sweep.travel
    if squared > reach * reach:
        return
    if squared <= sweep.travel * sweep.travel or lidar.num_beams <= FEW_BEAMS:
        sweep_segment_beams(x1, y1, x2, y2, sweep, lidar, ranges, i, 0, ranges.shape[1])
        return
    cross = a1 * ey - l1 * ex
    if cross < 0.0:  # From here on the first end is the right one.
        a1, l1, a2, l2, cross = a2, l2, a1, l1, -cross
    # Seen from within ``travel`` each end stays within a disc of that radius around it.
    nearer = np.sqrt(min(a1 * a1 + l1 * l1, a2 * a2 + l2 * l2))
    margin = half_angle(min(sweep.travel / nearer, 1.0), 1.0) + sweep.turn
    width = direction(a1 * a2 + l1 * l2, cross) + 2.0 * margin
    first, last, wrapped = covered(direction(a1, l1) - margin, width, lidar)
    sweep_segment_beams(x1, y1, x2, y2, sweep, lidar, ranges, i, first, last)
    sweep_segment_beams(x1, y1, x2, y2, sweep, lidar, ranges, i, 0, wrapped)


@compiled
def sweep_segment_beams(x1, y1, x2, y2, sweep, lidar, ranges, i, begin, end):
    """Test a segment against the beams [begin, end), each part from its own place."""
    for s in range(begin // sweep.beams, (end + sweep.beams - 1) // sweep.beams):
        a1, l1 = from_slice(x1, y1, sweep.poses, i, s)
        a2, l2 = from_slice(x2, y2, sweep.poses, i, s)
        ex, ey = a2 - a1, l2 - l1
        cross = a1 * ey - l1 * ex
        if cross < 0.0:
            a1, l1, ex, ey = a2, l2, -ex, -ey
        if not edge_on(cross, ex * ex + ey * ey, lidar):
            first, last = max(begin, s * sweep.beams), min(end, (s + 1) * sweep.beams)
            cast_segment_beams(a1, l1, ex, ey, lidar, ranges, i, first, last)


@compiled(inline=False)
def sweep_grid(errors, drawn, i, sweep, lidar, worlds, w, ranges):
    """Shorten the beams that meet a solid cell of world w's grid."""
    for k in range(lidar.num_beams):
        s = k // sweep.beams
        x, y = sweep.poses[i, s, 0], sweep.poses[i, s, 1]
        cos, sin = sweep.poses[i, s, 2], sweep.poses[i, s, 3]
        ux = cos * lidar.cos[k] - sin * lidar.sin[k]
        uy = sin * lidar.cos[k] + cos * lidar.sin[k]
        limit = min(float(ranges[i, k]), lidar.range_max)
        distance = ray_to_grid(x, y, ux, uy, limit, worlds, w)
        if distance <= limit:
            inside = distance + INSIDE
            number = patch_number(x + inside * ux, y + inside * uy, worlds, w)
            target = errors.dark_ranges if is_dark(errors, drawn, i, number) else ranges
            target[i, k] = min(target[i, k], np.float32(distance))
