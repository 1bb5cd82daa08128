# SPDX-License-Identifier: Apache-2.0
"""Figures of merit, each with its formula, unit and source."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval of a proportion (Wilson 1927), between 0 and 1."""
    if trials == 0:
        return 0.0, 1.0
    # Half a second, which a training need not wait for.
    from scipy.stats import binomtest

    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def spl(success: BoolArray, shortest: FloatArray, travelled: FloatArray) -> float:
    """Return success weighted by path length, between 0 and 1 (Anderson et al. 2018).

    The mean of S l / max(p, l) with l the shortest and p the travelled length [m]; arrays (n,).
    """
    longer = np.maximum(np.maximum(travelled, shortest), 1e-9)
    return float(np.mean(np.where(success, shortest / longer, 0.0)))


def barn_score(
    success: BoolArray, path_length: FloatArray, time: FloatArray, clip: tuple[float, float]
) -> FloatArray:
    """Return the BARN challenge's score of each run, shape (n,).

    s = success x OT / clip(AT, low OT, high OT), OT = path length [m] / 2 m/s, AT = time [s].
    ``clip`` is (2, 8) since 2024 (at most 0.5) and (4, 8) in 2022 and 2023 (at most 0.25).
    """
    optimal = path_length / 2.0
    low, high = clip
    return success * optimal / np.clip(time, low * optimal, high * optimal)
