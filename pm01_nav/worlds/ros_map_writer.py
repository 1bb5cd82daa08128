# SPDX-License-Identifier: Apache-2.0
"""Write maps of the ROS map server: a pgm image and the YAML file that describes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pm01_nav.config import to_yaml, write_atomically
from pm01_nav.errors import InputError
from pm01_nav.worlds.raster import rasterise
from pm01_nav.worlds.world import OccupancyGrid, World

RESOLUTION = 0.05
"""Side of a cell where nobody asks for another [m]."""
SOLID, FREE = 0, 254
"""The grey levels that the map saver writes."""


def write_ros_map(world: World, path: str | Path, resolution: float = RESOLUTION) -> Path:
    """Write the static obstacles of a world as ``path`` and a pgm beside it; return the pgm.

    Every point of an obstacle lies in a solid cell; movers are left out.

    Raises:
        InputError: ``path`` is no YAML file, the resolution gives too many cells or leaves none
            free.
    """
    return write_grid(rasterise(world, resolution), path)


def write_grid(grid: OccupancyGrid, path: str | Path) -> Path:
    """Write a grid as ``path`` and a pgm beside it; return the pgm.

    Raises:
        InputError: ``path`` is no YAML file, or no cell is free.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a map must be named *.yaml; its image goes beside it")
    if grid.occupied.all():
        raise InputError(f"{path}: resolution = {grid.resolution}: leaves no cell free")
    height, width = grid.occupied.shape
    # Row 0 of an image is its top, row 0 of a grid its bottom.
    pixels = np.where(grid.occupied[::-1] != 0, SOLID, FREE).astype(np.uint8)
    image = path.with_suffix(".pgm")
    settings = {
        "image": image.name,
        "mode": "trinary",
        "resolution": float(grid.resolution),
        "origin": [float(grid.origin[0]), float(grid.origin[1]), float(grid.yaw)],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.25,
    }
    # The image first: a YAML file without its image is half a map.
    write_atomically(image, b"P5\n%d %d\n255\n" % (width, height) + pixels.tobytes())
    write_atomically(path, to_yaml(settings))
    return image
