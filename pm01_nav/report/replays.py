# SPDX-License-Identifier: Apache-2.0
"""Traces in few bytes, for the page to unpack: rounded, told as changes in time, deflated.

What ``pack`` returns is base64 of deflate of: length of the header as uint32 (little endian),
header (JSON), then the arrays one after the other. ``decode.js`` is the other side.
"""

from __future__ import annotations

import base64
import json
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.recorder import MAX_REASON
from pm01_nav.benchmark.trace import Trace

DISTANCE_STEP = 0.002
"""Poses and geometry are kept to this [m]; the error is half of it."""
MOVER_STEP = 0.01
"""[m]"""
SCAN_STEP = 0.02
"""[m]; more if the lidar reaches farther than 254 of them."""
ANGLE_STEP = 0.001
"""[rad]"""
SPEED_STEP = 0.002
"""[m/s] or [rad/s]"""
MAX_SCANS = 400
"""Scans are most of a trace; of longer episodes every second, third, ... one is kept."""
REWARD_LEVELS = 4000
"""A reward term's values are kept to this part of their range."""


@dataclass(frozen=True)
class Packed:
    """Numbers as codes: value = low + step x code; the highest code stands for no number."""

    codes: NDArray[np.unsignedinteger]
    """Of type uint8 or uint16, shape as the numbers."""
    low: float
    step: float

    @property
    def spec(self) -> dict[str, Any]:
        """What the page must know of it."""
        return {
            "shape": list(self.codes.shape),
            "bytes": self.codes.itemsize,
            "low": self.low,
            "step": self.step,
        }

    def content(self) -> bytes:
        """Return each row's difference to the one before, modulo the codes' range.

        Differences are zigzag numbers (0, -1, 1, -2, ... are 0, 1, 2, 3, ...), so that small ones
        have no high byte; all low bytes come first, which is what deflate likes.
        """
        signed = np.int8 if self.codes.itemsize == 1 else np.int16
        rows = self.codes.astype(self.codes.dtype.newbyteorder("="))
        change = np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1])).view(signed)
        zigzag = ((change << 1) ^ (change >> (8 * self.codes.itemsize - 1))).view(rows.dtype)
        flat = zigzag.ravel()
        low = (flat & 0xFF).astype(np.uint8).tobytes()
        return low if flat.itemsize == 1 else low + (flat >> 8).astype(np.uint8).tobytes()


def quantise(values: NDArray[Any], step: float, size: int = 2) -> Packed:
    """Round to multiples of ``step`` above the least value, or coarser ones if codes run out.

    Codes have ``size`` bytes. A finite value's error is at most half a step.
    """
    values = np.asarray(values, dtype=np.float64)
    known = np.isfinite(values)
    low, high = (values[known].min(), values[known].max()) if known.any() else (0.0, 0.0)
    nothing = 256**size - 1
    step = max(step, (high - low) / (nothing - 1))
    codes = np.full(values.shape, nothing, dtype=np.uint8 if size == 1 else np.uint16)
    codes[known] = np.round((values[known] - low) / step)
    return Packed(codes, float(low), float(step))


def pack(trace: Trace, suite: str, entry: str, episode: int) -> str:
    """Return a trace in base64.

    Raises:
        ValueError: bounds, goal or description hold what is no number.
    """
    arrays = _arrays(trace)
    grid = np.packbits(trace.grid.ravel() != 0).tobytes()
    header = {
        "about": trace.about | {"reason": trace.about["reason"][:MAX_REASON]},
        "suite": suite,
        "entry": entry,
        "episode": episode,
        "scan_every": scan_every(len(trace.scan)),
        "bounds": trace.bounds.tolist(),
        "goal": trace.goal.tolist(),
        "corner_counts": trace.corner_counts.tolist(),
        "grid": {"shape": list(trace.grid.shape), "frame": trace.grid_frame.tolist()},
        "arrays": {name: packed.spec for name, packed in arrays.items()},
    }
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    content = b"".join(packed.content() for packed in arrays.values())
    whole = struct.pack("<I", len(text)) + text + content + grid
    return base64.b64encode(zlib.compress(whole, 9)).decode()


def scan_every(steps: int) -> int:
    """Return every how many steps a scan is kept."""
    return max(1, -(-steps // MAX_SCANS))


def _arrays(trace: Trace) -> dict[str, Packed]:
    # REP-117: -inf is a return nearer than the lidar can measure.
    scan = np.where(np.isneginf(trace.scan), 0.0, trace.scan)[:: scan_every(len(trace.scan))]
    terms = range(trace.rewards.shape[1])
    return {
        "position": quantise(trace.pose[:, :2], DISTANCE_STEP),
        "yaw": quantise(np.angle(np.exp(1j * trace.pose[:, 2])), ANGLE_STEP),
        "scan": quantise(scan, SCAN_STEP, size=1),
        "angles": quantise(trace.angles, ANGLE_STEP),
        "movers": quantise(trace.movers[:, :, :2], MOVER_STEP),
        "mover_radius": quantise(trace.movers[:, :, 2], MOVER_STEP),
        "twist": quantise(trace.twist[:, [0, -1]], SPEED_STEP),
        "clearance": quantise(trace.clearance, DISTANCE_STEP),
        "discs": quantise(trace.discs, DISTANCE_STEP),
        "segments": quantise(trace.segments, DISTANCE_STEP),
        "corners": quantise(trace.corners, DISTANCE_STEP),
    } | {f"reward{k}": _reward(trace.rewards[:, k]) for k in terms}


def _reward(values: NDArray[Any]) -> Packed:
    """Keep a term's values, whatever their size; lowest and highest exactly."""
    known = values[np.isfinite(values)]
    spread = float(np.ptp(known)) if len(known) else 0.0
    return quantise(values, spread / REWARD_LEVELS or 1.0)
