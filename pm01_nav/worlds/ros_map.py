# SPDX-License-Identifier: Apache-2.0
"""Read maps of the ROS map server: a YAML file and an image, as Nav2 and SLAM tools save them."""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.worlds.grid import OccupancyGrid
from pm01_nav.worlds.reading import Reading
from pm01_nav.worlds.world import World

if TYPE_CHECKING:
    from PIL import Image

MAX_PIXELS = 64_000_000
"""Larger images are refused unread: a few bytes of header can ask for any amount of memory."""
FORMATS = ("PPM", "PNG", "BMP")
"""What the map saver writes; Pillow counts pgm as PPM."""
GREY_MODES, COLOUR_MODES, ALPHA_MODES = ("1", "L"), ("P", "RGB"), ("LA", "PA", "RGBA")
"""Pillow's names for the 8-bit images that are read."""
FREE, OCCUPIED, UNKNOWN = 0, 1, 2
NAMES = ("free", "occupied", "unknown")
NEVER_SEEN = 205
"""The grey that map savers write for what nobody has seen.

Its occupancy, 50/255 = 0.19608, is above the 0.196 of ROS 1 and below Nav2's 0.25: the map server
calls it unknown or free, depending on which of the two files it reads. Here it is unknown.
"""
LEAST_YAW = 1e-6
"""Smaller yaws are what SLAM tools' rounding leaves of 0 [rad]."""
# What Pillow's readers raise on a damaged file.
UNREADABLE = (
    OSError,
    ValueError,
    SyntaxError,
    EOFError,
    IndexError,
    MemoryError,
    OverflowError,
    struct.error,
    zlib.error,
)


class MapFile(FrozenModel):
    """The keys of a map's YAML file that matter here."""

    # Map tools add keys of their own, which the map server ignores; so do we.
    model_config = ConfigDict(extra="ignore")

    image: str = Field(min_length=1)
    resolution: float = Field(gt=0.0)
    origin: tuple[float, ...] = Field(min_length=3, max_length=3)
    negate: bool
    free_thresh: float = Field(ge=0.0, le=1.0)
    occupied_thresh: float = Field(ge=0.0, le=1.0)
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    @field_validator("mode", mode="before")
    @classmethod
    def _in_any_case(cls, mode: object) -> object:
        return mode.lower() if isinstance(mode, str) else mode

    @field_validator("origin")
    @classmethod
    def _within_a_turn(cls, origin: tuple[float, ...]) -> tuple[float, ...]:
        yaw = math.remainder(origin[2], math.tau)
        return (*origin[:2], 0.0 if abs(yaw) < LEAST_YAW else yaw)

    @field_validator("occupied_thresh")
    @classmethod
    def _thresholds_in_order(cls, occupied: float, info: ValidationInfo) -> float:
        free = info.data.get("free_thresh")
        if free is not None and occupied < free:
            raise ValueError(f"must not be below free_thresh ({free})")
        return occupied


def read_ros_map(path: str | Path) -> World:
    """Read a map like ``read_map``; return the world alone.

    Raises:
        InputError: as ``read_map``.
    """
    return read_map(path).world


def read_map(path: str | Path) -> Reading:
    """Read a map's YAML file and its image; the world's bounds are the extent of the map.

    What is not known to be free is solid, and so is everything beyond the image.

    Raises:
        InputError: a key or the image is missing or wrong, or no cell is free.
    """
    path = Path(path)
    settings = validate(MapFile, load_yaml(path), str(path))
    pixels, has_alpha = _read_pixels(path, path.parent / settings.image)
    # Row 0 of an image is its top, row 0 of a grid its bottom.
    cells = _cells(pixels, has_alpha, settings)[::-1]
    if (cells != FREE).all():
        raise InputError(f"{path}: image = {settings.image!r}: must show at least one free cell")
    x, y, yaw = settings.origin
    solid = np.ascontiguousarray(cells != FREE).view(np.uint8)
    try:
        grid = OccupancyGrid(solid, settings.resolution, (x, y), yaw, closed=True)
        world = World(path.stem, grid.extent(), grid=grid)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return Reading(world, summary=f"{path}: {_summary(cells, settings)}")


def _summary(cells: NDArray[np.uint8], settings: MapFile) -> str:
    """Say how large a map is, and what share of it is what."""
    height, width = cells.shape
    counts = [int(np.count_nonzero(cells == kind)) for kind in (FREE, OCCUPIED, UNKNOWN)]
    shares = [
        f"{100.0 * n / cells.size:.1f} % {name}" for n, name in zip(counts, NAMES, strict=True)
    ]
    turned = f", turned by {settings.origin[2]:.4g} rad" if settings.origin[2] else ""
    size = f"{width} x {height} cells of {settings.resolution:g} m{turned}"
    return f"read {size}: {', '.join(shares)}"


def _read_pixels(path: Path, image_path: Path) -> tuple[NDArray[np.integer], bool]:
    """Return brightness (height, width, channels) and whether the last channel is alpha.

    8-bit images come as uint8, 16-bit ones as uint16 with one channel.
    """
    from PIL import Image  # Few read a map.

    where = f"{path}: image = {str(image_path)!r}"
    try:
        with warnings.catch_warnings():
            # Our own limit is stricter than the one that Pillow only warns about.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            # Devices and pipes have perhaps no end.
            if image_path.exists() and not image_path.is_file():
                raise InputError(f"{where}: must be a file")
            with Image.open(image_path, formats=FORMATS) as image:
                return _decode(image, where)
    except InputError:
        raise
    except FileNotFoundError as error:
        # Tools write where the image was when the map was saved, on another machine perhaps.
        beside = path.with_name(image_path.name)
        hint = f"; beside the file there is {beside.name}" if beside.is_file() else ""
        raise InputError(f"{where}: does not exist{hint}") from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{where}: must have at most {MAX_PIXELS} pixels") from error
    except UNREADABLE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{where}: must be a whole pgm, png or bmp image: {reason}") from error


def _decode(image: Image.Image, where: str) -> tuple[NDArray[np.integer], bool]:
    width, height = image.size
    if not 0 < width * height <= MAX_PIXELS:
        size = f"{width} x {height}"
        raise InputError(f"{where}: must have 1 to {MAX_PIXELS} pixels, not {size}")
    if image.mode == "I" or image.mode.startswith("I;16"):
        return np.clip(np.asarray(image), 0, 65535).astype(np.uint16)[:, :, None], False
    if image.mode not in GREY_MODES + COLOUR_MODES + ALPHA_MODES:
        raise InputError(f"{where}: must be a grey or colour image, not of mode {image.mode!r}")
    has_alpha = image.mode in ALPHA_MODES or "transparency" in image.info
    mode = "RGBA" if has_alpha else "L" if image.mode in GREY_MODES else "RGB"
    return np.asarray(image.convert(mode)).reshape(height, width, -1), has_alpha


def _cells(pixels: NDArray[np.integer], has_alpha: bool, settings: MapFile) -> NDArray[np.uint8]:
    """Return of each pixel whether it is ``FREE``, ``OCCUPIED`` or ``UNKNOWN``, (height, width)."""
    full = int(np.iinfo(pixels.dtype).max)
    colours = pixels[:, :, :3]
    # As in the map server, alpha counts as one more channel in trinary mode and only there.
    averaged = pixels if settings.mode == "trinary" else colours
    cells = _levels(averaged.shape[2] * full, settings)[_total(averaged)]
    if settings.mode == "trinary":
        never_seen = (255 - NEVER_SEEN if settings.negate else NEVER_SEEN) * full // 255
        cells[_total(colours) == colours.shape[2] * never_seen] = UNKNOWN
    elif settings.mode == "scale" and has_alpha:
        cells[pixels[:, :, 3] != full] = UNKNOWN
    return cells


def _total(channels: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the sum of the channels (height, width, n) of each pixel, shape (height, width)."""
    # Most maps are grey; adding up one number for each of millions of pixels takes its time.
    return channels[:, :, 0] if channels.shape[2] == 1 else channels.sum(axis=2, dtype=np.uint16)


def _levels(brightest: int, settings: MapFile) -> NDArray[np.uint8]:
    """Return what each brightness, the sum of the channels, means: free, occupied or unknown.

    Only what the map server counts as free is free here. In trinary mode cells between the
    thresholds are unknown; in the others they are partly occupied.
    """
    level = np.arange(brightest + 1)
    cells = np.full(len(level), OCCUPIED, dtype=np.uint8)
    if settings.mode == "raw":
        # The pixel is the occupancy itself [%]; from 101 on it means unknown.
        percent = np.floor(level * 255 / brightest + 0.5)
        cells[percent / 100.0 < settings.free_thresh] = FREE
        cells[percent > 100] = UNKNOWN
        return cells
    occupancy = (level if settings.negate else brightest - level) / brightest
    free, occupied = settings.free_thresh, settings.occupied_thresh
    if settings.mode == "trinary":
        cells[occupancy <= occupied] = UNKNOWN
    elif occupied > free:
        # The server rounds to whole percents between the thresholds; 0 is free.
        part = np.rint((occupancy - free) / (occupied - free) * 100.0)
        cells[(occupancy <= occupied) & (part <= 0.0)] = FREE
    cells[occupancy < free] = FREE
    return cells
