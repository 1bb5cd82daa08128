# SPDX-License-Identifier: Apache-2.0
"""One entry to all files of single worlds: read by what is in them, write by format."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.config import check_output, write_atomically
from pm01_nav.documents import PREFACE, load_yaml, looks_like_xml, read_bytes
from pm01_nav.errors import InputError
from pm01_nav.geometry import points_in_polygon
from pm01_nav.worlds.barn_grid import read_barn_grid
from pm01_nav.worlds.mjcf import world_to_mjcf
from pm01_nav.worlds.reading import Reading, tell
from pm01_nav.worlds.ros_map import read_map
from pm01_nav.worlds.ros_map_writer import RESOLUTION, write_ros_map
from pm01_nav.worlds.sdf import BAND, read_sdf
from pm01_nav.worlds.sdf_writer import world_to_sdf
from pm01_nav.worlds.world import World
from pm01_nav.worlds.yaml_world import read_yaml_world, write_yaml_world

NPY_MAGIC = b"\x93NUMPY"
# Of the YAML of worlds and maps.
_KEYS = re.compile(r"^(image|bounds|name)[ \t]*:", re.MULTILINE)
WORLD_FORMATS = ("yaml", "map", "sdf", "mjcf")


def read_world(path: str | Path, **options: Any) -> World:
    """Read a world like ``read_world_file``, and log what was left out.

    Raises:
        InputError: as ``read_world_file``.
    """
    return tell(read_world_file(path, **options))


def read_world_file(
    path: str | Path,
    *,
    model_folders: Iterable[str | Path] = (),
    z_min: float = BAND[0],
    z_max: float = BAND[1],
    partial: bool = False,
    strict: bool = False,
) -> Reading:
    """Read a world from our YAML, a ROS map, SDF, or a BARN grid.

    A YAML file with the key ``image`` is a ROS map. The other arguments are for SDF; see
    ``read_sdf``. Files of many worlds have their own readers: ``load_barn``, ``read_dynabarn``.

    Raises:
        InputError: the file cannot be read, is of another kind, or is wrong; an obstacle stands on
            the start.
    """
    path = Path(path)
    sdf_options = {"z_min": z_min, "z_max": z_max, "partial": partial, "strict": strict}
    reading = _read(path, model_folders, sdf_options)
    world = reading.world
    obstacle = None if world.start is None else _obstacle_at(world, *world.start[:2])
    if obstacle is not None:
        raise InputError(f"{path}: start = {world.start}: lies in {obstacle}; it must be free")
    return reading


def _read(path: Path, model_folders: Iterable[str | Path], sdf_options: dict[str, Any]) -> Reading:
    """Tell the kind of a file by what is in it, whatever its name ends with."""
    data = read_bytes(path)
    if data.startswith(NPY_MAGIC):
        return Reading(read_barn_grid(path))
    start = data[:PREFACE].decode("utf-8-sig", errors="replace")
    if looks_like_xml(start):
        return read_sdf(path, model_folders=model_folders, **sdf_options)
    if path.suffix.lower() in (".yaml", ".yml") or _KEYS.search(start):
        return read_map(path) if "image" in load_yaml(path) else Reading(read_yaml_world(path))
    allowed = "a world or a ROS map in YAML, an SDF world, a BARN grid (.npy)"
    raise InputError(f"{path}: unknown kind of world; allowed: {allowed}")


def _obstacle_at(world: World, x: float, y: float) -> str | None:
    """Name the static obstacle that a point lies in, None where there is none."""
    gaps = np.hypot(world.discs[:, 0] - x, world.discs[:, 1] - y) - world.discs[:, 2]
    if len(gaps) and gaps.min() < 0.0:
        return f"discs[{int(gaps.argmin())}]"
    for index, polygon in enumerate(world.polygons):
        if points_in_polygon(np.array([[x, y]]), polygon)[0]:
            return f"polygons[{index}]"
    if world.grid is not None and world.grid.is_solid(x, y):
        return "a solid cell of the map"
    return None


def write_world(
    world: World, path: str | Path, format: str, *, resolution: float = RESOLUTION
) -> None:
    """Write a world as ``yaml``, ``map`` (ROS), ``sdf`` or ``mjcf``.

    A map, or a YAML world with a grid, puts more files beside ``path``. ``resolution`` [m] is for
    maps.

    Raises:
        InputError: the format is unknown, the folder does not exist, or the world does not fit.
    """
    path = Path(path)
    if format not in WORLD_FORMATS:
        raise InputError(f"format = {format!r}: unknown; allowed: {', '.join(WORLD_FORMATS)}")
    check_output(path)
    if format == "yaml":
        write_yaml_world(world, path)
    elif format == "map":
        write_ros_map(world, path, resolution)
    else:
        text = world_to_sdf(world) if format == "sdf" else world_to_mjcf(world)
        write_atomically(path, text)
