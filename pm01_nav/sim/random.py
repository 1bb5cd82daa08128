# SPDX-License-Identifier: Apache-2.0
"""Counter-based random numbers: draw k of stream s is a fixed function of (s, k).

No hidden state lives in a thread, so a trajectory depends neither on the number of threads nor
on the size of the batch. The mixer is SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
"""

from __future__ import annotations

from functools import cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
SHIFT_30, SHIFT_27, SHIFT_31, SHIFT_11 = (np.uint64(s) for s in (30, 27, 31, 11))
ONE = np.uint64(1)
UNIT = 2.0**-53


@compiled
def mix(value):
    """Scramble 64 bits."""
    value = (value ^ (value >> SHIFT_30)) * MIX_1
    value = (value ^ (value >> SHIFT_27)) * MIX_2
    return value ^ (value >> SHIFT_31)


@compiled
def bits(key, count, i):
    """Draw the next 64 random bits of environment i."""
    count[i] += ONE
    return mix(key[i] + count[i] * GOLDEN)


@compiled
def uniform(key, count, i):
    """Draw the next number of environment i from U[0, 1)."""
    return float(bits(key, count, i) >> SHIFT_11) * UNIT


@compiled
def draw_row(begin, w, number):
    """Return a row of world w, chosen by a number from U[0, 1)."""
    return begin[w] + int(number * (begin[w + 1] - begin[w]))


@cache
def normal_values() -> NDArray[np.float32]:
    """Return 65536 equally likely values of N(0, 1), shape (65536,).

    They are the middles of its quantiles, scaled to a variance of exactly 1; none exceeds 4.4.
    """
    # From the standard library: scipy takes a tenth of a second to import.
    lower = [NormalDist().inv_cdf((k + 0.5) / 65536) for k in range(32768)]
    middles = np.array([*lower, *(-value for value in reversed(lower))])
    return (middles / middles.std()).astype(np.float32)


def stream_keys(seeds: np.ndarray) -> np.ndarray:
    """Return the stream of each integer seed, shape (n,): similar seeds, unrelated streams."""
    with np.errstate(over="ignore"):
        return mix.py_func(mix.py_func(np.asarray(seeds).astype(np.uint64) + GOLDEN) + GOLDEN)
