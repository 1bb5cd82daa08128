# SPDX-License-Identifier: Apache-2.0
"""Read the worlds of the BARN dataset (Perille et al., SSRR 2020) in their original layout."""

from __future__ import annotations

import contextlib
import hashlib
import io
import math
import re
import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import cache_folder
from pm01_nav.config import write_atomically
from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

# The start and the goal of the BARN challenge (its run.py, since 2024-02-04).
START = (-2.25, 3.0, 1.57)
GOAL = (-2.25, 13.0)
# 1 m around the cylinders (x -4.5 to 0, y 0 to 9.6) and the goal. Above the side walls, from
# y = 9.6 on, the robot may swerve past x = -4.5 and x = 0.
BOUNDS = (-5.5, -1.0, 1.0, 14.0)

# What numpy and zipfile raise on damaged files; a RuntimeError is a wrongly set encryption bit.
UNREADABLE = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    tokenize.TokenError,
    MemoryError,
    OverflowError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True)
class BarnSet:
    """The worlds of a BARN folder, sorted by index, which runs from easy to hard."""

    indices: tuple[int, ...]
    worlds: tuple[World, ...]
    """Each with the length of its official reference path."""


class _Pose(NamedTuple):
    x: float
    y: float
    yaw: float

    def apply(self, inner: _Pose) -> _Pose:
        """Express in our parent's frame a pose given in our own."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x = self.x + cos * inner.x - sin * inner.y
        y = self.y + sin * inner.x + cos * inner.y
        return _Pose(x, y, self.yaw + inner.yaw)


def load_barn(folder: str | Path) -> BarnSet:
    """Read all worlds and path lengths below a folder; the result is kept for the next time.

    Raises:
        InputError: the folder has no worlds, or one of its files is missing or wrong.
    """
    folder = Path(folder)
    worlds = _files_by_index(folder, "world_*.world")
    if not worlds:
        raise InputError(f"{folder}: holds no BARN worlds; expected files world_<i>.world below it")
    paths = _files_by_index(folder, "path_files/path_*.npy")
    for index in worlds:
        if index not in paths:
            raise InputError(f"{folder}: path_files/path_{index}.npy is missing")
    files = [*worlds.values(), *(paths[index] for index in worlds)]
    cache = cache_folder() / "barn" / f"{_fingerprint(files)}.npz"
    cached = _read_cache(cache)
    if cached is not None:
        return cached
    indices = tuple(worlds)
    read = (
        replace(read_barn_world(worlds[index]), reference_length=read_path_length(paths[index]))
        for index in indices
    )
    barn = BarnSet(indices, tuple(read))
    # Without a cache everything works, only slower.
    with contextlib.suppress(OSError):
        _write_cache(cache, barn)
    return barn


def read_barn_world(path: str | Path) -> World:
    """Read the cylinders of one ``world_<i>.world`` as discs.

    Raises:
        InputError: the file is no whole Gazebo world, or holds anything but upright cylinders.
    """
    path = Path(path)
    index = _index(path)
    if index is None:
        raise InputError(f"{path}: must be named world_<i>.world")
    world = parse_xml(path).find("world")
    if world is None:
        raise InputError(f"{path}: must hold <world> inside <sdf>")
    # <state> repeats the poses of the models and is not read.
    rows = [row for model in world.findall("model") for row in _cylinders(model, path)]
    for include in world.findall("include"):
        uri = (include.findtext("uri") or "").strip()
        if uri not in ("model://sun", "model://ground_plane"):
            raise InputError(f"{path}: include {uri!r}: only cylinders can be obstacles")
    if not rows:
        raise InputError(f"{path}: holds no cylinder")
    return _world(index, np.array(rows))


def _world(index: int, discs: FloatArray, length: float = math.nan) -> World:
    return World(
        f"barn_{index}",
        BOUNDS,
        discs=discs,
        start=START,
        goal_area=(*GOAL, *GOAL),
        reference_length=length,
    )


def _index(path: Path) -> int | None:
    match = re.fullmatch(r"(?:world_([0-9]{1,9})\.world)|(?:path_([0-9]{1,9})\.npy)", path.name)
    return int(match[1] or match[2]) if match else None


def _files_by_index(folder: Path, pattern: str) -> dict[int, Path]:
    """Find files wherever they lie below a folder, sorted by the number in their names."""
    if not folder.is_dir():
        raise InputError(f"{folder}: must be an existing folder with the BARN dataset")
    found: dict[int, Path] = {}
    for path in sorted(folder.rglob(pattern)):
        index = _index(path)
        if index is not None and index in found:
            raise InputError(f"{folder}: holds two files {path.name}: {found[index]} and {path}")
        if index is not None:
            found[index] = path
    return dict(sorted(found.items()))


def _cylinders(model: Element, path: Path) -> Iterable[tuple[float, float, float]]:
    """Yield x, y, radius [m] of each cylinder that the model collides with."""
    where = f"{path}: model {model.get('name')!r}"
    if model.find("model") is not None or model.find("include") is not None:
        raise InputError(f"{where}: must not hold another model; only cylinders can be obstacles")
    for link in model.iterfind("link"):
        for collision in link.iterfind("collision"):
            shape = collision.find("geometry/*")
            kind = "nothing" if shape is None else shape.tag
            if kind == "plane":
                continue  # The ground.
            if shape is None or kind != "cylinder":
                raise InputError(f"{where}: must be made of cylinders, not of {kind}")
            pose = _pose(model, where).apply(_pose(link, where)).apply(_pose(collision, where))
            (radius,) = _numbers(shape.find("radius"), 1, f"{where}: radius")
            if radius <= 0.0:
                raise InputError(f"{where}: radius = {radius}: must be above 0")
            if not (BOUNDS[0] < pose.x < BOUNDS[2] and BOUNDS[1] < pose.y < BOUNDS[3]):
                place = f"({pose.x:.6g}, {pose.y:.6g})"
                raise InputError(f"{where}: pose = {place}: must lie within {BOUNDS}")
            yield pose.x, pose.y, radius


def _pose(element: Element, where: str) -> _Pose:
    pose = element.find("pose")
    if pose is None:
        return _Pose(0.0, 0.0, 0.0)
    if pose.get("frame") or pose.get("relative_to"):
        raise InputError(f"{where}: pose: must not be relative to another frame")
    x, y, _, roll, pitch, yaw = _numbers(pose, 6, f"{where}: pose")
    if roll != 0.0 or pitch != 0.0:
        raise InputError(f"{where}: pose: must be upright, roll and pitch 0")
    return _Pose(x, y, yaw)


def _numbers(element: Element | None, count: int, where: str) -> list[float]:
    text = "" if element is None else " ".join((element.text or "").split())
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{where} = {text[:80]!r}: must be {count} finite number(s)")
    return numbers


def read_path_length(path: Path) -> float:
    """Return the official length of a world's reference path [m]: start, cells, goal.

    Raises:
        InputError: the file is no array of cells.
    """
    try:
        cells = np.load(path, mmap_mode="r", allow_pickle=False)
    except UNREADABLE as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: must be a whole .npy array: {reason}") from error
    if not isinstance(cells, np.ndarray) or cells.shape != (cells.size // 2, 2) or not cells.size:
        raise InputError(f"{path}: must be one array of cells, shape (n, 2) with n >= 1")
    if cells.dtype.kind not in "iuf" or not (np.abs(cells.astype(np.float64)) <= 1000.0).all():
        raise InputError(f"{path}: must hold rows and columns, numbers between -1000 and 1000")
    # The offsets are the challenge's own. They lie (-0.15, -0.10) m beside the true cells.
    way = np.array([-4.575, 5.075]) + 0.15 * cells.astype(np.float64)
    way = np.concatenate([[START[:2]], way, [GOAL]])
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def _fingerprint(files: Iterable[Path]) -> str:
    """Name a cache entry: another name for other files, and for another version of this reader."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in files:
        status = path.stat()
        digest.update(f"{path.resolve()}\0{status.st_size}\0{status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:32]


def _write_cache(cache: Path, barn: BarnSet) -> None:
    content = io.BytesIO()
    np.savez_compressed(
        content,
        indices=np.array(barn.indices),
        num_discs=np.array([len(world.discs) for world in barn.worlds]),
        discs=np.concatenate([world.discs for world in barn.worlds]),
        path_lengths=np.array([world.reference_length for world in barn.worlds]),
    )
    cache.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(cache, content.getvalue())


def _read_cache(cache: Path) -> BarnSet | None:
    """Return what an earlier call kept, or None if there is nothing readable."""
    try:
        # From memory, because numpy forgets to close the file if it is damaged.
        with np.load(io.BytesIO(cache.read_bytes()), allow_pickle=False) as file:
            discs = np.split(file["discs"], np.cumsum(file["num_discs"])[:-1])
            indices = tuple(int(index) for index in file["indices"])
            rows = zip(indices, discs, file["path_lengths"].tolist(), strict=True)
            return BarnSet(indices, tuple(_world(*row) for row in rows))
    except UNREADABLE:
        return None
