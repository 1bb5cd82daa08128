# SPDX-License-Identifier: Apache-2.0
"""Whether one entry is better than another on the same episodes, or only luckier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pm01_nav.benchmark.merge import Score

RESAMPLES = 5000
SEED = 0

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """How much better ``first`` is than ``second``, world by world."""

    suite: str
    first: str
    second: str
    episodes: int
    """That both have driven."""
    success_difference: float
    """Mean difference of success, between -1 and 1."""
    success_ci95: tuple[float, float]
    time_difference_s: float | None
    """Mean difference of the time to the goal where both reached it [s]."""
    time_ci95_s: tuple[float, float] | None

    @property
    def significant(self) -> bool:
        """Whether the interval of the difference of success leaves out zero."""
        low, high = self.success_ci95
        return low > 0.0 or high < 0.0


def compare(first: Score, second: Score, control_dt: float) -> Comparison:
    """Compare two entries on the episodes that both have driven.

    Intervals are from a paired bootstrap (Efron and Tibshirani 1993): worlds are drawn again with
    replacement, each with all its episodes and both entries' outcomes.
    """
    _, mine, theirs = np.intersect1d(first.episode, second.episode, return_indices=True)
    world = first.results.world[mine]
    won, lost = first.results.success[mine], second.results.success[theirs]
    success, interval = paired_bootstrap(won.astype(np.float64) - lost.astype(np.float64), world)
    slower = control_dt * (first.results.steps[mine] - second.results.steps[theirs])
    both = won & lost
    time = paired_bootstrap(slower[both], world[both]) if both.any() else (None, None)
    return Comparison(first.suite, first.entry, second.entry, len(mine), success, interval, *time)


def paired_bootstrap(
    difference: NDArray[np.floating], world: NDArray[np.int64]
) -> tuple[float, tuple[float, float]]:
    """Return the mean of the worlds' mean differences and its 95 % interval (percentiles).

    ``difference`` and ``world`` have shape (n,), n at least 1. With one world, or the same
    difference in all, nothing is known of the spread and the interval is the mean itself.
    """
    _, index = np.unique(world, return_inverse=True)
    means = np.bincount(index, difference) / np.bincount(index)
    mean = float(means.mean())
    if len(means) == 1 or np.ptp(means) == 0.0:
        return mean, (mean, mean)
    interval = stats.bootstrap(
        (means,),
        np.mean,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return mean, (float(interval.low), float(interval.high))
