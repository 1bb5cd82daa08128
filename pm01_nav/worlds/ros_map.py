# SPDX-License-Identifier: Apache-2.0
"""Read maps of the ROS map server: a YAML file and an image, as Nav2 and SLAM tools save them."""

from __future__ import annotations

import struct
import warnings
import zlib
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import ConfigDict, Field, ValidationInfo, field_validator

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.worlds.world import OccupancyGrid, World

MAX_PIXELS = 64_000_000
"""Larger images are refused unread: a few bytes of header can ask for any amount of memory."""
FORMATS = ("PPM", "PNG", "BMP")
"""What the map saver writes; Pillow counts pgm as PPM."""
GREY_MODES, COLOUR_MODES, ALPHA_MODES = ("1", "L"), ("P", "RGB"), ("LA", "PA", "RGBA")
"""Pillow's names for the 8-bit images that are read."""
# What Pillow's readers raise on a damaged file; DecompressionBombError is their size limit.
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
    Image.DecompressionBombError,
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

    @field_validator("origin")
    @classmethod
    def _not_rotated(cls, origin: tuple[float, ...]) -> tuple[float, ...]:
        if origin[2] != 0.0:
            raise ValueError("the third number (yaw) must be 0; rotated maps are not supported")
        return origin

    @field_validator("occupied_thresh")
    @classmethod
    def _thresholds_in_order(cls, occupied: float, info: ValidationInfo) -> float:
        free = info.data.get("free_thresh")
        if free is not None and occupied < free:
            raise ValueError(f"must not be below free_thresh ({free})")
        return occupied


def read_ros_map(path: str | Path) -> World:
    """Read a map's YAML file and its image; the world's bounds are the extent of the map.

    Raises:
        InputError: a key or the image is missing or wrong, or no cell is free.
    """
    path = Path(path)
    settings = validate(MapFile, load_yaml(path), str(path))
    pixels, has_alpha = _read_pixels(path, path.parent / settings.image)
    # Row 0 of an image is its top, row 0 of a grid its bottom.
    solid = np.ascontiguousarray(_solid(pixels, has_alpha, settings)[::-1])
    if solid.all():
        raise InputError(f"{path}: image = {settings.image!r}: must show at least one free cell")
    height, width = solid.shape
    x, y, _ = settings.origin
    bounds = (x, y, x + width * settings.resolution, y + height * settings.resolution)
    try:
        return World(path.stem, bounds, grid=OccupancyGrid(solid, settings.resolution, (x, y)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _read_pixels(path: Path, image_path: Path) -> tuple[NDArray[np.integer], bool]:
    """Return brightness (height, width, channels) and whether the last channel is alpha.

    8-bit images come as uint8, 16-bit ones as uint16 with one channel.
    """
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
        raise InputError(f"{where}: does not exist") from error
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


def _solid(pixels: NDArray[np.integer], has_alpha: bool, settings: MapFile) -> NDArray[np.uint8]:
    """Return 1 where a pixel is not known to be free, shape (height, width)."""
    # As in the map server, alpha counts as one more channel in trinary mode and only there.
    averaged = pixels if settings.mode == "trinary" else pixels[:, :, :3]
    brightest = averaged.shape[2] * int(np.iinfo(pixels.dtype).max)
    solid = _solid_levels(brightest, settings)[averaged.sum(axis=2, dtype=np.uint16)]
    if has_alpha and settings.mode == "scale":
        solid |= pixels[:, :, 3] != np.iinfo(pixels.dtype).max
    return solid


def _solid_levels(brightest: int, settings: MapFile) -> NDArray[np.uint8]:
    """Return for each brightness, the sum of the channels, whether it is solid: 1 or 0.

    Cells between the thresholds are unknown. They count as solid like occupied ones, because the
    robot must not drive into what nobody has seen; so ``occupied_thresh`` decides nothing here.
    """
    level = np.arange(brightest + 1)
    if settings.mode == "raw":
        # The pixel is the occupancy itself [%]; from 101 on it means unknown.
        occupancy = np.floor(level * 255 / brightest + 0.5) / 100.0
    else:
        occupancy = (level if settings.negate else brightest - level) / brightest
    return ((occupancy >= settings.free_thresh) | (occupancy > 1.0)).astype(np.uint8)
