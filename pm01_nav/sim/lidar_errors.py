# SPDX-License-Identifier: Apache-2.0
"""A lidar that lies: crooked, noisy, late, short-sighted, and blind to what is dark."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.random import GOLDEN, ONE, SHIFT_11, UNIT, mix, uniform
from pm01_nav.sim.state import LidarParams

SEGMENT_NUMBERS, PATCH_NUMBERS = 1 << 40, 2 << 40
"""Discs are numbered from 0, segments and patches from these on: no two share a number."""
PATCH = 0.5
"""A grid is dark in squares of this side [m]."""


@compiled
def true_lidar(drawn, i, lidar):
    """Return the lidar of environment i as it really is; its noise is added elsewhere."""
    cos, sin = np.cos(drawn.lidar_yaw_error[i]), np.sin(drawn.lidar_yaw_error[i])
    return LidarParams(
        lidar.cos,
        lidar.sin,
        lidar.num_beams,
        lidar.angle_min,
        lidar.beams_per_radian,
        lidar.range_min,
        lidar.range_max * drawn.lidar_range_factor[i],
        lidar.x + drawn.lidar_x_error[i],
        lidar.y + drawn.lidar_y_error[i],
        lidar.mount_cos * cos - lidar.mount_sin * sin,
        lidar.mount_sin * cos + lidar.mount_cos * sin,
        0.0,
        lidar.normal_values,
    )


@compiled
def is_dark(errors, drawn, i, number):
    """Tell whether an obstacle is dark: always the same answer within an episode."""
    share = drawn.dark_share[i]
    if share == 0.0:
        return False
    word = mix(errors.dark_key[i] + (np.uint64(number) + ONE) * GOLDEN)
    return float(word >> SHIFT_11) * UNIT < share


@compiled
def patch_number(x, y, worlds, w):
    """Return the number of the patch of world w's grid in which a point lies."""
    column = int(np.floor((x - worlds.grid_frame[w, 0]) / PATCH))
    row = int(np.floor((y - worlds.grid_frame[w, 1]) / PATCH))
    return PATCH_NUMBERS + (row << 20) + column


@compiled
def absorb(errors, drawn, ranges, i):
    """Let dark obstacles stop the beams that meet them, and send them back from nearby only."""
    limit = np.float32(drawn.dark_range[i])
    for k in range(np.uint64(ranges.shape[1])):
        dark = errors.dark_ranges[i, k]
        seen = dark if dark <= limit else np.float32(np.inf)
        ranges[i, k] = seen if dark < ranges[i, k] else ranges[i, k]


@compiled
def disturb(drawn, lidar, ranges, key, count, i):
    """Add errors to each range up to range_max, then lose some of the returns."""
    if drawn.lidar_noise_std[i] > 0.0 or drawn.lidar_noise_share[i] > 0.0:
        blur(drawn, lidar, ranges, key, count, i)
    if drawn.lidar_dropout[i] > 0.0:
        drop(drawn, lidar, ranges, key, count, i)


@compiled
def blur(drawn, lidar, ranges, key, count, i):
    """Add to each range up to range_max an additive and a proportional error.

    One draw of 64 random bits serves four beams, as in ``add_noise``; it is worked out from a
    counter at hand, so that the draws do not wait for each other.
    """
    longest, share = np.float32(lidar.range_max), np.float32(drawn.lidar_noise_share[i])
    variance = np.float32(drawn.lidar_noise_std[i]) ** 2
    own_key, begin = key[i], count[i]
    words = np.uint64(ranges.shape[1] // 4)
    for k in range(words):
        word = mix(own_key + (begin + k + ONE) * GOLDEN)
        for j in range(4):
            exact = ranges[i, 4 * k + j]
            # N(0, std^2 + (share x range)^2): the sum of two independent errors.
            std = np.sqrt(variance + (share * exact) * (share * exact))
            error = lidar.normal_values[(word >> np.uint64(16 * j)) & np.uint64(0xFFFF)]
            ranges[i, 4 * k + j] = exact + std * error if exact <= longest else exact
    count[i] = begin + words


@compiled
def drop(drawn, lidar, ranges, key, count, i):
    """Lose each beam's return with probability ``lidar_dropout``, independently.

    What is drawn is how many beams follow until the next one is lost.
    """
    per_log = 1.0 / np.log1p(-drawn.lidar_dropout[i])
    k = -1.0
    while True:
        # Geometric: P(n beams are kept before the next loss) = p (1 - p)^n.
        k += 1.0 + np.floor(np.log(1.0 - uniform(key, count, i)) * per_log)
        if not k < lidar.num_beams:
            break
        ranges[i, int(k)] = np.inf


@compiled
def hand_out(state, errors, drawn, i, lidar, first):
    """Lose what lies beyond the lidar's own reach, and exchange a late scan for an earlier one.

    The ``first`` scan of an episode is shown, and stands for all that would be before it.
    """
    longest = np.float32(lidar.range_max)
    waiting, beams = errors.waiting_ranges, state.ranges.shape[1]
    kept = waiting.shape[1] // beams
    late = int(drawn.scan_delay[i])
    shown = (late - 1) * beams
    for k in range(np.uint64(beams)):
        measured = state.ranges[i, k] if state.ranges[i, k] <= longest else np.float32(np.inf)
        state.ranges[i, k] = waiting[i, shown + k] if late > 0 and not first else measured
        for age in range(kept - 1, 0, -1):
            waiting[i, age * beams + k] = measured if first else waiting[i, (age - 1) * beams + k]
        waiting[i, k] = measured
