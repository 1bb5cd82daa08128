# SPDX-License-Identifier: Apache-2.0
"""Read BARN's grid files: the blobs of a world as rows and columns of solid cells.

The full dataset has each world three times: as ``world_<i>.world`` (``read_barn_world``), as
``map_files/yaml_<i>.yaml`` with ``map_pgm_<i>.pgm`` (``read_ros_map``), and as
``grid_files/grid_<i>.npy``. A laser sees the cylinders, so a grid is read as those, not as solid
cells: diagonal neighbours leave a gap of 6 cm, and a blob is hollow.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds import barn
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

# The geometry of the dataset: one cylinder fills a cell of 0.15 m (Perille et al. 2020).
CELL, RADIUS = 0.15, 0.075
ROWS = 30
"""Along x, from x = -4.425 m on; the first and the last are the side walls."""
FIRST_COLUMN_Y = 5.175
WALL_COLUMNS = 34
"""Columns of cylinders of the walls before the grid, from y = 0.075 m on."""
MAX_COLUMNS = 1000


def read_barn_grid(path: str | Path) -> World:
    """Read one ``grid_<i>.npy``, 30 rows by n columns of 0 and 1, as the cylinders it stands for.

    Raises:
        InputError: the file is no such array.
    """
    from scipy import ndimage

    path = Path(path)
    match = re.fullmatch(r"grid_(-?[0-9]{1,9})\.npy", path.name)
    if match is None:
        raise InputError(f"{path}: must be named grid_<i>.npy")
    solid = _read_cells(path)
    # A cell with eight solid neighbours gets no cylinder.
    inside = ndimage.binary_erosion(solid, np.ones((3, 3)))
    rows, columns = np.nonzero(solid & ~np.asarray(inside, dtype=np.bool_))
    blobs = np.column_stack([_row_x(rows), FIRST_COLUMN_Y + CELL * columns])
    places = np.concatenate([outer_walls(), blobs])
    discs = np.column_stack([places, np.full(len(places), RADIUS)])
    goal_area = (*barn.GOAL, *barn.GOAL)
    try:
        return World(
            f"barn_{match[1]}", barn.BOUNDS, discs=discs, start=barn.START, goal_area=goal_area
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _read_cells(path: Path) -> NDArray[np.bool_]:
    try:
        # Mapped into memory first: a damaged header can ask for any amount of it.
        cells = np.load(path, mmap_mode="r", allow_pickle=False)
    except barn.UNREADABLE as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: must be a whole .npy array: {reason}") from error
    if not isinstance(cells, np.ndarray) or cells.ndim != 2 or cells.dtype.kind not in "biuf":
        raise InputError(f"{path}: must be one array of numbers with rows and columns")
    if cells.shape[0] != ROWS or not 1 <= cells.shape[1] <= MAX_COLUMNS:
        raise InputError(f"{path}: must have {ROWS} rows of 1 to {MAX_COLUMNS}, not {cells.shape}")
    if not np.isin(cells, (0, 1)).all():
        raise InputError(f"{path}: must hold 0 (free) and 1 (solid) only")
    solid = cells == 1
    if not solid[[0, -1]].all():
        raise InputError(f"{path}: the first and the last row are walls and must be 1")
    return solid


def _row_x(rows: NDArray[np.int64]) -> FloatArray:
    return np.asarray(-4.425 + CELL * rows, dtype=np.float64)


def outer_walls() -> FloatArray:
    """Return the 96 cylinders before the grid: a wall behind the start and one on each side."""
    across = _row_x(np.arange(ROWS))
    along = RADIUS + CELL * np.arange(1, WALL_COLUMNS)
    back = np.column_stack([across, np.full(ROWS, RADIUS)])
    sides = [np.column_stack([np.full(len(along), x), along]) for x in (across[0], across[-1])]
    return np.concatenate([back, *sides])
