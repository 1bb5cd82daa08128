# SPDX-License-Identifier: Apache-2.0
"""How well drives determine a base: a bootstrap over blocks of seconds, and what is not shown."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pm01_nav.deploy.base_model import HIGH, LOW, NAMES, FloatArray
from pm01_nav.deploy.base_problem import STEPS, Problem
from pm01_nav.deploy.base_rows import blocks

DRAWS = 120
IDLE_STEP, IDLE_CHANGE = 0.03, 0.01
"""A limit plays no part if a change by 3 % changes chi squared by less: it is not known to 30 %."""
REFIT_STEPS = 5
NEAR_COST = 30.0
"""Minima that fit worse by more than this, half of chi squared, do not come first in any draw."""
WEAK = 0.1
"""The prior's part in asking what the drives alone tell."""
STAMP_S, STAMP_SHARE = 0.001, 0.05
"""No drive tells a time better than 1 ms and a twentieth of odometry's period: stamps and firmware
have steps of their own."""
FACTOR_SHARE, LIMIT_SHARE = 0.002, 0.01
"""Nor other quantities better than this: stamps that jitter round the corners of every answer."""
MOMENTS = 3.0
"""What shows in fewer blocks may be chance."""
AT_LIMIT = "the base drove at its limit of speed nearly whenever it was asked to drive"
TIMES = ("command_delay_s", "actuator_lag")
CLEAR = {"factor": 0.1, "s": 0.3, "acceleration": 3.0, "limit": 1.2}
"""What counts as known: half of the interval of a factor, the interval of a time [s], and upper by
lower end of a limit."""


class Estimate(NamedTuple):
    """A quantity with its 95 % confidence interval."""

    value: float
    low: float
    high: float


def intervals(
    problem: Problem, best: FloatArray, others: list[FloatArray]
) -> tuple[dict[str, Estimate], dict[str, str]]:
    """Return all estimates, and for those that are not known the reason."""
    draws = _draws(problem, best, others)
    half = 1.96 * _spread(problem, best)
    moments = _moments(problem, best)
    estimates, not_shown = {}, {}
    for k, name in enumerate(NAMES):
        value, wider = float(best[k]), _student(moments[k])
        low, high = np.quantile(draws[:, k], [0.025, 0.975], method="closest_observation")
        low = value + wider * (min(low, value) - value)
        high = value + wider * (max(high, value) - value)
        floor = _floor(problem, name, value)
        low, high = value - np.hypot(value - low, floor), value + np.hypot(high - value, floor)
        if k < 3:
            # The prior holds a scale that the drive does not show: its own spread tells.
            low, high = min(low, value - half[k]), max(high, value + half[k])
        found = _physical(problem, name, Estimate(value, float(low), float(high)))
        reason = _reason(problem, name, found)
        if not reason and moments[k] < MOMENTS:
            reason = "it shows in one or two moments only"
        if reason:
            not_shown[name] = reason
        estimates[name] = found
    if set(NAMES[7:]) - not_shown.keys():
        # What it did where it was asked too much shows a limit and not a scale.
        changed = {name: AT_LIMIT for name in not_shown if name.endswith("_factor")}
        not_shown |= changed
    return estimates, not_shown


def _draws(problem: Problem, best: FloatArray, others: list[FloatArray]) -> FloatArray:
    """Return the solutions with blocks weighed by chance, (draws, parameters).

    The Bayesian bootstrap (Rubin 1981): weights from an exponential distribution, so that no block
    is missing altogether. Limits that play no part in a draw are infinite.
    """
    rng = np.random.default_rng(0)
    number = blocks(problem)[problem.used]
    starts = [_Start.at(problem, one) for one in (best, *_distinct(problem, best, others))]
    found = []
    for _ in range(DRAWS):
        # The law is Exp(1).
        chance = rng.exponential(size=int(number.max()) + 1)[number]
        weights = np.append(np.repeat(chance, 2), np.ones(len(starts[0].base) - 2 * len(chance)))
        start = min(starts, key=lambda one: float(weights @ one.base**2))
        found.append(_idle_as_infinite(problem, _refit(problem, start, weights)))
    return np.array(found)


class _Start(NamedTuple):
    """A minimum, and how the residuals change around it."""

    parameters: FloatArray
    base: FloatArray
    jacobian: FloatArray

    @classmethod
    def at(cls, problem: Problem, parameters: FloatArray) -> _Start:
        """Return the minimum at some parameters."""
        return cls(parameters, problem.residuals(parameters), _jacobian(problem, parameters))


def _refit(problem: Problem, start: _Start, weights: FloatArray) -> FloatArray:
    """Return the minimum with other weights, by steps that all use the Jacobian of the first."""
    from scipy.optimize import lsq_linear

    now, residuals = start.parameters, start.base
    cost = float(weights @ residuals**2)
    root = np.sqrt(weights)
    # A small part of the identity keeps what the drive does not show where it is.
    table = np.concatenate([start.jacobian * root[:, None] * STEPS, 1e-3 * np.eye(len(now))])
    turned, triangle = np.linalg.qr(table)
    for _ in range(REFIT_STEPS):
        target = -turned.T @ np.append(residuals * root, np.zeros(len(now)))
        reach = (LOW - now) / STEPS - 1e-9, (HIGH - now) / STEPS + 1e-9
        step = lsq_linear(triangle, target, bounds=reach).x * STEPS
        moved = np.clip(now + step, LOW, HIGH)
        there = problem.residuals(moved)
        if float(weights @ there**2) >= cost:
            moved = np.clip(now + 0.3 * step, LOW, HIGH)
            there = problem.residuals(moved)
            if float(weights @ there**2) >= cost:
                break
        now, residuals, cost = moved, there, float(weights @ there**2)
        if np.abs(step / STEPS).max() < 1e-3:
            break
    return now


def _jacobian(problem: Problem, parameters: FloatArray, share: float = 0.01) -> FloatArray:
    """Return the change of the residuals with each parameter, by steps of a share of STEPS."""
    base, columns = problem.residuals(parameters), []
    for k, step in enumerate(share * STEPS):
        moved = parameters.copy()
        moved[k] += step if parameters[k] + step < HIGH[k] else -step
        columns.append((problem.residuals(moved) - base) / (moved[k] - parameters[k]))
    return np.stack(columns, axis=1)


def _distinct(problem: Problem, best: FloatArray, others: list[FloatArray]) -> list[FloatArray]:
    """Return other minima that a draw may prefer."""
    _, cost = problem.cost_of(best)
    kept: list[FloatArray] = []
    for one in others:
        apart = all(np.abs((one - known) / STEPS).max() > 0.2 for known in (best, *kept))
        if apart and problem.cost_of(one)[1] < cost + NEAR_COST:
            kept.append(one)
    return kept


def _idle_as_infinite(problem: Problem, solution: FloatArray) -> FloatArray:
    """Return the solution with limits infinite that change next to nothing."""
    here, shown = problem.errors(solution)[problem.used], solution.copy()
    for k in range(5, len(NAMES)):
        moved = solution.copy()
        moved[k] = solution[k] * (1.0 - IDLE_STEP)
        changed = problem.errors(moved)[problem.used] - here
        if float((changed**2).sum()) < IDLE_CHANGE or solution[k] > 0.95 * HIGH[k]:
            shown[k] = np.inf
    return shown


def _spread(problem: Problem, best: FloatArray) -> FloatArray:
    """Return the standard error of each parameter with next to no prior."""
    # With larger steps the corners of answers would tell apart what only they tell.
    jacobian = _jacobian(replace(problem, prior_weight=WEAK), best, 1e-5)
    seen = np.abs(jacobian).max(axis=0) > 1e-9
    spread = np.full(len(best), np.inf)
    shown = jacobian[:, seen]
    spread[seen] = np.sqrt(np.diag(np.linalg.pinv(shown.T @ shown)))
    return spread


def _moments(problem: Problem, best: FloatArray) -> FloatArray:
    """Return in how many blocks each parameter shows, by Kish's effective number of weights."""
    number = blocks(problem)[problem.used]
    rows = _jacobian(problem, best)[: 2 * len(number)] ** 2
    told = np.zeros((int(number.max()) + 1, len(best)))
    np.add.at(told, np.repeat(number, 2), rows)
    return told.sum(axis=0) ** 2 / np.maximum((told**2).sum(axis=0), 1e-30)


def _student(count: float) -> float:
    """Return by how much an interval from ``count`` blocks is wider than one from many."""
    from scipy.stats import t

    freedom = max(count - 1.0, 0.5)
    return float(t.ppf(0.975, freedom) / 1.96 * np.sqrt((freedom + 1.0) / freedom))


def _floor(problem: Problem, name: str, value: float) -> float:
    if name in TIMES:
        return STAMP_S + STAMP_SHARE * problem.period
    return (FACTOR_SHARE if name.endswith("_factor") else LIMIT_SHARE) * value


def _physical(problem: Problem, name: str, found: Estimate) -> Estimate:
    """Return the estimate within what can be."""
    if name not in TIMES:
        return Estimate(found.value, max(found.low, 0.0), found.high)
    # Between two odometries a short time is none.
    low = found.low if found.low > 0.5 * problem.period or name != "actuator_lag" else 0.0
    return Estimate(*(max(value, 0.0) for value in (found.value, low, found.high)))


def _reason(problem: Problem, name: str, found: Estimate) -> str:
    """Return why a quantity is not known; empty if it is."""
    if name.endswith("_factor"):
        known = found.high - found.low < 2.0 * CLEAR["factor"]
        return "" if known else "too little driving, or too little turning"
    if name.endswith("_acceleration"):
        axis = NAMES.index(name) - 5
        # A change that is over before the next odometry shows no limit.
        seen = (
            max(problem.asked[:2] if axis == 0 else problem.asked[2:])
            > found.value * problem.period
        )
        known = found.low > 0.0 and found.high / found.low < CLEAR["acceleration"] and seen
        return "" if known else "the drive never reached it, or not clearly"
    if name in ("linear_max", "linear_min", "angular_max"):
        asked = problem.asked[NAMES.index(name) - 7]
        known = found.high < asked and found.high / max(found.low, 1e-9) < CLEAR["limit"]
        return "" if known else "the drive never asked for more than the base gave"
    known = found.high - found.low < CLEAR["s"]
    return "" if known else "too few changes of speed, or odometry that is too slow"
