# SPDX-License-Identifier: Apache-2.0
"""Many worlds in a few flat arrays, with the places where episodes may start and end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.free_space import FreeSpace, distance_to_occupied, free_space
from pm01_nav.worlds.mover_arrays import pack_movers
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PLACES_PER_WORLD = 1024
"""Starts, and goals, kept of a generated world; the same however many worlds there are."""
MAX_PLACES = 1 << 20
"""Starts, and goals, kept of all worlds from files together."""
MAX_ATTEMPTS = 100


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
    """origin x, y [m], resolution [m], width, height [cells], shape (num_worlds, 5)."""
    starts: FloatArray
    """x, y [m], shape (n, 2)."""
    start_begin: IntArray
    start_yaw: FloatArray
    """Fixed heading [rad]; NaN draws one; shape (num_worlds,)."""
    goals: FloatArray
    """x, y [m], shape (n, 2)."""
    goal_begin: IntArray
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


class Places(NamedTuple):
    """Where episodes in one world may start and end; every start reaches every goal."""

    starts: FloatArray
    goals: FloatArray
    start_yaw: float
    jitter: tuple[float, float]


@dataclass(frozen=True)
class WorldPool:
    """Worlds, packed for the simulator."""

    worlds: tuple[World, ...]
    arrays: WorldArrays
    radius: float
    """Starts, goals and the way between them are free for a disc of this radius [m]."""

    def __len__(self) -> int:
        """Return the number of worlds."""
        return len(self.worlds)

    def free_space(self, index: int) -> FreeSpace:
        """Return the raster of one world on which its places were chosen."""
        return free_space(self.worlds[index], self.radius)


def find_places(world: World, radius: float, rng: np.random.Generator, limit: int) -> Places:
    """Choose where episodes may start and end, for a disc of ``radius`` [m].

    Raises:
        InputError: the world has no free space, its start is not free, or no goal can be reached
            from there.
    """
    space = free_space(world, radius)
    regions = space.regions()
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    if sizes.max() == 0:
        raise InputError(f"world {world.name}: no free space for a robot of radius {radius:.2f} m")
    if world.start is None:
        region = int(sizes.argmax())
    else:
        region = _region_at(space, regions, world.start[0], world.start[1])
        if region == 0:
            raise InputError(f"world {world.name}: its start {world.start} is not in free space")
    limited = slice(limit)
    goals, goal_jitter = _goals(world, radius, space, regions == region, rng)
    if world.start is not None:
        return Places(
            np.array([world.start[:2]]), goals[limited], world.start[2], (0.0, goal_jitter)
        )
    starts, jitter = _places_in(world, radius, space, regions == region, None, rng)
    return Places(starts[limited], goals[limited], np.nan, (jitter, goal_jitter))


def _goals(
    world: World,
    radius: float,
    space: FreeSpace,
    reachable: NDArray[np.bool_],
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    area = world.goal_area
    if area is None or area[:2] != area[2:]:
        goals, jitter = _places_in(world, radius, space, reachable, area, rng)
        if len(goals) == 0:
            raise InputError(f"world {world.name}: no goal in its goal area can be reached")
        return goals, jitter
    if _region_at(space, reachable.astype(np.int32), area[0], area[1]) == 0:
        raise InputError(f"world {world.name}: start and goal are not connected")
    return np.array([area[:2]]), 0.0


def _places_in(
    world: World,
    radius: float,
    space: FreeSpace,
    chosen: NDArray[np.bool_],
    area: tuple[float, float, float, float] | None,
    rng: np.random.Generator,
) -> tuple[FloatArray, float]:
    """Return places in random order (n, 2), and how far around them is as good [m].

    Cells in which the disc is free anywhere; where there are none, the centres of free cells.
    """
    half = space.resolution / 2.0
    roomy = free_space(world, radius + half * np.sqrt(2.0), space.resolution).free
    for cells, jitter in ((chosen & roomy, half), (chosen, 0.0)):
        rows, columns = np.nonzero(cells)
        places = space.centre(rows, columns)
        if area is not None:
            low = np.array(area[:2]) + jitter - 1e-9
            high = np.array(area[2:]) - jitter + 1e-9
            places = places[((places >= low) & (places <= high)).all(axis=1)]
        if len(places):
            return rng.permutation(places), jitter
    return np.zeros((0, 2)), 0.0


def _region_at(space: FreeSpace, regions: NDArray[np.int32], x: float, y: float) -> int:
    """Return the region of a point, or of the nearest free cell within 0.3 m, else 0."""
    cell = space.cell(x, y)
    if cell is None:
        return 0
    if regions[cell]:
        return int(regions[cell])
    rows, columns = np.nonzero(space.free)
    distance = np.linalg.norm(space.centre(rows, columns) - np.array([x, y]), axis=1)
    if len(distance) == 0 or distance.min() > 0.3:
        return 0
    nearest = int(distance.argmin())
    return int(regions[rows[nearest], columns[nearest]])


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
    places = [
        find_places(world, radius, np.random.default_rng([seed, index]), limit)
        for index, world in enumerate(worlds)
    ]
    return WorldPool(tuple(worlds), _pack(worlds, places, random_phase), radius)


def generate_pool(
    generator: Callable[[np.random.Generator], World],
    seeds: Iterable[int],
    radius: float,
    *,
    random_phase: bool = True,
) -> WorldPool:
    """Generate one world a seed and pack them; a draw that nobody can cross is drawn again.

    ``random_phase`` is that of ``build_pool``.

    Raises:
        InputError: a seed gave no usable world in many attempts.
    """
    seeds = list(seeds)
    drawn = [_generate(generator, seed, radius) for seed in seeds]
    worlds = [world for world, _ in drawn]
    arrays = _pack(worlds, [places for _, places in drawn], random_phase)
    return WorldPool(tuple(worlds), arrays, radius)


def _generate(
    generator: Callable[[np.random.Generator], World], seed: int, radius: float
) -> tuple[World, Places]:
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
    grids = [world.grid for world in worlds]
    empty = np.zeros((0,), dtype=np.uint8)
    cells, grid_begin = _stack([g.occupied.ravel() if g else empty for g in grids])
    distance, _ = _stack(
        [distance_to_occupied(g).ravel() if g else empty.astype(np.float32) for g in grids]
    )
    frames = [
        (*g.origin, g.resolution, *g.occupied.shape[::-1]) if g else (0.0,) * 5 for g in grids
    ]
    return WorldArrays(
        discs=discs,
        disc_begin=disc_begin,
        segments=segments,
        segment_begin=segment_begin,
        grid_cells=cells,
        grid_distance=distance,
        grid_begin=grid_begin,
        grid_frame=np.array(frames, dtype=np.float64).reshape(len(worlds), 5),
        starts=starts,
        start_begin=start_begin,
        start_yaw=np.array([p.start_yaw for p in places]),
        goals=goals,
        goal_begin=goal_begin,
        jitter=np.array([p.jitter for p in places]),
        cumulative_weight=np.arange(1, len(worlds) + 1) / len(worlds),
        **pack_movers(worlds, random_phase=random_phase)._asdict(),
    )


def _stack(rows: Sequence[NDArray]) -> tuple[NDArray, IntArray]:
    """Lay arrays end to end; return them and where each one begins, shape (num_arrays + 1,)."""
    begin = np.zeros(len(rows) + 1, dtype=np.int64)
    begin[1:] = np.cumsum([len(r) for r in rows])
    return np.ascontiguousarray(np.concatenate(rows)), begin
