# SPDX-License-Identifier: Apache-2.0
"""What many runs say together: interquartile means with bootstrap intervals.

After Agarwal et al. 2021 ("Deep Reinforcement Learning at the Edge of the Statistical Precipice",
the library rliable): the mean of the middle half of all scores, runs drawn anew within each task.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

RESAMPLES = 2000
CONFIDENCE = 0.95


def interquartile_mean(scores: NDArray[np.float64], axis: int = -1) -> Any:
    """Return the mean of the middle half of the scores along ``axis``."""
    return trim_mean(scores, 0.25, axis=axis)


def iqm_with_interval(scores: NDArray[np.float64]) -> dict[str, Any]:
    """Return the IQM of ``scores`` (runs, tasks) and its 95 % bootstrap interval.

    Runs are drawn within each task (stratified). One run alone has no interval.
    """
    scores = np.asarray(scores, dtype=np.float64)
    iqm = float(interquartile_mean(scores.ravel()))
    if len(scores) < 2 or np.ptp(scores, axis=0).max() == 0.0:
        return {"iqm": iqm, "ci95": None if len(scores) < 2 else [iqm, iqm]}

    def statistic(*samples: NDArray[np.float64], axis: int = -1) -> Any:
        return interquartile_mean(np.concatenate(samples, axis=axis), axis=axis)

    found = bootstrap(
        tuple(scores.T),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(0),
    ).confidence_interval
    return {"iqm": iqm, "ci95": [float(found.low), float(found.high)]}


def time_to(success: Sequence[float], seconds: Sequence[float], level: float) -> float | None:
    """Return when an evaluation first reached ``level`` [s], None if none did."""
    for rate, second in zip(success, seconds, strict=True):
        if rate >= level:
            return float(second)
    return None


def curves_at(
    times: NDArray[np.float64], curves: Sequence[tuple[Sequence[float], Sequence[float]]]
) -> NDArray[np.float64]:
    """Return each curve (x, y) at ``times``, shape (curves, times); NaN before its first point."""
    rows = np.full((len(curves), len(times)), np.nan)
    for row, (x, y) in zip(rows, curves, strict=True):
        if len(x):
            row[:] = np.where(times < x[0], np.nan, np.interp(times, x, y))
    return rows
