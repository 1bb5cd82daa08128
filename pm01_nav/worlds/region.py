# SPDX-License-Identifier: Apache-2.0
"""Where in a world to drive: a part of it that a person names, and what walls enclose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.free_space import FreeSpace, free_space
from pm01_nav.worlds.grid import OccupancyGrid
from pm01_nav.worlds.world import World

Area = tuple[float, float, float, float]

DOORWAY = 1.5
"""Openings in walls up to this width count as closed [m]: doors mostly have 0.8 to 1.2 m."""
LEAST_ENCLOSED = 2.0
"""Less counts as no room [m²]."""
LEAST_OPEN = 0.1
"""A corridor that ends at the edge of a map opens less of that edge; a lawn opens more."""
LEAST_SHARE = 0.01
"""Less of the starts outside is not worth a word."""


def drive_within(world: World, region: Area | None) -> World:
    """Return a world in which episodes start, end and lead through ``region`` only [m].

    None is anywhere.

    Raises:
        InputError: the region encloses no area or lies beside the world, or the world's start is
            not in it.
    """
    if region is None:
        return world
    low, high = np.array(region[:2]), np.array(region[2:])
    name = f"region = {' '.join(f'{value:g}' for value in region)}"
    if not (low < high).all():
        raise InputError(f"{name}: must be x_min y_min x_max y_max, each minimum the smaller one")
    if (low >= world.bounds[2:]).any() or (high <= world.bounds[:2]).any():
        bounds = " ".join(f"{value:g}" for value in world.bounds)
        raise InputError(f"{name}: lies beside world {world.name}, which spans {bounds}")
    if world.start is not None:
        place = np.array(world.start[:2])
        if (place < low).any() or (place > high).any():
            raise InputError(
                f"{name}: the start of world {world.name}, {world.start}, is not in it"
            )
    return replace(world, bounds=region)


def starts_outside(world: World, starts: NDArray[np.float64]) -> str | None:
    """Warn if ``starts`` (n, 2) [m] lie outside, while walls of the world enclose something.

    Outside is what a disc as wide as ``DOORWAY`` reaches from beyond the edge of the world, or of
    its map. Returns one line, or None.
    """
    inside = _enclosure(world)
    if inside is None:
        return None
    cells = np.floor((starts - inside.outside.origin) / inside.outside.resolution).astype(np.int64)
    columns, rows = np.clip(cells, 0, np.array(inside.outside.free.shape[::-1]) - 1).T
    share = float(inside.outside.free[rows, columns].mean())
    if share < LEAST_SHARE:
        return None
    warning = f"{world.name}: {100.0 * share:.0f} % of the starts lie outside what walls enclose; "
    warning += '--region "x0 y0 x1 y1" says where to drive'
    if inside.around is None:
        return warning
    within = " ".join(f"{value:.1f}" for value in inside.around)
    return f'{warning}, here perhaps "{within}"'


@dataclass(frozen=True)
class _Enclosure:
    """What walls enclose."""

    outside: FreeSpace
    """Its free cells are outside."""
    around: Area | None
    """A region whose largest free part is enclosed [m]; None if none was found."""


def _enclosure(world: World) -> _Enclosure | None:
    """Return what walls enclose, None if it is next to nothing."""
    from scipy import ndimage

    grid = world.grid if world.grid is not None and world.grid.closed else None
    opened = None if grid is None else _opened(grid)
    if opened is not None and (_edge(opened.occupied) == 0).mean() < LEAST_OPEN:
        return None
    area = world.bounds if grid is None else grid.free_extent or world.bounds
    bounds = (area[0] - DOORWAY, area[1] - DOORWAY, area[2] + DOORWAY, area[3] + DOORWAY)
    try:
        wider = replace(world, bounds=bounds, grid=opened or world.grid)
    except InputError:  # It is as large, or as far out, as a world may be.
        return None
    space = free_space(wider, DOORWAY / 2.0)
    regions = space.regions()
    outside = np.isin(regions, np.unique(_edge(regions)[_edge(regions) > 0]))
    rooms = space.free & ~outside
    if not outside.any() or rooms.sum() * space.resolution**2 < LEAST_ENCLOSED:
        return None
    # The disc covers more than its centres.
    reach = DOORWAY / 2.0 / space.resolution
    covered = np.asarray(ndimage.distance_transform_edt(~outside)) <= reach
    largest = np.bincount(regions[rooms]).argmax()
    around = (_around(space, rooms, part) for part in (rooms, regions == largest))
    return _Enclosure(replace(space, free=covered), next(filter(None, around), None))


def _around(space: FreeSpace, rooms: NDArray[np.bool_], part: NDArray[np.bool_]) -> Area | None:
    """Return the region around ``part``, or None if it holds larger free parts than ``rooms``."""
    rows, columns = np.nonzero(part)
    window = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    regions = replace(space, free=space.free[window]).regions()
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    if not rooms[window][regions == sizes.argmax()].all():
        return None
    places, wide = space.centre(rows, columns), DOORWAY / 2.0
    (x_min, y_min), (x_max, y_max) = places.min(axis=0) - wide, places.max(axis=0) + wide
    return float(x_min), float(y_min), float(x_max), float(y_max)


def _edge(cells: NDArray) -> NDArray:
    """Return the first and last row and column."""
    return np.concatenate([cells[0], cells[-1], cells[:, 0], cells[:, -1]])


def _opened(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the free cells and the solid ones beside them; none stand for what lies outside."""
    top, left, bottom, right = grid.free_area or (0, 0, *grid.occupied.shape)
    top, left = max(top - 1, 0), max(left - 1, 0)
    cells = np.ascontiguousarray(grid.occupied[top : bottom + 1, left : right + 1])
    x, y = grid.to_world([float(left), float(top)])
    return OccupancyGrid(cells, grid.resolution, (float(x), float(y)), grid.yaw)
