# SPDX-License-Identifier: Apache-2.0
"""Worlds as YAML that a person can write: obstacles, movers, bounds, start and goal area."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field

from pm01_nav.config import FrozenModel, validate, write_atomically
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Motion, Mover
from pm01_nav.worlds.ros_map import read_ros_map
from pm01_nav.worlds.ros_map_writer import write_grid
from pm01_nav.worlds.world import World

Point = tuple[float, float]
Positive = Annotated[float, Field(gt=0.0)]
Area = tuple[float, float, float, float]


class BoxEntry(FrozenModel):
    """A turned rectangle."""

    x: float
    """Of the centre [m]."""
    y: float
    length: Positive
    """Along x before it is turned [m]."""
    width: Positive
    yaw: float = 0.0
    """Counter-clockwise [rad]."""


class MoverEntry(FrozenModel):
    """A moving disc; see ``Mover``."""

    motion: Motion
    radius: Positive
    points: tuple[Point, ...]
    speed: float = 0.0
    heading: float = 0.0
    times: tuple[float, ...] = ()


class WorldFile(FrozenModel):
    """The keys of a world's YAML file. Lengths in metres, angles in radians."""

    name: str | None = None
    """The file's name without its ending, if not given."""
    bounds: Area | None = None
    """x_min, y_min, x_max, y_max; the map's extent, if there is a map and no bounds."""
    start: tuple[float, float, float] | None = None
    """x, y, yaw."""
    start_area: Area | None = None
    goal_area: Area | None = None
    """x_min, y_min, x_max, y_max."""
    discs: tuple[tuple[float, float, float], ...] = ()
    """x, y, radius."""
    boxes: tuple[BoxEntry, ...] = ()
    polygons: tuple[tuple[Point, ...], ...] = ()
    segments: tuple[tuple[float, float, float, float], ...] = ()
    """x1, y1, x2, y2."""
    map: str | None = Field(default=None, min_length=1)
    """A ROS map's YAML, relative to this file."""
    movers: tuple[MoverEntry, ...] = ()


def read_yaml_world(path: str | Path) -> World:
    """Read a world and the map that it names.

    Raises:
        InputError: a key, or the map, is missing or wrong.
    """
    path = Path(path)
    file = validate(WorldFile, load_yaml(path), str(path))
    grid_world = None if file.map is None else read_ros_map(path.parent / file.map)
    bounds = file.bounds or (None if grid_world is None else grid_world.bounds)
    if bounds is None:
        raise InputError(f"{path}: bounds: is missing; give x_min, y_min, x_max, y_max or a map")
    boxes = [rectangle(b.x, b.y, b.length, b.width, b.yaw) for b in file.boxes]
    try:
        return World(
            path.stem if file.name is None else file.name,
            bounds,
            discs=np.array(file.discs, dtype=np.float64).reshape(-1, 3),
            polygons=(*map(_points, file.polygons), *boxes),
            segments=np.array(file.segments, dtype=np.float64).reshape(-1, 4),
            grid=None if grid_world is None else grid_world.grid,
            movers=tuple(_mover(mover, f"movers[{k}]") for k, mover in enumerate(file.movers)),
            start=file.start,
            start_area=file.start_area,
            goal_area=file.goal_area,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _points(points: tuple[Point, ...]) -> np.ndarray:
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _mover(entry: MoverEntry, name: str) -> Mover:
    values = entry.model_dump()
    values["points"] = _points(entry.points)
    values["times"] = np.array(entry.times, dtype=np.float64)
    try:
        return Mover(**values)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def write_yaml_world(world: World, path: str | Path) -> None:
    """Write a world as YAML, its grid as a ROS map ``<name>_map.yaml`` and a pgm beside it.

    Raises:
        InputError: no cell of the grid is free.
    """
    path = Path(path)
    map_name = None
    if world.grid is not None:
        map_name = f"{path.stem}_map.yaml"
        write_grid(world.grid, path.with_name(map_name))
    write_atomically(path, world_to_yaml(world, map_name))


def world_to_yaml(world: World, map_name: str | None = None) -> str:
    """Return a world's YAML text, from which ``read_yaml_world`` makes the same world.

    ``map_name`` is where the grid is written, relative to the YAML file.

    Raises:
        InputError: the world has a grid and ``map_name`` is not given.
    """
    if world.grid is not None and map_name is None:
        raise InputError(f"world {world.name}: its grid does not fit into YAML; write it as a map")
    data: dict[str, Any] = {"name": world.name, "bounds": _floats(world.bounds)}
    if world.start is not None:
        data["start"] = _floats(world.start)
    for name in ("start_area", "goal_area"):
        if (area := getattr(world, name)) is not None:
            data[name] = _floats(area)
    if map_name is not None:
        data["map"] = map_name
    data["discs"] = [_floats(row) for row in world.discs]
    data["polygons"] = [[_floats(point) for point in polygon] for polygon in world.polygons]
    data["segments"] = [_floats(row) for row in world.segments]
    data["movers"] = [_mover_entry(mover) for mover in world.movers]
    kept = {key: value for key, value in data.items() if value != []}
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    # The style None: a row of numbers takes one line, everything else lines of its own.
    return yaml.dump(
        kept,
        Dumper=dumper,
        sort_keys=False,
        allow_unicode=True,
        width=1000,
        default_flow_style=None,
    )


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]


def _mover_entry(mover: Mover) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "motion": mover.motion,
        "radius": float(mover.radius),
        "points": [_floats(point) for point in mover.points],
        "speed": float(mover.speed),
        "heading": float(mover.heading),
        "times": _floats(mover.times),
    }
    # By their texts, because -0.0 equals 0.0 and is still another number.
    return {key: value for key, value in entry.items() if str(value) not in ("0.0", "[]")}
