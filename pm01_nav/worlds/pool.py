# SPDX-License-Identifier: Apache-2.0
"""Many worlds in a few flat arrays, with the places where episodes may start and end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.free_space import FreeSpace, distance_to_occupied, free_space
from pm01_nav.worlds.mover_arrays import pack_movers
from pm01_nav.worlds.views import Views, list_everything, list_views
from pm01_nav.worlds.world import OccupancyGrid, World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Generator = Callable[[np.random.Generator], World]

PLACES_PER_WORLD = 1024
"""Starts, and goals, kept of a generated world; the same however many worlds there are."""
MAX_PLACES = 1 << 20
"""Starts, and goals, kept of all worlds from files together."""
MAX_SPACES = 512
"""Rasters of worlds kept at most; of generated worlds each one serves for one episode."""
MAX_ATTEMPTS = 100
WAY_RESOLUTION, MAX_WAY_RESOLUTION = 0.2, 0.4
"""Side of a cell of the raster for path distances [m]: usual, and greatest."""
MAX_WAY_CELLS = 1 << 14


class WorldArrays(NamedTuple):
    """A pool as the kernels read it; world w owns rows ``begin[w]`` to ``begin[w + 1]``."""

    discs: FloatArray
    """x, y, radius [m], shape (n, 3)."""
    disc_begin: IntArray
    segments: FloatArray
    """x1, y1, x2, y2 [m], shape (n, 4)."""
    segment_begin: IntArray
    grid_cells: NDArray[np.uint8]
    """1 = solid, row by row, shape (n,)."""
    grid_distance: NDArray[np.float32]
    """Distance to the nearest solid cell's centre [cells], shape (n,)."""
    grid_begin: IntArray
    grid_frame: FloatArray
    """origin x, y [m], resolution [m], width, height [cells], cosine and sine of the yaw.

    Shape (num_worlds, 7).
    """
    starts: FloatArray
    """x, y [m], shape (n, 2)."""
    start_begin: IntArray
    start_yaw: FloatArray
    """Fixed heading [rad]; NaN draws one; shape (num_worlds,)."""
    goals: FloatArray
    """x, y [m], shape (n, 2)."""
    goal_begin: IntArray
    way_cells: NDArray[np.uint8]
    """1 = the robot fits and a start reaches it, row by row with a closed border, shape (n,)."""
    way_begin: IntArray
    way_frame: FloatArray
    """Like ``grid_frame`` less the yaw; a world too large for cells of 0.4 m has none."""
    jitter: FloatArray
    """Half the side of the square around a start, and a goal, to draw from [m], (num_worlds, 2)."""
    cumulative_weight: FloatArray
    """Probability of drawing this world or an earlier one, shape (num_worlds,)."""
    # The fields of ``MoverArrays``: parallel loops of numba take no tuple within a tuple.
    mover_begin: IntArray
    mover_kind: IntArray
    mover_radius: FloatArray
    mover_speed: FloatArray
    mover_direction: FloatArray
    mover_period: FloatArray
    mover_jumps: NDArray[np.bool_]
    mover_points: FloatArray
    mover_point_begin: IntArray
    mover_places: FloatArray
    mover_place_begin: IntArray
    bounds: FloatArray
    mover_random_phase: bool
    # The fields of ``Views``.
    view_range: float
    view_frame: FloatArray
    view_begin: IntArray
    seen_segments: NDArray[np.int32]
    seen_segment_begin: IntArray
    seen_discs: NDArray[np.int32]
    seen_disc_begin: IntArray


class Places(NamedTuple):
    """Where episodes in one world may start and end; every start reaches every goal."""

    starts: FloatArray
    goals: FloatArray
    start_yaw: float
    jitter: tuple[float, float]
    ways: FreeSpace | None
    """Where the robot gets to from the starts, on a coarse raster; None in a very large world."""


@dataclass(frozen=True)
class WorldPool:
    """Worlds, packed for the simulator."""

    worlds: Sequence[World]
    arrays: WorldArrays
    radius: float
    """Starts, goals and the way between them are free for a disc of this radius [m]."""
    look: Callable[[Sequence[World], float], Views] = field(
        default=list_views, repr=False, compare=False
    )
    """Lists what is seen up to a range [m], or knows it from an earlier time."""
    _seen: dict[float, Views] = field(default_factory=dict, repr=False, compare=False)
    _spaces: dict[int, FreeSpace] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        """Return the number of worlds."""
        return len(self.worlds)

    def arrays_for(self, view_range: float) -> WorldArrays:
        """Return ``arrays`` with lists of what a lidar sees up to ``view_range`` [m].

        All but the lists are shared.
        """
        if view_range not in self._seen:
            self._seen[view_range] = self.look(self.worlds, view_range)
        return self.arrays._replace(**self._seen[view_range]._asdict())

    def free_space(self, index: int) -> FreeSpace:
        """Return the raster of one world on which its places were chosen."""
        if index not in self._spaces:
            if len(self._spaces) == MAX_SPACES:
                self._spaces.pop(next(iter(self._spaces)))
            self._spaces[index] = free_space(self.worlds[index], self.radius)
        return self._spaces[index]

    def set_weights(self, weights: FloatArray) -> None:
        """Draw worlds in proportion to ``weights`` (num_worlds,) from the next reset on.

        Raises:
            ValueError: a weight is negative or not finite, or none is positive.
        """
        if weights.shape != (len(self),) or not np.isfinite(weights).all() or (weights < 0).any():
            raise ValueError(f"weights must be {len(self)} finite numbers, none below 0")
        cumulative = np.cumsum(weights)
        if cumulative[-1] <= 0.0:
            raise ValueError("one weight at least must be positive")
        # Divided by its own last number it ends with exactly 1, and no draw from U[0, 1) falls
        # beyond it.
        self.arrays.cumulative_weight[:] = cumulative / cumulative[-1]


def find_places(world: World, radius: float, rng: np.random.Generator, limit: int) -> Places:
    """Choose where episodes may start and end, for a disc of ``radius`` [m].

    Raises:
        InputError: the world has no free space, its start is not free, or no goal can be reached
            from there.
    """
    space = free_space(world, radius)
    if not space.free.any():
        raise InputError(f"world {world.name}: no free space for a robot of radius {radius:.2f} m")
    connected = _connected_to_start(world, space)
    half = space.resolution / 2.0
    # In a roomy cell the disc is free wherever in it the centre is.
    roomy = free_space(world, radius + half * np.sqrt(2.0), space.resolution).free
    choice = _Choice(space, connected, connected & roomy, rng, limit)
    goals, goal_jitter = _goals(world, choice)
    if world.start is not None:
        start = np.array([world.start[:2]])
        return Places(start, goals, world.start[2], (0.0, goal_jitter), _ways(space, connected))
    starts, jitter = choice.places(world.start_area)
    return Places(starts, goals, np.nan, (jitter, goal_jitter), _ways(space, connected))


def _ways(space: FreeSpace, connected: NDArray[np.bool_]) -> FreeSpace | None:
    """Return a raster small enough to spread distances over it in each episode."""
    factor = max(round(WAY_RESOLUTION / space.resolution), 1)
    while connected.size > MAX_WAY_CELLS * factor**2:
        factor += 1
    if factor * space.resolution > MAX_WAY_RESOLUTION:
        return None
    return replace(space, free=connected).coarsened(factor)


def _connected_to_start(world: World, space: FreeSpace) -> NDArray[np.bool_]:
    """Return the cells that are connected to the start, or to most of those it may be drawn from.

    Same shape as ``space.free``, of which at least one cell is free.
    """
    regions = space.regions()
    if world.start is not None:
        region = _region_at(space, regions, world.start[0], world.start[1])
        if region == 0:
            raise InputError(f"world {world.name}: its start {world.start} is not in free space")
        return regions == region
    eligible = regions
    if world.start_area is not None:
        eligible = np.where(space.within(world.start_area), regions, 0)
    sizes = np.bincount(eligible.ravel())
    sizes[0] = 0
    if sizes.max() == 0:
        raise InputError(f"world {world.name}: no start in its start area is in free space")
    return regions == sizes.argmax()


def _goals(world: World, choice: _Choice) -> tuple[FloatArray, float]:
    area = world.goal_area
    if area is None or area[:2] != area[2:]:
        goals, jitter = choice.places(area)
        if len(goals) == 0:
            raise InputError(f"world {world.name}: no goal in its goal area can be reached")
        return goals, jitter
    regions = choice.connected.astype(np.int32)
    if _region_at(choice.space, regions, area[0], area[1]) == 0:
        raise InputError(f"world {world.name}: start and goal are not connected")
    return np.array([area[:2]]), 0.0


@dataclass(frozen=True)
class _Choice:
    """Draws places from the cells that are connected to the start."""

    space: FreeSpace
    connected: NDArray[np.bool_]
    roomy: NDArray[np.bool_]
    """Those of them in which the disc is free anywhere."""
    rng: np.random.Generator
    limit: int

    def places(self, area: tuple[float, float, float, float] | None) -> tuple[FloatArray, float]:
        """Return places in random order (n, 2), and how far around them is as good [m].

        From roomy cells within ``area``; where there are none, the centres of others.
        """
        for cells, jitter in ((self.roomy, self.space.resolution / 2.0), (self.connected, 0.0)):
            chosen = cells if area is None else cells & self.space.within(area, jitter)
            rows, columns = np.nonzero(chosen)
            if len(rows):
                order = self.rng.permutation(len(rows))[: self.limit]
                return self.space.centre(rows[order], columns[order]), jitter
        return np.zeros((0, 2)), 0.0


def _region_at(space: FreeSpace, regions: NDArray[np.int32], x: float, y: float) -> int:
    """Return the region of a point, or of the nearest free cell within 0.3 m, else 0."""
    cell = None if space.cell(x, y) is None else space.nearest_free(x, y, within=0.3)
    return 0 if cell is None else int(regions[cell])


def build_pool(
    worlds: Sequence[World], radius: float, seed: int = 0, *, random_phase: bool = True
) -> WorldPool:
    """Pack worlds for a robot that needs a disc of ``radius`` [m] to pass.

    With ``random_phase`` an episode finds movers on loops and splines at a random time of their
    round, else at its beginning.

    Raises:
        InputError: a world has no start from which a goal can be reached.
    """
    limit = max(MAX_PLACES // max(len(worlds), 1), 64)
    drawn = [
        (world, find_places(world, radius, np.random.default_rng([seed, index]), limit))
        for index, world in enumerate(worlds)
    ]
    return pack_pool(drawn, radius, random_phase=random_phase)


def generate_pool(generator: Generator, seeds: Iterable[int], radius: float) -> WorldPool:
    """Generate one world a seed and pack them; a draw that nobody can cross is drawn again.

    Raises:
        InputError: a seed gave no usable world in many attempts.
    """
    return pack_pool([draw_world(generator, seed, radius) for seed in seeds], radius)


def pack_pool(
    drawn: Sequence[tuple[World, Places]], radius: float, *, random_phase: bool = True
) -> WorldPool:
    """Pack worlds with places that were found for a disc of ``radius`` [m].

    ``random_phase`` is that of ``build_pool``.
    """
    worlds = [world for world, _ in drawn]
    arrays = _pack(worlds, [places for _, places in drawn], random_phase)
    return WorldPool(tuple(worlds), arrays, radius)


def draw_world(generator: Generator, seed: int, radius: float) -> tuple[World, Places]:
    """Draw one world and where episodes in it may start and end; see ``generate_pool``.

    Raises:
        InputError: the seed gave no usable world in many attempts.
    """
    problem: InputError | None = None
    for attempt in range(MAX_ATTEMPTS):
        world = generator(np.random.default_rng([seed, attempt]))
        try:
            rng = np.random.default_rng([seed])
            return world, find_places(world, radius, rng, PLACES_PER_WORLD)
        except InputError as error:
            problem = error
    raise InputError(f"world seed {seed}: nothing usable in {MAX_ATTEMPTS} draws: {problem}")


def _pack(worlds: Sequence[World], places: Sequence[Places], random_phase: bool) -> WorldArrays:
    discs, disc_begin = _stack([world.discs for world in worlds])
    segments, segment_begin = _stack([world.all_segments for world in worlds])
    starts, start_begin = _stack([p.starts for p in places])
    goals, goal_begin = _stack([p.goals for p in places])
    return WorldArrays(
        discs=discs,
        disc_begin=disc_begin,
        segments=segments,
        segment_begin=segment_begin,
        **_pack_grids([world.grid for world in worlds]),
        **_pack_ways([p.ways for p in places]),
        starts=starts,
        start_begin=start_begin,
        start_yaw=np.array([p.start_yaw for p in places]),
        goals=goals,
        goal_begin=goal_begin,
        jitter=np.array([p.jitter for p in places]),
        cumulative_weight=np.arange(1, len(worlds) + 1) / len(worlds),
        **pack_movers(worlds, random_phase=random_phase)._asdict(),
        **list_everything(segment_begin, disc_begin)._asdict(),
    )


NO_CELLS = np.zeros(0, dtype=np.uint8)


def _pack_grids(grids: Sequence[OccupancyGrid | None]) -> dict[str, NDArray]:
    known = [grid.known if grid else None for grid in grids]
    cells, begin = _stack([g.occupied.ravel() if g else NO_CELLS for g in known])
    distances = [distance_to_occupied(g).ravel() if g else NO_CELLS for g in known]
    frames = _frames([(g.origin, g.resolution, g.occupied) if g else None for g in known])
    directions = [g.direction if g else (1.0, 0.0) for g in known]
    return {
        "grid_cells": cells,
        "grid_distance": np.concatenate(distances).astype(np.float32),
        "grid_begin": begin,
        "grid_frame": np.concatenate([frames, np.reshape(directions, (-1, 2))], axis=1),
    }


def _pack_ways(ways: Sequence[FreeSpace | None]) -> dict[str, NDArray]:
    cells, begin = _stack([w.free.ravel().view(np.uint8) if w else NO_CELLS for w in ways])
    return {
        "way_cells": cells,
        "way_begin": begin,
        "way_frame": _frames([(w.origin, w.resolution, w.free) if w else None for w in ways]),
    }


def _frames(rasters: Sequence[tuple[tuple[float, float], float, NDArray] | None]) -> FloatArray:
    """Return origin x, y, resolution, width and height of each raster, zeros for None."""
    rows = [(*r[0], r[1], *r[2].shape[::-1]) if r else (0.0,) * 5 for r in rasters]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 5)


def _stack(rows: Sequence[NDArray]) -> tuple[NDArray, IntArray]:
    """Lay arrays end to end; return them and where each one begins, shape (num_arrays + 1,)."""
    begin = np.zeros(len(rows) + 1, dtype=np.int64)
    begin[1:] = np.cumsum([len(r) for r in rows])
    return np.ascontiguousarray(np.concatenate(rows)), begin
