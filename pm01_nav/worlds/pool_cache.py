# SPDX-License-Identifier: Apache-2.0
"""Pools of the suites, kept on disk: what was generated once is read the next time."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from pm01_nav.compilation import cache_folder
from pm01_nav.config import write_atomically
from pm01_nav.errors import InputError
from pm01_nav.worlds.barn import UNREADABLE
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.mover import Motion, Mover
from pm01_nav.worlds.pool import Generator, Places, WorldPool, draw_world, pack_pool
from pm01_nav.worlds.world import World

LEAST_WORLDS = 64
"""Fewer are generated about as fast as they are read."""
MAX_BYTES = 128_000_000
"""Kept at most; 1024 worlds take 9 MB."""

Drawn = list[tuple[World, Places]]
Arrays = dict[str, NDArray[Any]]
MOTIONS: tuple[Motion, ...] = get_args(Motion)


def cached_pool(
    name: str, generator: Generator, seeds: Iterable[int], radius: float, code: str
) -> WorldPool:
    """Generate one world for each seed, or read what an earlier call generated.

    ``name`` tells worlds of one generator, which stands in the file ``code``, from those of
    another.

    Raises:
        InputError: a seed gave no usable world in many attempts.
    """
    seeds = list(seeds)
    if len(seeds) < LEAST_WORLDS:
        return pack_pool([draw_world(generator, seed, radius) for seed in seeds], radius)
    file = cache_folder() / "pools" / f"{_fingerprint(name, seeds, radius, Path(code))}.npz"
    drawn = _read(file)
    if drawn is None:
        drawn = [draw_world(generator, seed, radius) for seed in seeds]
        # Without a cache everything works, only slower.
        with contextlib.suppress(OSError):
            _write(file, drawn)
    return pack_pool(drawn, radius)


def _fingerprint(name: str, seeds: Sequence[int], radius: float, code: Path) -> str:
    """Name a cache entry: another one for other worlds, and for another version of their code."""
    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__} {name} {radius!r}".encode())
    digest.update(np.array(seeds, dtype=np.int64).tobytes())
    folder = Path(__file__).parent
    for source in [folder.parent / "geometry.py", *sorted(folder.rglob("*.py")), code]:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


def _write(file: Path, drawn: Drawn) -> None:
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **_to_arrays(drawn))
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, content.getvalue())
    _remove_oldest(file.parent)


def _remove_oldest(folder: Path) -> None:
    """Remove entries, those first that were written first, until ``MAX_BYTES`` are left."""
    files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime_ns, reverse=True)
    sizes = np.cumsum([file.stat().st_size for file in files])
    for file, size in zip(files, sizes, strict=True):
        if size > MAX_BYTES:
            file.unlink(missing_ok=True)


def _read(file: Path) -> Drawn | None:
    """Return what an earlier call kept, or None if there is nothing readable."""
    try:
        # From memory, because numpy forgets to close the file if it is damaged.
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as entry:
            return _from_arrays(dict(entry))
    except (*UNREADABLE, IndexError, TypeError, InputError):
        return None


def _to_arrays(drawn: Drawn) -> Arrays:
    worlds = [world for world, _ in drawn]
    places = [found for _, found in drawn]
    return {
        "names": np.array([world.name for world in worlds]),
        "bounds": np.array([world.bounds for world in worlds]),
        "start": _optional([world.start for world in worlds], 3),
        "start_area": _optional([world.start_area for world in worlds], 4),
        "goal_area": _optional([world.goal_area for world in worlds], 4),
        **_rows("discs", [world.discs for world in worlds]),
        **_rows("segments", [world.segments for world in worlds]),
        **_rows("polygons", [p for world in worlds for p in world.polygons], 2),
        "num_polygons": np.array([len(world.polygons) for world in worlds]),
        **_mover_arrays([mover for world in worlds for mover in world.movers]),
        "num_movers": np.array([len(world.movers) for world in worlds]),
        "start_yaw": np.array([found.start_yaw for found in places]),
        "jitter": np.array([found.jitter for found in places]),
        **_way_arrays([found.ways for found in places]),
        **_coded("starts", [found.starts for found in places]),
        **_coded("goals", [found.goals for found in places]),
    }


def _way_arrays(ways: list[FreeSpace | None]) -> Arrays:
    frames = [(*way.origin, way.resolution, *way.free.shape) if way else None for way in ways]
    cells = [way.free.ravel() if way else np.zeros(0, dtype=np.bool_) for way in ways]
    laid = _rows("ways", cells)
    return laid | {"ways": np.packbits(laid["ways"]), "way_frames": _optional(frames, 5)}


def _ways(arrays: Arrays) -> Iterator[FreeSpace | None]:
    """Undo ``_way_arrays``."""
    lengths = arrays["ways_length"]
    cells = np.unpackbits(arrays["ways"], count=int(lengths.sum())).view(np.bool_)
    for frame, free in zip(_tuples(arrays["way_frames"]), _parts(cells, lengths), strict=True):
        if frame is None:
            yield None
        else:
            shape = int(frame[3]), int(frame[4])
            yield FreeSpace(free.reshape(shape), frame[2], (frame[0], frame[1]))


def _mover_arrays(movers: list[Mover]) -> Arrays:
    numbers = [(MOTIONS.index(m.motion), m.radius, m.speed, m.heading) for m in movers]
    return {
        "movers": np.array(numbers, dtype=np.float64).reshape(-1, 4),
        **_rows("mover_points", [mover.points for mover in movers], 2),
        **_rows("mover_times", [mover.times[:, None] for mover in movers], 1),
    }


def _from_arrays(arrays: Arrays) -> Drawn:
    polygons = _parts(_split(arrays, "polygons"), arrays["num_polygons"])
    movers = _parts(_movers(arrays), arrays["num_movers"])
    fields = zip(
        arrays["names"].tolist(),
        arrays["bounds"].tolist(),
        _split(arrays, "discs"),
        _split(arrays, "segments"),
        polygons,
        movers,
        *(_tuples(arrays[key]) for key in ("start", "start_area", "goal_area")),
        strict=True,
    )
    worlds = [
        World(
            name,
            tuple(bounds),
            discs=discs,
            segments=segments,
            polygons=tuple(polygons),
            movers=tuple(movers),
            start=start,
            start_area=start_area,
            goal_area=goal_area,
        )
        for name, bounds, discs, segments, polygons, movers, start, start_area, goal_area in fields
    ]
    places = zip(
        _decoded(arrays, "starts"),
        _decoded(arrays, "goals"),
        arrays["start_yaw"].tolist(),
        map(tuple, arrays["jitter"].tolist()),
        _ways(arrays),
        strict=True,
    )
    return [(world, Places(*found)) for world, found in zip(worlds, places, strict=True)]


def _movers(arrays: Arrays) -> list[Mover]:
    points, times = _split(arrays, "mover_points"), _split(arrays, "mover_times")
    return [
        Mover(MOTIONS[int(motion)], radius, where, speed, heading, when[:, 0])
        for (motion, radius, speed, heading), where, when in zip(
            arrays["movers"].tolist(), points, times, strict=True
        )
    ]


def _optional(rows: Sequence[tuple[float, ...] | None], columns: int) -> NDArray[np.float64]:
    """Return one row each, NaN for None."""
    missing = (np.nan,) * columns
    return np.array([missing if row is None else row for row in rows])


def _tuples(rows: NDArray[np.float64]) -> Iterator[tuple[float, ...] | None]:
    """Undo ``_optional``."""
    for row in rows.tolist():
        yield None if np.isnan(row[0]) else tuple(row)


def _rows(key: str, parts: list[NDArray[Any]], columns: int = 0) -> Arrays:
    """Lay arrays end to end; keep how long each is. ``columns`` counts where there may be none."""
    laid = np.concatenate(parts) if parts else np.zeros((0, columns))
    return {key: laid, f"{key}_length": np.array([len(part) for part in parts], dtype=np.int64)}


def _split(arrays: Arrays, key: str) -> list[NDArray[Any]]:
    """Undo ``_rows``."""
    return _parts(arrays[key], arrays[f"{key}_length"])


def _coded(key: str, parts: list[NDArray[np.float64]]) -> Arrays:
    """Keep coordinates as numbers of the few different values that cell centres have."""
    rows = _rows(key, parts)
    values, codes = np.unique(rows[key], return_inverse=True)
    kind = np.uint16 if len(values) <= 1 << 16 else np.uint32
    return rows | {key: codes.reshape(-1, 2).astype(kind), f"{key}_values": values}


def _decoded(arrays: Arrays, key: str) -> list[NDArray[np.float64]]:
    """Undo ``_coded``."""
    return _parts(arrays[f"{key}_values"][arrays[key]], arrays[f"{key}_length"])


def _parts(rows: Any, lengths: NDArray[np.int64]) -> list[Any]:
    """Cut rows (an array or a list) into parts of the given lengths.

    Raises:
        ValueError: the lengths do not add up to the rows there are.
    """
    ends = np.cumsum(lengths).tolist()
    if (ends[-1] if ends else 0) != len(rows) or (lengths < 0).any():
        raise ValueError(f"{len(rows)} rows for parts of {ends[-1] if ends else 0}")
    return [rows[end - length : end] for end, length in zip(ends, lengths.tolist(), strict=True)]
