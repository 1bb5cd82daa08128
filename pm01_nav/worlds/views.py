# SPDX-License-Identifier: Apache-2.0
"""What can be seen from where: for each cell of a coarse raster, the obstacles worth a look.

A lidar in a building sees a dozen of the hundred edges of its walls: the others are out of range,
turn their back on it, or stand behind one that hides them. That is found out once for each cell of
a world, for everywhere in it, so that no scan need ask again. It errs on one side only: whatever
might be seen is listed. (Inside a polygon nothing is to be seen: no robot gets there.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.worlds.polygon import signed_area
from pm01_nav.worlds.segments import point_to_segment
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CELL = 0.5
"""Side of a cell [m]; more in large worlds."""
MARGIN = 0.1
"""What a cell lists is right for places so far outside it, too [m]."""
MAX_PAIRS = 10_000_000
"""Pairs of a cell and an obstacle in one world; cells are made larger until there are no more."""
OCCLUDERS = 12
"""So many of the nearest segments are tried as what hides an obstacle."""
HAIR = 1e-9
"""What is only touched hides nothing: lines of sight must pass so far from its ends [m]."""


class Views(NamedTuple):
    """What is seen of each world of a pool; world w owns the cells from ``view_begin[w]`` on.

    The first of them stands for all places outside the raster, and lists everything. The others
    follow row by row.
    """

    view_range: float
    """How far one can see [m]; who sees further needs the first cell, too."""
    view_frame: FloatArray
    """x, y of the lower left corner [m], side of a cell [m], width, height [cells], (worlds, 5)."""
    view_begin: IntArray
    seen_segments: NDArray[np.int32]
    """Rows of ``WorldArrays.segments``, shape (n,)."""
    seen_segment_begin: IntArray
    """Where the list of each cell begins, shape (num_cells + 1,)."""
    seen_discs: NDArray[np.int32]
    """Rows of ``WorldArrays.discs``, shape (n,)."""
    seen_disc_begin: IntArray


def list_everything(segment_begin: IntArray, disc_begin: IntArray) -> Views:
    """List all obstacles of each world in its only cell, for who does not know how far one sees.

    ``segment_begin``, ``disc_begin`` (num_worlds + 1,) are those of ``WorldArrays``.
    """
    worlds = len(segment_begin) - 1
    segments, discs = (np.arange(b[-1], dtype=np.int32) for b in (segment_begin, disc_begin))
    first_cells = np.arange(worlds)
    return Views(
        0.0, np.zeros((worlds, 5)), first_cells, segments, segment_begin, discs, disc_begin
    )


def list_views(worlds: Sequence[World], view_range: float) -> Views:
    """List for each cell of each world what may be seen from there, up to ``view_range`` [m]."""
    frames = np.zeros((len(worlds), 5))
    begin = np.zeros(len(worlds), dtype=np.int64)
    segments, discs = _Lists(), _Lists()
    for w, world in enumerate(worlds):
        begin[w] = segments.cells
        solid, one_sided = _segments(world)
        obstacles = np.ascontiguousarray(world.discs)
        segments.add(np.arange(len(solid)), [len(solid)])
        discs.add(np.arange(len(obstacles)), [len(obstacles)])
        if len(solid) + len(obstacles) > 0:
            frames[w] = _frame(world, len(solid) + len(obstacles))
            seen = _look_around(solid, one_sided, obstacles, frames[w], view_range)
            segments.add(seen[0], seen[1])
            discs.add(seen[2], seen[3])
        segments.end_world(len(solid))
        discs.end_world(len(obstacles))
    return Views(view_range, frames, begin, *segments.joined(), *discs.joined())


class _Lists:
    """Lists of rows, laid end to end."""

    def __init__(self) -> None:
        self.cells = 0
        self._rows: list[NDArray] = [np.zeros(0, dtype=np.int64)]
        self._lengths: list[NDArray] = [np.zeros(1, dtype=np.int64)]
        self._first = 0

    def add(self, rows: NDArray, lengths: NDArray | list[int]) -> None:
        """Add the lists of some cells, end to end; rows count from the first of the world."""
        self._rows.append(rows + self._first)
        self._lengths.append(np.asarray(lengths, dtype=np.int64))
        self.cells += len(lengths)

    def end_world(self, count: int) -> None:
        """Go on to the next world; this one had ``count`` obstacles."""
        self._first += count

    def joined(self) -> tuple[NDArray[np.int32], IntArray]:
        """Return all rows, and where each list begins."""
        rows = np.concatenate(self._rows).astype(np.int32)
        return rows, np.cumsum(np.concatenate(self._lengths))


def _segments(world: World) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return ``World.all_segments`` with their solid side, if they have one, to the left."""
    segments = world.all_segments.copy()
    one_sided = np.arange(len(segments)) >= len(world.segments)
    first = len(world.segments)
    for polygon in world.polygons:
        if signed_area(polygon) < 0.0:
            edges = segments[first : first + len(polygon)]
            edges[:] = edges[:, [2, 3, 0, 1]]
        first += len(polygon)
    return segments, one_sided


def _frame(world: World, obstacles: int) -> tuple[float, float, float, int, int]:
    x_min, y_min, x_max, y_max = world.known_bounds
    area = (x_max - x_min) * (y_max - y_min)
    size = max(CELL, np.sqrt(area * obstacles / MAX_PAIRS))
    width, height = np.ceil((x_max - x_min) / size), np.ceil((y_max - y_min) / size)
    return x_min, y_min, size, int(width), int(height)


def _look_around(
    segments: FloatArray,
    one_sided: NDArray[np.bool_],
    discs: FloatArray,
    frame: FloatArray,
    view_range: float,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return the segments seen from each cell, end to end, and how many; the same of the discs."""
    cells = int(frame[3] * frame[4])
    counts = np.zeros((2, cells), dtype=np.int64)
    work = np.zeros(len(segments), dtype=np.int64), np.zeros(OCCLUDERS, dtype=np.int64)
    distances = np.zeros(OCCLUDERS)
    scene = segments, one_sided, discs, frame, view_range
    rows = np.zeros((2, 32 * cells + len(segments) + len(discs)), dtype=np.int32)
    while not _list_cells(*scene, *work, distances, rows, counts):
        rows = np.zeros((2, 2 * rows.shape[1]), dtype=np.int32)
    num_segments, num_discs = counts.sum(axis=1)
    return rows[0, :num_segments], counts[0], rows[1, :num_discs], counts[1]


@compiled
def _list_cells(
    segments, one_sided, discs, frame, view_range, near, hiders, distances, rows, counts
):
    """Write into ``rows`` what is seen from each cell, and how many; tell whether there was room.

    The first row is for segments, the second one for discs; ``near``, ``hiders`` and ``distances``
    are room to work in.
    """
    width, num_segments, num_discs = int(frame[3]), 0, 0
    for cell in range(counts.shape[1]):
        if max(num_segments + segments.shape[0], num_discs + discs.shape[0]) > rows.shape[1]:
            return False
        counts[0, cell], counts[1, cell] = num_segments, num_discs
        left = frame[0] + (cell % width) * frame[2] - MARGIN
        low = frame[1] + (cell // width) * frame[2] - MARGIN
        area = (left, low, left + frame[2] + 2.0 * MARGIN, low + frame[2] + 2.0 * MARGIN)
        count, tried = _facing(segments, one_sided, area, view_range, near, hiders, distances)
        for n in range(count):
            if not _segment_hidden(segments, hiders, tried, near[n], area):
                rows[0, num_segments] = near[n]
                num_segments += 1
        for k in range(discs.shape[0]):
            within = _disc_near(discs, k, area, view_range)
            if within and not _disc_hidden(segments, hiders, tried, discs, k, area):
                rows[1, num_discs] = k
                num_discs += 1
        counts[0, cell] = num_segments - counts[0, cell]
        counts[1, cell] = num_discs - counts[1, cell]
    return True


@compiled
def _facing(segments, one_sided, area, view_range, near, hiders, distances):
    """Find the segments within range that turn their face to an area (left, low, right, high).

    Writes them into ``near``, and the nearest of them into ``hiders``, of which ``distances`` [m]
    are kept in order; returns how many each are.
    """
    x, y = 0.5 * (area[0] + area[2]), 0.5 * (area[1] + area[3])
    wide, high = area[2] - area[0], area[3] - area[1]
    reach = view_range + 0.5 * np.sqrt(wide * wide + high * high)
    count = tried = 0
    for k in range(segments.shape[0]):
        away = point_to_segment(
            x, y, segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
        )
        if away > reach:
            continue
        to_left, to_right = _reaches(segments, k, area)
        if one_sided[k] and to_right < -HAIR:
            continue
        near[count] = k
        count += 1
        # Only what has the area wholly to one side can hide anything from all of it.
        aside = min(to_left, to_right) < -HAIR
        if aside and (tried < OCCLUDERS or away < distances[tried - 1]):
            tried = min(tried + 1, OCCLUDERS)
            slot = tried - 1
            while slot > 0 and distances[slot - 1] > away:
                distances[slot], hiders[slot] = distances[slot - 1], hiders[slot - 1]
                slot -= 1
            distances[slot], hiders[slot] = away, k
    return count, tried


@compiled
def _reaches(segments, k, area):
    """Return how far an area reaches to the left and to the right of a segment's line [m]."""
    x1, y1 = segments[k, 0], segments[k, 1]
    ex, ey = segments[k, 2] - x1, segments[k, 3] - y1
    length = max(np.sqrt(ex * ex + ey * ey), HAIR)
    x, y = 0.5 * (area[0] + area[2]) - x1, 0.5 * (area[1] + area[3]) - y1
    middle = (ex * y - ey * x) / length
    half = 0.5 * (abs(ex) * (area[3] - area[1]) + abs(ey) * (area[2] - area[0])) / length
    return middle + half, half - middle


@compiled
def _segment_hidden(segments, hiders, tried, k, area):
    """Tell whether one of some segments hides the whole k-th one from everywhere in an area."""
    x1, y1, x2, y2 = segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3]
    for n in range(tried):
        j = hiders[n]
        if _hides(segments, j, x1, y1, area) and _hides(segments, j, x2, y2, area):
            return True
    return False


@compiled
def _disc_near(discs, k, area, view_range):
    """Tell whether a disc is within range of some place in an area."""
    x, y, reach = discs[k, 0], discs[k, 1], discs[k, 2] + view_range
    dx, dy = max(area[0] - x, 0.0, x - area[2]), max(area[1] - y, 0.0, y - area[3])
    return dx * dx + dy * dy <= reach * reach


@compiled
def _disc_hidden(segments, hiders, tried, discs, k, area):
    """Tell whether one of some segments hides the square around a disc from an area."""
    x, y, r = discs[k, 0], discs[k, 1], discs[k, 2]
    for n in range(tried):
        j = hiders[n]
        if (
            _hides(segments, j, x - r, y - r, area)
            and _hides(segments, j, x + r, y - r, area)
            and _hides(segments, j, x + r, y + r, area)
            and _hides(segments, j, x - r, y + r, area)
        ):
            return True
    return False


@compiled
def _hides(segments, j, x, y, area):
    """Tell whether a segment, of which an area lies to one side, hides a point from all of it.

    The point must lie to the other side, and every line of sight pass between the segment's ends.
    Since area and point are convex it is enough to look from the corners.
    """
    ax, ay, bx, by = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
    ex, ey = bx - ax, by - ay
    point = ex * (y - ay) - ey * (x - ax)
    place = ex * (area[1] - ay) - ey * (area[0] - ax)
    if (point > 0.0) == (place > 0.0) or abs(point) <= HAIR * (abs(ex) + abs(ey)):
        return False
    for corner in range(4):
        cx, cy = area[2 * (corner & 1)], area[1 + (corner & 2)]
        dx, dy = x - cx, y - cy
        hair = HAIR * (abs(dx) + abs(dy))
        one = dx * (ay - cy) - dy * (ax - cx)
        other = dx * (by - cy) - dy * (bx - cx)
        if not ((one > hair and other < -hair) or (one < -hair and other > hair)):
            return False
    return True
