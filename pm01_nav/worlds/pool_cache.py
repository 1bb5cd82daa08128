# SPDX-License-Identifier: Apache-2.0
"""Pools of the suites, kept on disk: what was generated once is read the next time."""

from __future__ import annotations

import contextlib
import hashlib
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, get_args, overload

import numpy as np
import scipy
from numpy.typing import NDArray

from pm01_nav.compilation import cache_folder
from pm01_nav.config import write_atomically
from pm01_nav.worlds.barn import UNREADABLE
from pm01_nav.worlds.mover import Motion, Mover
from pm01_nav.worlds.pool import Generator, WorldArrays, WorldPool, draw_world, pack_pool
from pm01_nav.worlds.views import Views, list_everything, list_views
from pm01_nav.worlds.world import World

LEAST_WORLDS = 64
"""Fewer are generated about as fast as they are read."""
MAX_BYTES = 256_000_000
"""Kept at most; 1024 worlds take 20 MB with what is seen of them."""
PACKED = "packed_"
"""Before the names of a pool's arrays, in an entry."""
DIGEST_BYTES = 32
"""Of the SHA-256 at the end of an entry."""

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
    pool = _kept_pool(file, radius)
    if pool is None:
        pool = pack_pool([draw_world(generator, seed, radius) for seed in seeds], radius)
        _write(file, _to_arrays(pool))
    return replace(pool, look=partial(_kept_views, file))


def _fingerprint(name: str, seeds: Sequence[int], radius: float, code: Path) -> str:
    """Name a cache entry: another one for other worlds, and for another version of their code."""
    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__} {name} {radius!r}".encode())
    digest.update(np.array(seeds, dtype=np.int64).tobytes())
    folder = Path(__file__).parent
    for source in [folder.parent / "geometry.py", *sorted(folder.rglob("*.py")), code]:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:32]


def _kept_pool(file: Path, radius: float) -> WorldPool | None:
    """Return what an earlier call kept, or None if there is nothing whole."""
    arrays = _read(file)
    return None if arrays is None else _from_arrays(arrays, radius)


def _kept_views(file: Path, worlds: Sequence[World], view_range: float) -> Views:
    """Return ``list_views`` of the pool in ``file``, or what an earlier call kept of it."""
    beside = file.with_name(f"{file.stem}-{view_range!r}.npz")
    arrays = _read(beside)
    if arrays is None:
        views = list_views(worlds, view_range)
        kept = views._asdict()
        del kept["view_range"]
        _write(beside, kept)
        return views
    return Views(view_range, **arrays)


def _write(file: Path, arrays: Arrays) -> None:
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    whole = content.getvalue()
    # Without a cache everything works, only slower.
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, whole + hashlib.sha256(whole).digest())
        _remove_oldest(file.parent)


def _remove_oldest(folder: Path) -> None:
    """Remove entries, those first that were written first, until ``MAX_BYTES`` are left."""
    files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime_ns, reverse=True)
    sizes = np.cumsum([file.stat().st_size for file in files])
    for file, size in zip(files, sizes, strict=True):
        if size > MAX_BYTES:
            file.unlink(missing_ok=True)


def _read(file: Path) -> Arrays | None:
    """Return the arrays of an entry, or None if there is none, or not exactly what was written.

    Kernels trust them without a look, so that a damaged entry must not get to them.
    """
    try:
        content = file.read_bytes()
        whole = content[:-DIGEST_BYTES]
        if hashlib.sha256(whole).digest() != content[-DIGEST_BYTES:]:
            return None
        with np.load(io.BytesIO(whole), allow_pickle=False) as entry:
            return dict(entry)
    except UNREADABLE:
        return None


def _to_arrays(pool: WorldPool) -> Arrays:
    worlds, packed = pool.worlds, pool.arrays._asdict()
    for name in ("starts", "goals", "way_cells", "mover_random_phase", *Views._fields):
        del packed[name]
    return {
        **{f"{PACKED}{name}": array for name, array in packed.items()},
        **_coded("starts", pool.arrays.starts),
        **_coded("goals", pool.arrays.goals),
        "ways": np.packbits(pool.arrays.way_cells),
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
    }


def _from_arrays(arrays: Arrays, radius: float) -> WorldPool:
    """Undo ``_to_arrays``."""
    packed = {n.removeprefix(PACKED): a for n, a in arrays.items() if n.startswith(PACKED)}
    cells = np.unpackbits(arrays["ways"], count=int(packed["way_begin"][-1]))
    everything = list_everything(packed["segment_begin"], packed["disc_begin"])
    pool_arrays = WorldArrays(
        **packed,
        starts=_decoded(arrays, "starts"),
        goals=_decoded(arrays, "goals"),
        way_cells=cells,
        mover_random_phase=True,
        **everything._asdict(),
    )
    return WorldPool(_KeptWorlds(arrays), pool_arrays, radius)


class _KeptWorlds(Sequence[World]):
    """The worlds of an entry, made when somebody looks at one: to train nobody needs to."""

    def __init__(self, arrays: Arrays) -> None:
        self._arrays = arrays

    @cached_property
    def _worlds(self) -> list[World]:
        return _worlds(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays["names"])

    @overload
    def __getitem__(self, index: int) -> World: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[World]: ...

    def __getitem__(self, index: int | slice) -> World | Sequence[World]:
        return self._worlds[index]


def _mover_arrays(movers: list[Mover]) -> Arrays:
    numbers = [(MOTIONS.index(m.motion), m.radius, m.speed, m.heading) for m in movers]
    return {
        "movers": np.array(numbers, dtype=np.float64).reshape(-1, 4),
        **_rows("mover_points", [mover.points for mover in movers], 2),
        **_rows("mover_times", [mover.times[:, None] for mover in movers], 1),
    }


def _worlds(arrays: Arrays) -> list[World]:
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
    return [
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


def _coded(key: str, places: NDArray[np.float64]) -> Arrays:
    """Keep coordinates as numbers of the few different values that cell centres have."""
    values, codes = np.unique(places, return_inverse=True)
    kind = np.uint16 if len(values) <= 1 << 16 else np.uint32
    return {key: codes.reshape(-1, 2).astype(kind), f"{key}_values": values}


def _decoded(arrays: Arrays, key: str) -> NDArray[np.float64]:
    """Undo ``_coded``."""
    return arrays[f"{key}_values"].take(arrays[key])


def _parts(rows: Any, lengths: NDArray[np.int64]) -> list[Any]:
    """Cut rows (an array or a list) into parts of the given lengths.

    Raises:
        ValueError: the lengths do not add up to the rows there are.
    """
    ends = np.cumsum(lengths).tolist()
    if (ends[-1] if ends else 0) != len(rows) or (lengths < 0).any():
        raise ValueError(f"{len(rows)} rows for parts of {ends[-1] if ends else 0}")
    return [rows[end - length : end] for end, length in zip(ends, lengths.tolist(), strict=True)]
