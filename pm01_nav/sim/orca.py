# SPDX-License-Identifier: Apache-2.0
"""Optimal reciprocal collision avoidance (van den Berg, Guy, Lin and Manocha, ISRR 2011).

A half-plane of velocities is a row (nx, ny, least): n unit, permitted is n . v >= least [m/s].
A velocity is chosen by the incremental linear program in two dimensions, or, where no velocity is
permitted, by one in three, which yields the least to what moves and nothing to what stands.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled

HORIZON = 2.0
"""Velocities that would collide within this time are avoided [s]."""
PARALLEL = 1e-9
"""Sine of the angle below which two borders never meet."""


@compiled
def avoidance(px, py, vx, vy, reach, dt):
    """Return how a relative velocity leaves its velocity obstacle the shortest way.

    ``px``, ``py`` lead to the other [m], ``vx``, ``vy`` are one's own velocity less the other's,
    ``reach`` is the sum of both radii. Returns the obstacle's outward normal nx, ny there, and how
    far along it the velocity has to change [m/s], negative if it is outside.
    """
    squared = px * px + py * py
    apart = squared > reach * reach
    # Two that overlap already shall part within one step.
    rate = 1.0 / (HORIZON if apart else dt)
    wx, wy = vx - px * rate, vy - py * rate
    length_squared = wx * wx + wy * wy
    towards = wx * px + wy * py
    # Both ways are worked out and one is chosen, so that a loop handles several at a time.
    length = np.sqrt(length_squared)
    scale = 1.0 / max(length, 1e-12)
    # On one of the two sides, which touch the other's grown disc: left if w lies left of p.
    leg = np.sqrt(max(squared - reach * reach, 0.0))
    leg = leg if px * wy - py * wx > 0.0 else -leg
    per_square = 1.0 / max(squared, 1e-24)
    side_x, side_y = -(px * reach + py * leg) * per_square, (px * leg - py * reach) * per_square
    # The round end is nearest.
    end = (not apart) | ((towards < 0.0) & (towards * towards > reach * reach * length_squared))
    nx, ny = (wx * scale if end else side_x), (wy * scale if end else side_y)
    short = reach * rate - length if end else -(vx * side_x + vy * side_y)
    return nx, ny, short


@compiled
def choose_velocity(planes, row, num_fixed, count, wanted_x, wanted_y, speed_max):
    """Return the permitted velocity that is nearest to the wanted one, at most ``speed_max``.

    Of the ``count`` half-planes in ``planes[row]`` (n, 3) the first ``num_fixed`` are never given
    up; the last row of ``planes`` is overwritten. The wanted velocity must not exceed
    ``speed_max`` [m/s].
    """
    vx, vy, kept = nearest(planes, row, count, wanted_x, wanted_y, speed_max, False)
    if kept < count:
        vx, vy = least_violation(planes, row, num_fixed, kept, count, vx, vy, speed_max)
    return vx, vy


@compiled
def nearest(planes, row, count, wanted_x, wanted_y, speed_max, outward):
    """Solve the linear program in two dimensions.

    Returns the velocity and how many planes it is sure to keep: less than ``count`` if the next one
    cannot be kept together with them. ``outward`` looks for the velocity furthest along the wanted
    one, which then has the length ``speed_max``, instead of the nearest to it.
    """
    vx, vy = wanted_x, wanted_y
    for k in range(count):
        nx, ny, least = planes[row, k, 0], planes[row, k, 1], planes[row, k, 2]
        if nx * vx + ny * vy < least:
            low, high = border(planes, row, k, speed_max)
            if low > high:
                return vx, vy, k
            along = ny * wanted_x - nx * wanted_y
            if outward:
                along = high if along > 0.0 else low
            along = min(max(along, low), high)
            vx, vy = least * nx + along * ny, least * ny - along * nx
    return vx, vy, count


@compiled
def border(planes, row, k, speed_max):
    """Return the part of plane k's border that the speed limit and earlier planes leave.

    From low to high along (ny, -nx), from the point nearest to standing still [m/s]; low > high if
    nothing is left.
    """
    nx, ny, least = planes[row, k, 0], planes[row, k, 1], planes[row, k, 2]
    half_squared = speed_max * speed_max - least * least
    if half_squared < 0.0:
        return 1.0, 0.0
    high = np.sqrt(half_squared)
    low = -high
    impossible = False
    for j in range(k):
        # No branches: they would be mispredicted too often.
        slope = planes[row, j, 0] * ny - planes[row, j, 1] * nx
        needed = planes[row, j, 2] - least * (planes[row, j, 0] * nx + planes[row, j, 1] * ny)
        limit = needed / slope
        low = max(low, limit if slope > PARALLEL else low)
        high = min(high, limit if slope < -PARALLEL else high)
        impossible |= (abs(slope) <= PARALLEL) & (needed > PARALLEL)
    return (1.0 if impossible else low), (0.0 if impossible else high)


@compiled(inline=False)
def least_violation(planes, row, num_fixed, begin, count, vx, vy, speed_max):
    """Return the velocity whose worst violation of the planes after the fixed ones is least.

    (vx, vy) keeps the planes before ``begin``. Each violated plane in turn becomes the worst:
    among the velocities that violate none before it more, the least bad is taken.
    """
    spare = planes.shape[0] - 1
    worst = 0.0
    for k in range(begin, count):
        nx, ny, least = planes[row, k, 0], planes[row, k, 1], planes[row, k, 2]
        if least - nx * vx - ny * vy <= worst:
            continue
        rows = min(num_fixed, k)
        for j in range(rows):
            for c in range(3):
                planes[spare, j, c] = planes[row, j, c]
        for j in range(num_fixed, k):
            dx, dy = planes[row, j, 0] - nx, planes[row, j, 1] - ny
            length = np.sqrt(dx * dx + dy * dy)
            if length > PARALLEL:
                planes[spare, rows, 0], planes[spare, rows, 1] = dx / length, dy / length
                planes[spare, rows, 2] = (planes[row, j, 2] - least) / length
                rows += 1
        x, y, kept = nearest(planes, spare, rows, nx * speed_max, ny * speed_max, speed_max, True)
        if kept == rows:  # Else by rounding alone; what was found before is as good.
            vx, vy = x, y
        worst = least - nx * vx - ny * vy
    return vx, vy
