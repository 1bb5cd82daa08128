# SPDX-License-Identifier: Apache-2.0
"""Fit how a base answers commands: delay, lag, limits of speed and acceleration, wheels.

Robust least squares from many starts, since delay, lag and limits can stand in for each other. A
weak prior keeps scales at 1 and limits as described where a drive cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pm01_nav.deploy.base_intervals import Estimate, intervals
from pm01_nav.deploy.base_model import HIGH, LOW, FloatArray, predict, prepare
from pm01_nav.deploy.base_problem import BoolArray, Problem, noise_of, robust_weights
from pm01_nav.deploy.base_rows import Segment, commands_known, deviating, goes_on, spikes
from pm01_nav.robot import RobotSpec

START_DELAYS = (0.0, 0.04, 0.08, 0.13, 0.18, 0.24, 0.3, 0.4, 0.6)
START_LAGS = (0.01, 0.08, 0.25)
START_ACCELERATIONS = ((0.3, 0.6), (0.8, 2.0), (2.0, 6.0), (50.0, 100.0))
"""Linear [m/s^2] and angular [rad/s^2]."""
KEPT_STARTS = 5
KEPT_MINIMA = 3
CLEAR_COST = 10.0
"""A limit below the described one must explain so much (half of chi squared)."""
LIMITS = (7, 8, 9)


class BaseFit(NamedTuple):
    """The fitted base, and how well it explains the drives."""

    estimates: dict[str, Estimate]
    """By the names of ``base_model.NAMES``; infinite where the drives show nothing."""
    not_shown: dict[str, str]
    """Why a quantity is not known, by its name."""
    times: FloatArray
    """Of the odometry, one drive after the other, shape (n,) [s]."""
    measured: FloatArray
    """v, w by odometry, shape (n, 2)."""
    predicted: FloatArray
    """v, w by the model, shape (n, 2)."""
    used: BoolArray
    """False for what was left out, shape (n,)."""
    segments: tuple[Segment, ...]
    """What was left out for longer than a moment, and why."""
    spikes: int
    """Single odometries that were left out."""


def fit_base(commands: FloatArray, odometry: FloatArray, robot: RobotSpec) -> BaseFit:
    """Fit the model to a drive: ``commands`` (n, 3) t, v, w; ``odometry`` (m, 3) t, v, w."""
    return fit_drives([(commands, odometry)], robot)


def fit_drives(drives: Sequence[tuple[FloatArray, FloatArray]], robot: RobotSpec) -> BaseFit:
    """Fit the model to several drives of one robot."""
    prepared = [prepare(c, o[:, :3], robot.driven_wheels.separation) for c, o in drives]
    known = np.concatenate([commands_known(drive) for drive in prepared])
    problem = Problem.of(prepared, known, robot)
    best, others = _fit(problem)
    if goes_on(problem, best):
        known[:] = True
        problem = replace(problem, used=known)
    spiky = spikes(problem, best)
    strange = deviating(problem, best)
    problem = problem.without(spiky | strange)
    problem = problem.scaled(noise_of(problem, best))
    best, others = _refine(problem, [best, *others])
    best = _plain(problem, best)
    weighted = problem.weighted(robust_weights(problem, best))
    estimates, not_shown = intervals(weighted, best, others)
    segments = Segment.of(prepared, ~known, "no commands came")
    segments += Segment.of(prepared, strange, "did not follow its commands")
    predicted = np.concatenate([predict(best, drive) for drive in prepared])
    return BaseFit(
        estimates,
        not_shown,
        problem.times,
        problem.measured,
        predicted,
        problem.used,
        tuple(sorted(segments)),
        int(spiky.sum()),
    )


def _fit(problem: Problem) -> tuple[FloatArray, list[FloatArray]]:
    """Return the best solution and other minima, whatever the robot is described as."""
    best, others = _refine(problem, _starts(problem), 1e-4)
    # What is noise and what is not shows only now.
    return _refine(problem.scaled(noise_of(problem, best)), [best, *others])


def _refine(
    problem: Problem, starts: list[FloatArray], tolerance: float = 1e-6
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the best of the minima that the starts lead to, and the others."""
    found = sorted((problem.solve(start, tolerance) for start in starts), key=lambda one: one[1])
    return found[0][0], [solution for solution, _ in found[1:KEPT_MINIMA]]


def _starts(problem: Problem) -> list[FloatArray]:
    """Return the most likely corners of a grid; each axis chooses its limits by itself."""
    rated = []
    for delay in START_DELAYS:
        for lag in START_LAGS:
            start = np.array([1.0, 1.0, 1.0, delay, lag, 0.0, 0.0, *HIGH[7:]])
            total = 0.0
            for axis in (0, 1):
                cost, choice = min(
                    (problem.axis_cost(_with(start, axis, *option), axis), n)
                    for n, option in enumerate(_options(problem, axis))
                )
                start = _with(start, axis, *_options(problem, axis)[choice])
                total += cost
            rated.append((total, tuple(start)))
    best = [np.array(start) for _, start in sorted(rated)[:KEPT_STARTS]]
    # A limit of speed is not found by going downhill from where it does not matter.
    cut = best[0].copy()
    cut[list(LIMITS)] = problem.fastest
    return [*best, cut]


def _options(problem: Problem, axis: int) -> list[tuple[float, FloatArray]]:
    limits = [HIGH[7:], problem.fastest]
    return [(pair[axis], limit) for pair in START_ACCELERATIONS for limit in limits]


def _with(start: FloatArray, axis: int, acceleration: float, limits: FloatArray) -> FloatArray:
    changed = start.copy()
    changed[5 + axis] = acceleration
    for k in (7, 8) if axis == 0 else (9,):
        changed[k] = limits[k - 7]
    return np.clip(changed, LOW + 1e-6, HIGH - 1e-6)


def _plain(problem: Problem, best: FloatArray) -> FloatArray:
    """Return the solution without limits of speed that explain next to nothing.

    Where a command asked for more than the base is said to do, its limit stays.
    """
    _, cost = problem.cost_of(best)
    for k in LIMITS:
        if best[k] >= problem.asked[k - 7] or problem.asked[k - 7] > problem.described[k - 7]:
            continue
        free = best.copy()
        free[k] = HIGH[k]
        solution, without = problem.solve(free)
        if without - cost < CLEAR_COST:
            best, cost = solution, without
    return best
