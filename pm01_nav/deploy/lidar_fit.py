# SPDX-License-Identifier: Apache-2.0
"""A lidar's noise and dropout from scans at rest, and the true way between scans in motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.base_fit import Estimate
from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.motion_check import returns_as_points
from pm01_nav.deploy.scan_matching import evenness, match
from pm01_nav.geometry import to_frame, wrap_angle

FloatArray = NDArray[np.float64]
AT_REST = np.array([1e-3, 1e-3, 2e-3])
"""By odometry a robot at rest moves no further than this while three scans are taken [m, m, rad].

Speeds would not tell: some odometries are noisy, others say zero between two ticks of a wheel.
"""
SAME_SURFACE = (0.1, 0.1)
"""Ranges that differ by more than this [m] and this share of them are of two surfaces."""
SURE_SHARE = 0.85
"""Ranges up to this share of range_max are used."""
MIN_SAMPLES = 500
RESAMPLES = 200
PAIR_S = 0.8
"""Time between two scans that are matched [s]."""
MAX_PAIRS = 300
MIN_PAIRS = 10
EVEN = 0.1
"""So large a part of the walls must tell of each direction; noise turns some normals, too."""
SCALES = (0.8, 1.25)
"""An odometry that is further off, or not known to be nearer, was not measured."""


def fit_noise(rest: list[tuple[Scan, Scan, Scan]]) -> dict[str, Estimate]:
    """Fit noise and dropout to triples of successive scans at rest.

    A range's error has the variance ``lidar_noise_std``^2 + (``lidar_noise_share`` x range)^2; a
    beam that has a return before and after but none in between has lost it (``lidar_dropout``).
    """
    if not rest:
        return {}
    before, now, after = (
        np.stack([triple[k].ranges for triple in rest]).astype(np.float64) for k in range(3)
    )
    # Near the end of its range a lidar loses returns to noise: that is no dropout.
    longest = SURE_SHARE * rest[0][0].range_max
    both = (before < longest) & (now < longest)
    both &= _same_surface(before, now)
    if both.sum() < MIN_SAMPLES:
        return {}
    # The difference of two independent errors has twice the variance.
    before_used, now_used = np.where(both, before, 0.0), np.where(both, now, 0.0)
    squares, ranges = (now_used - before_used) ** 2 / 2.0, 0.5 * (now_used + before_used)
    rng = np.random.default_rng(0)
    draws = [rng.integers(0, len(rest), len(rest)) for _ in range(RESAMPLES)]
    drawn = np.array([_noise(squares[d], ranges[d], both[d]) for d in draws])
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0)
    std, share = _noise(squares, ranges, both)
    sure = (before < longest) & (after < longest)
    sure &= _same_surface(before, after)
    lost = int((sure & ~np.isfinite(now)).sum())
    return {
        "lidar_noise_std": Estimate(std, float(low[0]), float(high[0])),
        "lidar_noise_share": Estimate(share, float(low[1]), float(high[1])),
        "lidar_dropout": _proportion(lost, int(sure.sum())),
    }


def _same_surface(first: FloatArray, second: FloatArray) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.abs(second - first) < SAME_SURFACE[0] + SAME_SURFACE[1] * first


def _noise(squares: FloatArray, ranges: FloatArray, used: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the additive and the proportional part by weighted least squares on the variances."""
    square, length = squares[used], ranges[used]
    # The variance of a squared error grows with its square: weights from a first, plain fit.
    design = np.stack([np.ones_like(length), length**2], axis=-1)
    weight = np.ones_like(length)
    solution = np.zeros(2)
    for _ in range(3):
        weighted = design * weight[:, None]
        solution = np.linalg.lstsq(weighted, square * weight, rcond=None)[0]
        weight = 1.0 / np.maximum(design @ np.maximum(solution, 0.0), 1e-8)
    return math.sqrt(max(solution[0], 0.0)), math.sqrt(max(solution[1], 0.0))


def _proportion(count: int, total: int) -> Estimate:
    """Return a proportion with its Wilson interval."""
    if total == 0:
        return Estimate(math.nan, 0.0, 1.0)
    from scipy.stats import binomtest  # slow to import

    low, high = binomtest(count, total).proportion_ci(method="wilson")
    return Estimate(count / total, float(low), float(high))


def at_rest(scans: list[Scan], odometry: FloatArray) -> list[tuple[Scan, Scan, Scan]]:
    """Return successive scans during which odometry (n, 6) t, v, w, x, y, yaw hardly moves."""
    poses = odometry[:, 3:6].copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    triples = []
    for before, now, after in zip(scans, scans[1:], scans[2:], strict=False):
        # A scan takes a while, up to its stamp or from it on.
        turn = now.stamp - before.stamp
        first, last = np.searchsorted(odometry[:, 0], [before.stamp - turn, after.stamp + turn])
        during = poses[first:last]
        alike = len(before.ranges) == len(now.ranges) == len(after.ranges)
        if alike and len(during) > 1 and (np.ptp(during, axis=0) < AT_REST).all():
            triples.append((before, now, after))
    return triples


def fit_travel(
    drives: Sequence[tuple[list[Scan], FloatArray]], mount: FloatArray
) -> dict[str, Estimate]:
    """Compare odometry (n, 6) t, v, w, x, y, yaw with what scans say of the way.

    ``travel_scale`` is true travel by odometry's, ``turn_scale`` the same of turns; what is not
    known within ``SCALES`` is missing.
    """
    pairs = [pair for scans, odometry in drives for pair in _pairs(scans, odometry)]
    pairs = pairs[:: max(1, len(pairs) // MAX_PAIRS)]
    found = []
    for first, second, moved in pairs:
        points = [returns_as_points(scan, mount) for scan in (first, second)]
        if min(map(len, points)) == 0:
            continue
        pose = match(points[0], points[1], moved)
        if pose is not None and np.abs(pose - moved).max() < 0.2:
            found.append((*moved, *pose, evenness(points[0]) > EVEN))
    rows = np.array(found).reshape(-1, 7)
    way = rows[rows[:, 6] > 0.0]
    scales = {}
    if len(way) >= MIN_PAIRS:
        scales["travel_scale"] = _ratio(way[:, :2], way[:, 3:5])
    if len(rows) >= MIN_PAIRS:
        scales["turn_scale"] = _ratio(rows[:, 2:3], rows[:, 5:6])
    least, most = SCALES
    return {name: one for name, one in scales.items() if least < one.low and one.high < most}


def _pairs(scans: list[Scan], odometry: FloatArray) -> list[tuple[Scan, Scan, FloatArray]]:
    """Return scans some time apart, and the motion between them by odometry, (3,)."""
    if not scans or not len(odometry):
        return []
    stamps = np.array([scan.stamp for scan in scans])
    yaw = np.unwrap(odometry[:, 5])
    columns = (odometry[:, 3], odometry[:, 4], yaw)
    poses = np.stack([np.interp(stamps, odometry[:, 0], column) for column in columns], axis=-1)
    pairs = []
    for k, stamp in enumerate(stamps):
        later = int(np.searchsorted(stamps, stamp + PAIR_S))
        if later >= len(scans):
            break
        turn = float(wrap_angle(poses[later, 2] - poses[k, 2]))
        moved = np.array([*to_frame(poses[later, :2], poses[k]), turn])
        if np.hypot(*moved[:2]) > 0.1 or abs(turn) > 0.2:
            pairs.append((scans[k], scans[later], moved))
    return pairs


def _ratio(odometry: FloatArray, true: FloatArray) -> Estimate:
    """Return the factor from one to the other, robustly, with a bootstrap interval."""
    rng = np.random.default_rng(0)

    def factor(rows: NDArray[np.int64]) -> float:
        x, y = odometry[rows].ravel(), true[rows].ravel()
        keep = np.ones(len(x), dtype=bool)
        value = 1.0
        for _ in range(3):
            value = float((x[keep] @ y[keep]) / max(x[keep] @ x[keep], 1e-12))
            error = np.abs(y - value * x)
            keep = error <= 4.0 * np.median(error) + 1e-6
        return value

    # Pairs overlap: whole stretches are drawn, not single ones.
    count, stretch = len(odometry), 8
    starts = np.arange(0, count, stretch)
    draws = []
    for _ in range(RESAMPLES):
        chosen = rng.choice(starts, len(starts))
        rows = (chosen[:, None] + np.arange(stretch)).ravel()
        draws.append(factor(rows[rows < count]))
    low, high = np.percentile(draws, [2.5, 97.5])
    return Estimate(factor(np.arange(count)), float(low), float(high))
