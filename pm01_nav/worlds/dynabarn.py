# SPDX-License-Identifier: Apache-2.0
"""Read DynaBARN (Nair et al., SSRR 2022): worlds of moving cylinders, as one JSON file.

The keys of the file: ``radius`` of all cylinders [m]; ``walls_cx_cy_sx_sy``, upright walls by
centre and size [m]; ``start`` (x, y, yaw) and ``goal`` (x, y); ``worlds``, each with an ``id`` and
the names of its ``obstacles``; ``trajectories``, by name the keys [t, x, y] of one cylinder [s, m].

Between two keys a cylinder moves as Gazebo's PoseAnimation moves it, which is how a ``spline``
mover moves: a cubic Hermite curve in u = (t - t_i) / (t_{i+1} - t_i) with the tangents
(p_{i+1} - p_{i-1}) / 2. At the first and the last key the tangent is half the difference to the
one neighbour there is or, where both keys are the same point, (p_1 - p_{n-2}) / 2. At the time of
the last key it jumps to the first one. A cylinder's tangents are per key, not per second: its speed
changes abruptly where the keys are not evenly spaced.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pydantic import ConfigDict, Field

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_json
from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import World

MARGIN = 1.0
"""Bounds reach this far around walls, start and goal [m]."""


class WorldEntry(FrozenModel):
    """One world."""

    model_config = ConfigDict(extra="ignore")

    id: int = Field(ge=0, le=1_000_000_000)
    obstacles: tuple[str, ...]


class DynaBarnFile(FrozenModel):
    """The keys of the file that matter here; others explain it to people."""

    model_config = ConfigDict(extra="ignore")

    radius: float = Field(gt=0.0)
    walls_cx_cy_sx_sy: tuple[tuple[float, float, float, float], ...]
    start: tuple[float, float, float]
    goal: tuple[float, float]
    worlds: tuple[WorldEntry, ...] = Field(min_length=1, max_length=10_000)
    trajectories: dict[str, tuple[tuple[float, float, float], ...]]


def read_dynabarn(path: str | Path) -> tuple[World, ...]:
    """Read all worlds of a DynaBARN file, in its order, named ``dynabarn_<id>``.

    Raises:
        InputError: the file cannot be read, or a key is missing or wrong.
    """
    path = Path(path)
    file = validate(DynaBarnFile, load_json(path), str(path))
    ids = [entry.id for entry in file.worlds]
    if len(set(ids)) < len(ids):
        raise InputError(f"{path}: worlds: two have the same id")
    try:
        # Worlds share trajectories; a mover is made once.
        movers = {name: _mover(name, keys, file) for name, keys in file.trajectories.items()}
        return tuple(_world(entry, movers, file) for entry in file.worlds)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _mover(name: str, keys: tuple[tuple[float, float, float], ...], file: DynaBarnFile) -> Mover:
    rows = np.array(keys, dtype=np.float64).reshape(-1, 3)
    try:
        return Mover("spline", file.radius, rows[:, 1:].copy(), times=rows[:, 0].copy())
    except InputError as error:
        raise InputError(f"trajectories: {name[:80]}: {error}") from error


def _world(entry: WorldEntry, movers: dict[str, Mover], file: DynaBarnFile) -> World:
    for name in entry.obstacles:
        if name not in movers:
            raise InputError(f"worlds: {entry.id}: obstacle {name[:80]!r}: has no trajectory")
    walls = tuple(rectangle(*wall) for wall in file.walls_cx_cy_sx_sy)
    corners = np.concatenate([*walls, [file.start[:2]], [file.goal]])
    low, high = (corners.min(axis=0) - MARGIN).tolist(), (corners.max(axis=0) + MARGIN).tolist()
    return World(
        f"dynabarn_{entry.id}",
        (low[0], low[1], high[0], high[1]),
        polygons=walls,
        movers=tuple(movers[name] for name in entry.obstacles),
        start=file.start,
        goal_area=(*file.goal, *file.goal),
        # The challenge's script means the same and mistakes a sign.
        reference_length=math.dist(file.start[:2], file.goal),
    )
