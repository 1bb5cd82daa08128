# SPDX-License-Identifier: Apache-2.0
"""Maps of the ROS map server: what counts as solid, where it lies, and what is refused."""

from __future__ import annotations

import io
import math
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from pm01_nav.errors import InputError
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.ros_map import read_map, read_ros_map

KEYS = {
    "image": "map.pgm",
    "resolution": 0.5,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.25,
}
# 3 x 2 pixels: black, white, black / white, white, grey 128 (occupancy 127/255 = 0.498: unknown).
PIXELS = bytes([0, 255, 0, 255, 255, 128])
PGM = b"P5 3 2 255\n" + PIXELS


def write(folder: Path, content: bytes = PGM, /, **changes: object) -> Path:
    keys = {key: value for key, value in (KEYS | changes).items() if value is not None}
    path = folder / "room.yaml"
    path.write_text(yaml.safe_dump(keys))
    (folder / str(KEYS["image"])).write_bytes(content)
    return path


def png(mode: str, pixels: list[Any], **options: object) -> bytes:
    """Return a png with the pixels in one row."""
    image = Image.new(mode, (len(pixels), 1))
    image.putdata(pixels)
    content = io.BytesIO()
    image.save(content, "PNG", **options)
    return content.getvalue()


def solid(path: Path) -> list[list[int]]:
    grid = read_ros_map(path).grid
    assert grid is not None
    return grid.occupied.tolist()


def refused(path: Path, *words: str) -> None:
    with pytest.raises(InputError) as problem:
        read_ros_map(path)
    assert "\n" not in str(problem.value)
    for word in (str(path), *words):
        assert word in str(problem.value)


def test_places_the_map_in_the_world(tmp_path: Path) -> None:
    world = read_ros_map(write(tmp_path))
    assert world.name == "room"
    # 3 cells of 0.5 m to the right of -1, 2 cells up from 2.
    assert world.bounds == (-1.0, 2.0, 0.5, 3.0)
    assert world.grid is not None
    assert (world.grid.origin, world.grid.resolution) == ((-1.0, 2.0), 0.5)
    assert world.grid.occupied.dtype == np.uint8
    assert world.grid.occupied.flags.c_contiguous


def test_bottom_row_of_the_image_comes_first_and_unknown_is_solid(tmp_path: Path) -> None:
    assert solid(write(tmp_path)) == [[0, 0, 1], [1, 0, 1]]


def test_negate_swaps_black_and_white(tmp_path: Path) -> None:
    # Grey 128: 128/255 = 0.502 is unknown either way.
    assert solid(write(tmp_path, negate=1)) == [[1, 1, 1], [0, 1, 0]]


def test_free_means_strictly_below_the_threshold(tmp_path: Path) -> None:
    # (255 - 204)/255 = 0.2 exactly is not below 0.2; 206 gives 49/255 = 0.192.
    path = write(tmp_path, b"P5 2 1 255\n" + bytes([204, 206]), free_thresh=0.2)
    assert solid(path) == [[1, 0]]


def grey(*levels: int) -> bytes:
    """Return a pgm with the pixels in one row."""
    return f"P5 {len(levels)} 1 255\n".encode() + bytes(levels)


@pytest.mark.parametrize("free_thresh", [0.196, 0.25, 0.3])
def test_what_map_savers_write_for_never_seen_is_unknown(
    tmp_path: Path, free_thresh: float
) -> None:
    # (255 - 205)/255 = 0.19608 is above ROS 1's 0.196, and below Nav2's 0.25; its neighbours and
    # white are not what the map saver writes, and free at 0.25: 204 gives 0.2, 206 gives 0.192.
    changes = {"free_thresh": free_thresh}
    assert solid(write(tmp_path, grey(205, 254, 206), **changes)) == [[1, 0, 0]]
    if free_thresh > 0.2:
        assert solid(write(tmp_path, grey(204), **changes)) == [[0]]
    # The same as colours, with alpha (which the server averages in), with 16 bits, and inverted.
    for image in (png("RGB", [(205,) * 3, (254,) * 3]), png("LA", [(205, 255), (254, 255)])):
        assert solid(write(tmp_path, image, **changes)) == [[1, 0]]
    wide = b"P5 2 1 65535\n" + struct.pack(">HH", 205 * 257, 254 * 257)
    assert solid(write(tmp_path, wide, **changes)) == [[1, 0]]
    assert solid(write(tmp_path, grey(50, 1, 49), **changes, negate=1)) == [[1, 0, 0]]


def test_never_seen_is_a_matter_of_trinary_mode(tmp_path: Path) -> None:
    # In scale mode 0.196 is below the threshold and free, as in the map server; in raw mode 205
    # is more than 100 %, and 50 % are above the threshold.
    assert solid(write(tmp_path, grey(205), mode="scale")) == [[0]]
    assert solid(write(tmp_path, grey(205, 50, 0), mode="raw")) == [[1, 1, 0]]


def test_scale_rounds_to_whole_percents(tmp_path: Path) -> None:
    # Between 0.196 and 0.65: grey 205 is 0.17 %o of the way, which the server rounds to 0, free;
    # 204 gives 0.2, (0.2 - 0.196)/0.454 = 0.88 %: 1, not free.
    path = write(tmp_path, grey(205, 204), mode="scale", free_thresh=0.196)
    assert solid(path) == [[0, 1]]


def test_mode_in_capitals(tmp_path: Path) -> None:
    assert solid(write(tmp_path, grey(24, 25), mode="Raw")) == [[0, 1]]


def test_raw_pixels_are_percent(tmp_path: Path) -> None:
    # 0 and 24 % are below 0.25; 25 and 100 % are not; 101 and 255 are unknown.
    image = b"P5 6 1 255\n" + bytes([0, 24, 25, 100, 101, 255])
    assert solid(write(tmp_path, image, mode="raw")) == [[0, 0, 1, 1, 1, 1]]


def test_raw_ignores_negate(tmp_path: Path) -> None:
    image = b"P5 2 1 255\n" + bytes([0, 100])
    assert solid(write(tmp_path, image, mode="raw", negate=1)) == [[0, 1]]


def test_colours_are_averaged(tmp_path: Path) -> None:
    # (255 + 255 + 150)/3 = 220: occupancy 0.137, free; (255 + 255 + 0)/3 = 170: 0.333, unknown.
    image = png("RGB", [(255, 255, 150), (255, 255, 0)])
    assert solid(write(tmp_path, image)) == [[0, 1]]


def test_trinary_averages_alpha_too(tmp_path: Path) -> None:
    # Opaque 200: (3 * 200 + 255)/4 = 213.75, occupancy 0.162, free.
    # Transparent white: 3 * 255/4 = 191.25, occupancy 0.25, not below the threshold.
    image = png("RGBA", [(200, 200, 200, 255), (255, 255, 255, 0)])
    assert solid(write(tmp_path, image)) == [[0, 1]]


def test_scale_takes_transparent_as_unknown(tmp_path: Path) -> None:
    # Opaque 200: 55/255 = 0.216, free. All but opaque white is unknown.
    image = png("LA", [(200, 255), (255, 254), (255, 0)])
    assert solid(write(tmp_path, image, mode="scale")) == [[0, 1, 1]]


def test_palette_and_its_transparent_colour(tmp_path: Path) -> None:
    image = Image.new("P", (2, 1))
    image.putpalette([255, 255, 255, 254, 254, 254])
    image.putdata([0, 1])
    content = io.BytesIO()
    image.save(content, "PNG", transparency=0)
    assert solid(write(tmp_path, content.getvalue(), mode="scale")) == [[1, 0]]


def test_black_and_white_png(tmp_path: Path) -> None:
    assert solid(write(tmp_path, png("1", [0, 1]))) == [[1, 0]]


def test_sixteen_bit_grey(tmp_path: Path) -> None:
    # Of 65535: 50000 gives 0.237, free; 49000 gives 0.252, unknown.
    image = b"P5 2 1 65535\n" + struct.pack(">HH", 50000, 49000)
    assert solid(write(tmp_path, image)) == [[0, 1]]


@pytest.mark.parametrize("yaw", [-1.2e-17, 4e-7, 2.0 * math.pi, -0.0])
def test_tiny_yaw_is_none(tmp_path: Path, yaw: float) -> None:
    grid = read_ros_map(write(tmp_path, origin=[-1.0, 2.0, yaw])).grid
    assert grid is not None
    assert grid.yaw == 0.0
    assert math.copysign(1.0, grid.yaw) > 0.0


@pytest.mark.parametrize("yaw", [3.14, math.pi / 2, -0.1, 7.0])
def test_turned_map(tmp_path: Path, yaw: float) -> None:
    world = read_ros_map(write(tmp_path, origin=[-1.0, 2.0, yaw]))
    grid = world.grid
    assert grid is not None
    # The middle of column c and row r from below lies 0.5 m times c + 1/2 along the map's x axis,
    # and r + 1/2 along its y axis, from the origin on: REP-103, counter-clockwise.
    cos, sin = math.cos(yaw), math.sin(yaw)
    for r, row in enumerate([[0, 0, 1], [1, 0, 1]]):
        for c, cell in enumerate(row):
            along, across = 0.5 * (c + 0.5), 0.5 * (r + 0.5)
            x, y = -1.0 + cos * along - sin * across, 2.0 + sin * along + cos * across
            assert grid.is_solid(x, y) == bool(cell)
    corners = [(0.0, 0.0), (1.5, 0.0), (0.0, 1.0), (1.5, 1.0)]
    xs = [-1.0 + cos * a - sin * b for a, b in corners]
    ys = [2.0 + sin * a + cos * b for a, b in corners]
    assert world.bounds == pytest.approx((min(xs), min(ys), max(xs), max(ys)), abs=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_beyond_the_image_all_is_solid(tmp_path: Path, yaw: float) -> None:
    # 5 m x 5 m, white to the edge.
    image = b"P5 100 100 255\n" + bytes([254]) * 100**2
    world = read_ros_map(write(tmp_path, image, resolution=0.05, origin=[0.0, 0.0, yaw]))
    assert world.grid is not None
    assert world.grid.occupied.shape == (100, 100)
    assert not world.grid.occupied.any()
    assert world.grid.is_solid(-0.1, -0.1)
    pool = build_pool([world], 0.3)
    places = np.concatenate([pool.arrays.starts, pool.arrays.goals])
    assert len(places) > 1000
    # In the image's own frame a disc of 0.3 m around a place keeps within 0 to 5 m.
    cos, sin = math.cos(yaw), math.sin(yaw)
    within = np.column_stack([places @ [cos, sin], places @ [-sin, cos]])
    assert within.min() >= 0.3 - 1e-9
    assert within.max() <= 4.7 + 1e-9


def test_says_what_was_read(tmp_path: Path) -> None:
    # Of 3 x 2 cells three are white, two black and one grey: 50, 33.3 and 16.7 %.
    path = write(tmp_path, origin=[0.0, 0.0, 1.5])
    expected = "read 3 x 2 cells of 0.5 m, turned by 1.5 rad: 50.0 % free, 33.3 % occupied, "
    assert read_map(path).summary == f"{path}: {expected}16.7 % unknown"


def test_unknown_keys_are_ignored(tmp_path: Path) -> None:
    assert solid(write(tmp_path, note="from the lab")) == [[0, 0, 1], [1, 0, 1]]


def test_absolute_image_path(tmp_path: Path) -> None:
    (tmp_path / "white.pgm").write_bytes(b"P5 1 1 255\n\xff")
    assert solid(write(tmp_path, image=str(tmp_path / "white.pgm"))) == [[0]]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("image", None, "is missing"),
        ("resolution", None, "is missing"),
        ("negate", None, "is missing"),
        ("resolution", 0.0, "greater than 0"),
        ("resolution", -0.05, "greater than 0"),
        ("resolution", float("nan"), "finite"),
        ("origin", [0.0, 0.0], "at least 3"),
        ("origin", [0.0, 0.0, 0.0, 0.0], "at most 3"),
        ("origin", [0.0, float("inf"), 0.0], "finite"),
        ("mode", "fancy", "'trinary', 'scale' or 'raw'"),
        ("free_thresh", -0.1, "greater than or equal to 0"),
        ("occupied_thresh", 1.1, "less than or equal to 1"),
        ("occupied_thresh", 0.1, "must not be below free_thresh (0.25)"),
    ],
)
def test_wrong_key_is_named(tmp_path: Path, key: str, value: object, words: str) -> None:
    refused(write(tmp_path, **{key: value}), key, words)


def test_missing_yaml(tmp_path: Path) -> None:
    refused(tmp_path / "nowhere.yaml", "cannot be read")


def test_missing_image(tmp_path: Path) -> None:
    path = write(tmp_path)
    (tmp_path / "map.pgm").unlink()
    refused(path, "map.pgm", "does not exist")


def test_image_that_lies_elsewhere(tmp_path: Path) -> None:
    refused(
        write(tmp_path, image="/home/somebody/maps/map.pgm"),
        "does not exist; beside the file there is map.pgm",
    )


@pytest.mark.parametrize(
    "image",
    [PGM[:-1], b"P5 3 2 100\n" + PIXELS[:4], png("L", [0, 255])[:-25], b"", b"P5 0 2 255\n"],
)
def test_truncated_image(tmp_path: Path, image: bytes) -> None:
    refused(write(tmp_path, image), "map.pgm", "must be a whole pgm, png or bmp image")


def test_not_an_image(tmp_path: Path) -> None:
    refused(write(tmp_path, b"resolution: 0.05\n"), "must be a whole pgm, png or bmp image")


def test_kind_of_image_that_has_no_brightness_in_bytes(tmp_path: Path) -> None:
    refused(write(tmp_path, b"Pf 1 1 -1.0\n" + bytes(4)), "'F'")


@pytest.mark.parametrize("side", [8001, 11_000, 1_000_000])
def test_huge_image_is_refused_by_its_header(tmp_path: Path, side: int) -> None:
    # 8001^2 is just above 64 million; 11000^2 makes Pillow warn, 10^12 pixels make it raise.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = write(tmp_path, f"P5 {side} {side} 255\n".encode() + bytes(10))
        refused(path, "64000000 pixels")


def test_huge_png_is_refused_without_decoding(tmp_path: Path) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60_000, 2_000, 8, 0, 0, 0, 0))
    image = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", b"x") + chunk(b"IEND", b"")
    refused(write(tmp_path, image), "64000000 pixels")


def test_map_without_a_free_cell(tmp_path: Path) -> None:
    refused(write(tmp_path, b"P5 2 1 255\n\x00\x80"), "at least one free cell")


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
IMAGES = st.sampled_from([PGM, b"P2 2 1 255\n0 255\n", b"P5 2 1 99\n\x00\x63", png("LA", [(0, 9)])])


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    changes=st.dictionaries(
        st.sampled_from(sorted([*KEYS, "mode"])), VALUES | st.lists(VALUES, max_size=4), max_size=2
    ),
    image=IMAGES,
    place=st.integers(0, 200),
    patch=st.binary(max_size=4),
    length=st.integers(0, 200),
)
def test_any_file_gives_a_world_or_an_input_error(
    tmp_path: Path, changes: dict[str, Any], image: bytes, place: int, patch: bytes, length: int
) -> None:
    place %= len(image)
    damaged = (image[:place] + patch + image[place + len(patch) :])[: max(length, 20)]
    try:
        world = read_ros_map(write(tmp_path, damaged, **changes))
    except InputError:
        return
    assert world.grid is not None
    assert (world.grid.occupied == 0).any()
