"""What is packed can be unpacked, as exactly as it says."""

from __future__ import annotations

import base64
import json
import struct
import zlib

import numpy as np
import pytest

from pm01_nav.report.replays import pack, quantise


def _unpack_array(content, spec):
    """Undo ``Packed.content`` number by number, as the page does; NaN for what was no number."""
    count = int(np.prod(spec["shape"]))
    row = int(np.prod(spec["shape"][1:]))
    top = 256 ** spec["bytes"] - 1
    codes, values = [], []
    for k in range(count):
        zigzag = content[k] + (256 * content[count + k] if spec["bytes"] == 2 else 0)
        change = zigzag // 2 if zigzag % 2 == 0 else -(zigzag + 1) // 2
        codes.append(((codes[k - row] if k >= row else 0) + change) % (top + 1))
        values.append(np.nan if codes[k] == top else spec["low"] + spec["step"] * codes[k])
    return np.array(values).reshape(spec["shape"])


def _unpack(text):
    whole = zlib.decompress(base64.b64decode(text))
    (length,) = struct.unpack("<I", whole[:4])
    header, at = json.loads(whole[4 : 4 + length]), 4 + length
    arrays = {}
    for name, spec in header["arrays"].items():
        size = int(np.prod(spec["shape"])) * spec["bytes"]
        arrays[name] = _unpack_array(whole[at : at + size], spec)
        at += size
    return header, arrays, whole[at:]


def test_codes_by_hand():
    """1.0, 1.5, 0.5 in steps of 0.25 from 0.5 on are 2, 4, 0; changes +2, +2, -4 are 4, 4, 7."""
    packed = quantise(np.array([1.0, 1.5, 0.5]), 0.25, size=1)
    assert packed.codes.tolist() == [2, 4, 0]
    assert list(packed.content()) == [4, 4, 7]


def test_no_number_has_the_highest_code():
    packed = quantise(np.array([np.nan, 0.0, np.inf, 1.0]), 0.1, size=1)
    assert packed.codes.tolist() == [255, 0, 255, 10]
    assert quantise(np.full(3, np.nan), 0.1).codes.tolist() == [65535] * 3


def test_steps_grow_where_codes_run_out():
    """254 codes above the lowest for 25.4 m make steps of 0.1 m, whatever was asked for."""
    packed = quantise(np.array([0.0, 25.4]), 0.02, size=1)
    assert packed.step == pytest.approx(0.1)
    assert packed.codes.tolist() == [0, 254]


@pytest.mark.parametrize("size", [1, 2])
def test_changes_wrap_around(size):
    """The greatest changes possible, from the lowest code to the highest and back."""
    values = np.array([0.0, 1.0, np.nan, 0.0, np.nan, 1.0])
    packed = quantise(values, 1e-9, size)
    back = _unpack_array(packed.content(), packed.spec)
    np.testing.assert_allclose(back, values, atol=1e-12)


BOUNDS = {
    # Half a step: 0.002 m, 0.001 rad, 0.02 m, 0.01 m, 0.002 m/s. All ranges are short enough for
    # these steps: 254 x 0.02 m = 5 m of scan, 65534 x 0.002 m = 131 m.
    "position": 0.001,
    "yaw": 0.0005,
    "scan": 0.01,
    "angles": 0.0005,
    "movers": 0.005,
    "mover_radius": 0.005,
    "twist": 0.001,
    "clearance": 0.001,
    "discs": 0.001,
    "segments": 0.001,
    "corners": 0.001,
    # Constant: the lowest value itself. From 0 to 0.4 in 4000 steps of 0.0001.
    "reward0": 0.0,
    "reward1": 0.00005,
}


def test_round_trip(trace):
    original = trace()
    header, arrays, grid = _unpack(pack(original, "static", "dwa", 7))
    scan = np.where(np.isposinf(original.scan), np.nan, original.scan)
    expected = {
        "position": original.pose[:, :2],
        "yaw": original.pose[:, 2],
        "scan": np.where(np.isneginf(scan), 0.0, scan),
        "angles": original.angles,
        "movers": original.movers[:, :, :2],
        "mover_radius": original.movers[:, :, 2],
        "twist": original.twist,
        "clearance": original.clearance,
        "discs": original.discs,
        "segments": original.segments,
        "corners": original.corners,
        "reward0": original.rewards[:, 0],
        "reward1": original.rewards[:, 1],
    }
    assert set(arrays) == set(expected) == set(BOUNDS)
    for name, values in expected.items():
        # Single precision of values up to 4 adds 5e-7.
        np.testing.assert_allclose(arrays[name], values, rtol=0, atol=BOUNDS[name] + 5e-7)
    assert (header["suite"], header["entry"], header["episode"]) == ("static", "dwa", 7)
    # Of 64 cells the last one is solid: seven bytes of zeros, then a one.
    assert grid == bytes([0, 0, 0, 0, 0, 0, 0, 1])


def test_an_episode_that_failed_at_once_can_be_packed(trace):
    """It has a start and no steps."""
    whole = trace("failure", "an error")
    short = type(whole)(
        **vars(whole)
        | {"rewards": whole.rewards[:0], "command": whole.command[:0]}
        | {name: vars(whole)[name][:1] for name in ("pose", "scan", "movers", "twist", "clearance")}
    )
    _, arrays, _ = _unpack(pack(short, "static", "dwa", 0))
    assert arrays["position"].shape == (1, 2)
    assert arrays["reward0"].shape == (0,)


def test_long_episodes_keep_every_so_many_scans(trace):
    """Of 801 scans every third makes 267, no more than 400; every second would make 401."""
    short = trace()
    again = np.zeros(801, dtype=np.int64)
    long = type(short)(
        **vars(short)
        | {name: vars(short)[name][again] for name in ("pose", "movers", "twist", "clearance")}
        | {"scan": np.tile(np.linspace(0.0, 3.2, 801, dtype=np.float32)[:, None], (1, 8))}
    )
    header, arrays, _ = _unpack(pack(long, "static", "dwa", 0))
    assert header["scan_every"] == 3
    assert arrays["scan"].shape == (267, 8)
    # Scan k is that of step 3 k, at 3 k / 800 of 3.2 m.
    np.testing.assert_allclose(arrays["scan"][100], 1.2, atol=0.011)
    assert arrays["position"].shape == (801, 2)


def test_a_long_reason_is_cut(trace):
    header, _, _ = _unpack(pack(trace("failure", "x" * 5000), "static", "dwa", 0))
    assert header["about"]["reason"] == "x" * 200
