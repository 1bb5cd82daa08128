# SPDX-License-Identifier: Apache-2.0
"""Cast the beams of a planar lidar against discs, segments and an occupancy grid.

Few beams are all tested against each obstacle in range; of many, only those within the angle
under which the obstacle is seen. The loops over beams run in whole blocks and count in unsigned
numbers: only so does the compiler turn them into vector instructions (measured: 7 times faster).
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import segment, to_base
from pm01_nav.sim.grid_frame import to_cells, turn_to_grid
from pm01_nav.sim.random import GOLDEN, ONE, mix
from pm01_nav.sim.state import BLOCK
from pm01_nav.sim.views import listed, view_cell

FEW_BEAMS = 48
"""Up to this many beams all are tested; finding those that matter would cost more."""
TWO_PI = 2.0 * np.pi
BEAM_ERROR = 2e-7
"""Beams are cast in float32, which is as if each were turned by up to so much [rad].

Three roundings of 2^-24 each. Twice as many beams fit into one vector instruction as of float64.
"""
ANGLE_ERROR = 1e-4
"""What ``direction`` may be off [rad]."""


@compiled
def cast_scan(x, y, cos, sin, lidar, worlds, w, ranges, i):
    """Write the exact ranges of environment i [m]; infinity where nothing is hit within range_max.

    ``x``, ``y``, ``cos``, ``sin`` are base_link's place and heading; ``ranges`` has the shape
    (num_envs, num_beams padded to whole blocks) and is float32. It is handed on whole, since a
    view of one row costs two counts of references at each call.
    """
    x, y = x + cos * lidar.x - sin * lidar.y, y + sin * lidar.x + cos * lidar.y
    cos, sin = (
        cos * lidar.mount_cos - sin * lidar.mount_sin,
        sin * lidar.mount_cos + cos * lidar.mount_sin,
    )
    for k in range(ranges.shape[1]):
        ranges[i, k] = np.inf
    cell = view_cell(x, y, lidar.range_max, worlds, w)
    first, last = listed(worlds.seen_disc_begin, cell)
    for n in range(first, last):
        k = np.uint64(worlds.seen_discs[n])
        dx, dy, r = worlds.discs[k, 0] - x, worlds.discs[k, 1] - y, worlds.discs[k, 2]
        reach = lidar.range_max + r
        if dx * dx + dy * dy <= reach * reach:
            dx, dy = to_base(dx, dy, cos, sin)
            cast_disc(dx, dy, r, lidar, ranges, i)
    first, last = listed(worlds.seen_segment_begin, cell)
    for n in range(first, last):
        x1, y1, x2, y2 = segment(worlds, np.uint64(worlds.seen_segments[n]))
        x1, y1 = to_base(x1 - x, y1 - y, cos, sin)
        x2, y2 = to_base(x2 - x, y2 - y, cos, sin)
        cast_segment(x1, y1, x2, y2, lidar, ranges, i)
    if worlds.grid_begin[w + 1] > worlds.grid_begin[w]:
        cast_grid(x, y, cos, sin, lidar, worlds, w, ranges, i)


@compiled
def cast_disc(x, y, r, lidar, ranges, i):
    """Shorten the beams that meet a disc at (x, y) in the lidar frame."""
    squared = x * x + y * y
    if squared <= r * r:
        ranges[i] = 0.0
    elif lidar.num_beams <= FEW_BEAMS:
        cast_disc_beams(x, y, r, lidar, ranges, i, 0, ranges.shape[1])
    else:
        # The half angle is asin(sine), which this exceeds, by a beam or two close by.
        sine = r / np.sqrt(squared)
        half = sine + (0.5 * np.pi - 1.0) * sine * sine * sine
        first, last, wrapped = covered(direction(x, y) - half, 2.0 * half, lidar)
        for _ in range(2):  # Not two calls: both would be inlined, and the kernel grow for it.
            cast_disc_beams(x, y, r, lidar, ranges, i, first, last)
            if wrapped == 0:
                break
            first, last = 0, wrapped


@compiled
def cast_disc_beams(x, y, r, lidar, ranges, i, begin, end):
    """Test a disc against the beams [begin, end), as if each were turned by BEAM_ERROR at most."""
    x, y, r = np.float32(x), np.float32(y), np.float32(r)
    for k in range(np.uint64(begin), np.uint64(end)):
        across = x * lidar.sin[k] - y * lidar.cos[k]
        along = x * lidar.cos[k] + y * lidar.sin[k]
        under = (r - across) * (r + across)
        distance = along - np.sqrt(max(under, np.float32(0.0)))
        hit = (under >= np.float32(0.0)) & (along > np.float32(0.0))
        # Nothing is negative here. But for abs, LLVM would make the minimum a masked store, which
        # AMD's processors are slow at, and from which nothing can be read on at once.
        ranges[i, k] = abs(min(ranges[i, k], distance if hit else np.float32(np.inf)))


@compiled
def cast_segment(x1, y1, x2, y2, lidar, ranges, i):
    """Shorten the beams that meet a segment between two points in the lidar frame."""
    ex, ey = x2 - x1, y2 - y1
    length_squared = max(ex * ex + ey * ey, 1e-18)
    cross = x1 * ey - y1 * ex
    range_squared = lidar.range_max * lidar.range_max
    if cross * cross > range_squared * length_squared or edge_on(cross, length_squared, lidar):
        return  # The whole line is out of range, or has no width.
    along = min(max(-(x1 * ex + y1 * ey) / length_squared, 0.0), 1.0)
    nearest_x, nearest_y = x1 + along * ex, y1 + along * ey
    if nearest_x * nearest_x + nearest_y * nearest_y > range_squared:
        return
    if cross < 0.0:  # From here on the first end is the right one.
        x1, y1, ex, ey, cross = x2, y2, -ex, -ey, -cross
    if lidar.num_beams <= FEW_BEAMS:
        cast_segment_beams(x1, y1, ex, ey, lidar, ranges, i, 0, ranges.shape[1])
    else:
        width = direction(x1 * (x1 + ex) + y1 * (y1 + ey), cross)
        first, last, wrapped = covered(direction(x1, y1), width, lidar)
        for _ in range(2):  # Not two calls: both would be inlined, and the kernel grow for it.
            cast_segment_beams(x1, y1, ex, ey, lidar, ranges, i, first, last)
            if wrapped == 0:
                break
            first, last = 0, wrapped


@compiled
def cast_segment_beams(x1, y1, ex, ey, lidar, ranges, i, begin, end):
    """Test a segment, given by its right end and its extent, against the beams [begin, end).

    Its ends are drawn out by what beams may be off: none through the corner of two walls must slip
    between them.
    """
    cross = np.float32(x1 * ey - y1 * ex)
    x2, y2 = np.float32(x1 + ex), np.float32(y1 + ey)
    x1, y1, ex, ey = np.float32(x1), np.float32(y1), np.float32(ex), np.float32(ey)
    right = np.float32(-BEAM_ERROR) * np.sqrt(x1 * x1 + y1 * y1)
    left = np.float32(-BEAM_ERROR) * np.sqrt(x2 * x2 + y2 * y2)
    for k in range(np.uint64(begin), np.uint64(end)):
        across = lidar.cos[k] * ey - lidar.sin[k] * ex
        from_right = x1 * lidar.sin[k] - y1 * lidar.cos[k]
        from_left = y2 * lidar.cos[k] - x2 * lidar.sin[k]
        hit = (across > np.float32(0.0)) & (from_right >= right) & (from_left >= left)
        distance = cross / across
        # See ``cast_disc_beams`` for abs.
        ranges[i, k] = abs(min(ranges[i, k], distance if hit else np.float32(np.inf)))


@compiled
def edge_on(cross, length_squared, lidar):
    """Tell whether a segment is seen so flat that beams which are a little off miss it or not.

    ``cross`` is its length times the distance of its line from the lidar.
    """
    width = BEAM_ERROR * lidar.range_max
    return cross * cross < width * width * length_squared


@compiled
def direction(x, y):
    """Return the direction of a vector [rad], at most ANGLE_ERROR off, in a tenth of the time.

    It only chooses beams to test. A polynomial for the arc tangent on [0, 1], which was fitted for
    the least greatest error, is carried to all octants.
    """
    across, along = abs(y), abs(x)
    z = min(across, along) / max(across, along, 1e-300)
    q = z * z
    angle = z * (0.9992138 + q * (-0.3211748 + q * (0.1462641 - q * 0.03898627)))
    angle = 0.5 * np.pi - angle if across > along else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@compiled
def covered(right, width, lidar):
    """Return the whole blocks of beams within an angle, given by its right side and width [rad].

    They are [first, last), and [0, wrapped) where the angle reaches past a full turn; the angle is
    widened by what ``direction`` may be off.
    """
    begin = right - 2.0 * ANGLE_ERROR - lidar.angle_min
    begin -= TWO_PI * np.floor(begin / TWO_PI)
    end = begin + width + 4.0 * ANGLE_ERROR
    per_radian = lidar.beams_per_radian
    first = min(int(begin * per_radian), lidar.num_beams)
    last = min(int(end * per_radian) + 1, lidar.num_beams)
    wrapped = min(int((end - TWO_PI) * per_radian) + 1, lidar.num_beams) if end >= TWO_PI else 0
    return first // BLOCK * BLOCK, whole_blocks(last), whole_blocks(wrapped)


@compiled
def whole_blocks(beams):
    """Return a number of beams rounded up to whole blocks."""
    return (beams + BLOCK - 1) // BLOCK * BLOCK


@compiled(inline=False)
def cast_grid(x, y, cos, sin, lidar, worlds, w, ranges, i):
    """Shorten the beams that meet a solid cell, cast from (x, y) along the lidar's x axis."""
    for k in range(lidar.num_beams):
        ux = cos * lidar.cos[k] - sin * lidar.sin[k]
        uy = sin * lidar.cos[k] + cos * lidar.sin[k]
        limit = min(float(ranges[i, k]), lidar.range_max)
        ranges[i, k] = min(ranges[i, k], np.float32(ray_to_grid(x, y, ux, uy, limit, worlds, w)))


@compiled(inline=False)
def ray_to_grid(x, y, ux, uy, limit, worlds, w):
    """Return the distance along a ray to the first solid cell, infinity beyond ``limit`` [m].

    Walks from cell border to cell border (Amanatides and Woo 1987), and leaps where the
    distance transform says that nothing is near.
    """
    offset, size = worlds.grid_begin[w], worlds.grid_frame[w, 2]
    width, height = int(worlds.grid_frame[w, 3]), int(worlds.grid_frame[w, 4])
    px, py = to_cells(x, y, worlds, w)
    ux, uy = turn_to_grid(ux, uy, worlds, w)
    end = limit / size
    distance = _enter_grid(px, py, ux, uy, float(width), float(height))
    column = min(max(int(np.floor(px + distance * ux)), 0), width - 1)
    row = min(max(int(np.floor(py + distance * uy)), 0), height - 1)
    step_x, step_y = (1 if ux > 0.0 else -1), (1 if uy > 0.0 else -1)
    while distance <= end:
        here = offset + row * width + column
        if worlds.grid_cells[here] != 0:
            return distance * size
        # All cells within this reach of the present cell are free (centre to centre, less the
        # diagonal of both cells).
        leap = worlds.grid_distance[here] - 2.0
        if leap > 2.0:
            distance += leap
            column, row = int(np.floor(px + distance * ux)), int(np.floor(py + distance * uy))
        else:
            to_x = (column + (step_x > 0) - px) / ux if ux != 0.0 else np.inf
            to_y = (row + (step_y > 0) - py) / uy if uy != 0.0 else np.inf
            if to_x < to_y:
                distance = max(distance, to_x)
                column += step_x
            else:
                distance = max(distance, to_y)
                row += step_y
        if column < 0 or row < 0 or column >= width or row >= height:
            return np.inf
    return np.inf


@compiled
def _enter_grid(px, py, ux, uy, width, height):
    """Return how far along a ray the grid begins, infinity if it is never met [cells]."""
    enter, leave = 0.0, np.inf
    for axis in range(2):
        p, u, size = (px, ux, width) if axis == 0 else (py, uy, height)
        if u == 0.0:
            if p < 0.0 or p > size:
                return np.inf
        else:
            near, far = min(-p / u, (size - p) / u), max(-p / u, (size - p) / u)
            enter, leave = max(enter, near), min(leave, far)
    return enter if enter <= leave else np.inf


@compiled
def add_noise(lidar, ranges, key, count, i):
    """Add a normal error to each range up to range_max.

    One draw of 64 random bits picks four of the 65536 equally likely values in ``normal_values``;
    it is worked out from a counter at hand, so that the draws do not wait for each other.
    """
    std, longest = np.float32(lidar.noise_std), np.float32(lidar.range_max)
    own_key, begin = key[i], count[i]
    words = np.uint64((lidar.num_beams + 3) // 4)
    for k in range(words):
        word = mix(own_key + (begin + k + ONE) * GOLDEN)
        for j in range(4):
            exact = ranges[i, 4 * k + j]
            error = lidar.normal_values[(word >> np.uint64(16 * j)) & np.uint64(0xFFFF)]
            ranges[i, 4 * k + j] = exact + std * error if exact <= longest else exact
    count[i] = begin + words


@compiled
def read_scans(ranges, scan, range_min, range_max):
    """Write into ``scan`` (num_envs, num_beams) what the lidars read by REP-117 [m]."""
    shortest, longest = np.float32(range_min), np.float32(range_max)
    for i in range(scan.shape[0]):
        for k in range(np.uint64(scan.shape[1])):
            scan[i, k] = reading(ranges[i, k], shortest, longest)


@compiled
def reading(value, shortest, longest):
    """Return by REP-117 what the sensor says of a range: +inf beyond its reach, -inf below it."""
    # This sensor knows what is too close; of others a finite range below range_min is doubtful.
    value = np.float32(-np.inf) if value < shortest else value
    return sanitized(value, shortest, longest)


@compiled
def sanitized(value, shortest, longest):
    """Return what a raw range is worth; ``task.observation.discard_invalid`` is the same.

    All values are float32 [m].
    """
    # Beyond the greatest range, or NaN, which no comparison holds for.
    value = value if value <= longest else np.float32(np.inf)
    return np.float32(np.inf) if (value < shortest) & (value > -np.inf) else value


@compiled
def nearest_in_sectors(lidar, ranges, nearest, i):
    """Keep the nearest reading of each sector of neighbouring beams.

    Of two ranges the nearer has the nearer reading, so that one reading a sector will do. All
    sectors go through their beams together: these loops become vector instructions.
    """
    shortest, longest = np.float32(lidar.range_min), np.float32(lidar.range_max)
    sectors = np.uint64(nearest.shape[1])
    beams = np.uint64(lidar.num_beams) // sectors
    for s in range(sectors):
        nearest[i, s] = ranges[i, s * beams]
    for j in range(np.uint64(1), beams):
        for s in range(sectors):
            nearest[i, s] = min(nearest[i, s], ranges[i, s * beams + j])
    for s in range(sectors):
        nearest[i, s] = reading(nearest[i, s], shortest, longest)
