# SPDX-License-Identifier: Apache-2.0
"""The least-squares problem of fitting a base: residuals in standard deviations, and a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.base_model import HIGH, LOW, NAMES, Drive, FloatArray, predict
from pm01_nav.robot import RobotSpec

BoolArray = NDArray[np.bool_]
MOST_STEPS = 60
SOFT = 2.0
"""Errors beyond so many standard deviations count by their size, not their square."""
PRIOR_SCALE, PRIOR_SIDES, PRIOR_SEPARATION, PRIOR_LIMIT = 0.15, 0.1, 0.3, 0.05
"""Standard deviations of what is thought before a drive: of the wheels' mean and difference, of
their separation, and of the logarithm of a limit of speed below the described one."""
FASTEST = 0.97
"""The quantile of odometry's speeds that stands for the fastest one: spikes are rarer."""


@dataclass(frozen=True)
class Problem:
    """Drives of one robot, and what is known of it."""

    drives: tuple[Drive, ...]
    used: BoolArray
    """Which odometry counts, shape (n,)."""
    noise: FloatArray
    """Standard deviation of odometry's v and w, shape (2,)."""
    described: FloatArray
    """The limits of speed: ahead, back, turning, shape (3,)."""
    weights: FloatArray | None = None
    """Of the used odometry, shape (m, 2): then errors count by their squares."""
    prior_weight: float = 1.0

    @classmethod
    def of(cls, drives: list[Drive], used: BoolArray, robot: RobotSpec) -> Problem:
        """Begin with a noise of a tenth of what the speeds vary by."""
        limits = robot.limits
        described = np.array([limits.linear_max, -limits.linear_min, limits.angular_max])
        measured = np.concatenate([drive.measured for drive in drives])[used]
        # By quantiles: spikes do not widen them.
        spread = np.quantile(np.abs(measured), 0.9, axis=0)
        noise = np.maximum(0.1 * spread, 1e-3)
        return cls(tuple(drives), used, noise, described)

    @cached_property
    def times(self) -> FloatArray:
        """Of the odometry [s], one drive after the other, shape (n,)."""
        return np.concatenate([drive.times for drive in self.drives])

    @cached_property
    def measured(self) -> FloatArray:
        """v, w by odometry, shape (n, 2)."""
        return np.concatenate([drive.measured for drive in self.drives])

    @cached_property
    def period(self) -> float:
        """The median time from one odometry to the next [s]."""
        return float(np.median(np.concatenate([np.diff(drive.times) for drive in self.drives])))

    @cached_property
    def asked(self) -> FloatArray:
        """The largest commands ahead, back and turning, shape (3,)."""
        commands = np.concatenate([drive.commands[1:] for drive in self.drives])
        v, w = commands[:, 0], commands[:, 1]
        return np.maximum([v.max(), -v.min(), np.abs(w).max()], 0.0)

    @cached_property
    def fastest(self) -> FloatArray:
        """The fastest speeds ahead, back and turning by odometry, shape (3,)."""
        v, w = self.measured[self.used].T
        found = np.array(
            [np.quantile(v, FASTEST), -np.quantile(v, 1.0 - FASTEST), np.quantile(abs(w), FASTEST)]
        )
        # A way that it was not driven has no limit.
        return np.where(found > 3.0 * self.noise[[0, 0, 1]], found, HIGH[7:])

    def without(self, rows: BoolArray) -> Problem:
        """Return the problem without some of its rows (n,)."""
        return replace(self, used=self.used & ~rows)

    def scaled(self, noise: FloatArray) -> Problem:
        """Return the problem with another ``noise``."""
        return replace(self, noise=noise)

    def weighted(self, weights: FloatArray) -> Problem:
        """Return the problem with weights (m, 2) instead of the robust loss."""
        return replace(self, weights=weights)

    def errors(self, parameters: FloatArray) -> FloatArray:
        """Return all errors in standard deviations, shape (n, 2)."""
        predicted = np.concatenate([predict(parameters, drive) for drive in self.drives])
        return (predicted - self.measured) / self.noise

    def residuals(self, parameters: FloatArray) -> FloatArray:
        """Return what is squared and added up: the used errors, and the prior's."""
        errors = self.errors(parameters)[self.used]
        if self.weights is not None:
            errors = errors * np.sqrt(self.weights)
        return np.concatenate([errors.ravel(), self._prior(parameters)])

    def _prior(self, parameters: FloatArray) -> FloatArray:
        left, right, separation = parameters[:3]
        slower = np.minimum(np.log(parameters[7:] / np.maximum(self.described, LOW[7:])), 0.0)
        wheels = (
            (0.5 * (left + right) - 1.0) / PRIOR_SCALE,
            (left - right) / PRIOR_SIDES,
            (separation - 1.0) / PRIOR_SEPARATION,
        )
        # A limit well below the described one is no less likely still: it would pull at the scale.
        slower = slower / np.hypot(PRIOR_LIMIT, slower)
        return self.prior_weight * np.concatenate([wheels, slower])

    def axis_cost(self, parameters: FloatArray, axis: int) -> float:
        """Return the soft cost of v or w alone."""
        return _soft_cost(self.errors(parameters)[self.used, axis])

    def cost_of(self, parameters: FloatArray) -> tuple[FloatArray, float]:
        """Return the parameters and their cost."""
        residuals = self.residuals(parameters)
        if self.weights is None:
            return parameters, _soft_cost(residuals)
        return parameters, 0.5 * float(residuals @ residuals)

    def solve(self, start: FloatArray, tolerance: float = 1e-6) -> tuple[FloatArray, float]:
        """Return the minimum downhill from ``start``, and its cost, to a relative tolerance."""
        from scipy.optimize import least_squares

        start = np.clip(start, LOW + 1e-6, HIGH - 1e-6)
        found = least_squares(
            self.residuals,
            start,
            bounds=(LOW, HIGH),
            x_scale="jac",
            loss="soft_l1" if self.weights is None else "linear",
            f_scale=SOFT,
            max_nfev=MOST_STEPS,
            xtol=1e-9,
            ftol=tolerance,
        )
        return np.asarray(found.x), float(found.cost)


STEPS = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.5, 1.0, 0.1, 0.1, 0.2])
"""Typical changes of the parameters."""
assert len(STEPS) == len(NAMES)


def _soft_cost(errors: FloatArray) -> float:
    """Return half of what scipy's soft_l1 makes of errors."""
    return float(SOFT**2 * (np.sqrt(1.0 + (errors / SOFT) ** 2) - 1.0).sum())


def noise_of(problem: Problem, parameters: FloatArray) -> FloatArray:
    """Return the standard deviation of v and w, shape (2,), by a quantile.

    A median would be that of a robot at rest where it rests most of the time; a mean would be that
    of the spikes.
    """
    errors = np.abs(problem.errors(parameters)[problem.used]) * problem.noise
    return np.maximum(np.quantile(errors, 0.8, axis=0) / 1.2816, 1e-4)


def robust_weights(problem: Problem, parameters: FloatArray) -> FloatArray:
    """Return how much each used error counts, shape (m, 2), by the soft loss."""
    errors = problem.errors(parameters)[problem.used]
    return 1.0 / np.sqrt(1.0 + (errors / SOFT) ** 2)
