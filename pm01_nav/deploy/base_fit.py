# SPDX-License-Identifier: Apache-2.0
"""Fit how a base answers commands: delay, lag, limits of acceleration, wheels.

The model is the simulator's: commands become wheel speeds by the nominal wheels and motion by the
true ones, late by a delay, with a first-order lag within limits of acceleration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]
GRID_S = 0.005
"""Time step of the model [s]."""
BLOCK_S = 2.0
"""Errors further apart than this are taken for independent [s]."""
NAMES = (
    "wheel_left_factor",
    "wheel_right_factor",
    "wheel_separation_factor",
    "command_delay_s",
    "actuator_lag",
    "linear_acceleration",
    "angular_acceleration",
)
LOW = np.array([0.5, 0.5, 0.5, 0.0, 1e-3, 0.05, 0.05])
HIGH = np.array([2.0, 2.0, 2.0, 0.6, 1.0, 50.0, 100.0])


class Estimate(NamedTuple):
    """A quantity with its 95 % confidence interval."""

    value: float
    low: float
    high: float


class BaseFit(NamedTuple):
    """The fitted base, and how well it explains the drive."""

    estimates: dict[str, Estimate]
    """By the names of ``NAMES``; a limit that the drive never reached has no upper end."""
    times: FloatArray
    """Of the odometry, shape (n,) [s]."""
    measured: FloatArray
    """v, w by odometry, shape (n, 2)."""
    predicted: FloatArray
    """v, w by the model, shape (n, 2)."""


@compiled
def respond(wanted, lag, acceleration, dt, answer):
    """Write into ``answer`` (n,) how one axis follows ``wanted`` (n,) from standing."""
    keep, change, speed = np.exp(-dt / lag), acceleration * dt, 0.0
    for k in range(wanted.shape[0]):
        step = (wanted[k] - speed) * (1.0 - keep)
        speed += min(max(step, -change), change)
        answer[k] = speed


class _Drive(NamedTuple):
    """A drive, prepared for the model."""

    grid: FloatArray
    command_times: FloatArray
    integral: FloatArray
    """Of the commands up to each of their times, shape (n, 2)."""
    last: FloatArray
    times: FloatArray
    measured: FloatArray
    scale: FloatArray
    """What errors of v and w are divided by."""
    separation: float


def fit_base(commands: FloatArray, odometry: FloatArray, robot: RobotSpec) -> BaseFit:
    """Fit the model to a drive: ``commands`` (n, 3) t, v, w; ``odometry`` (m, 3) t, v, w."""
    from scipy.optimize import least_squares

    drive = _prepare(commands, odometry, robot)
    limits = robot.limits
    best = None
    # The delay has several minima, a command apart; the least of them is the true one.
    for delay in (0.01, 0.06, 0.12, 0.2, 0.3):
        start = np.array(
            [1.0, 1.0, 1.0, delay, 0.08, limits.linear_acceleration, limits.angular_acceleration]
        )
        start = np.clip(start, LOW + 1e-6, HIGH - 1e-6)
        found = least_squares(
            _errors, start, bounds=(LOW, HIGH), x_scale=start, args=(drive,), max_nfev=40
        )
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    spread = _spread(best.x, drive)
    estimates = {}
    for name, value, half in zip(NAMES, best.x, 1.96 * spread, strict=True):
        estimates[name] = Estimate(float(value), float(value - half), float(value + half))
    return BaseFit(estimates, drive.times, drive.measured, _predict(best.x, drive))


def _prepare(commands: FloatArray, odometry: FloatArray, robot: RobotSpec) -> _Drive:
    begin = commands[0, 0]
    odometry = odometry[(odometry[:, 0] > begin) & (odometry[:, 0] < commands[-1, 0])]
    grid = np.arange(begin, odometry[-1, 0] + GRID_S, GRID_S)
    held = np.diff(commands[:, 0])[:, None] * commands[:-1, 1:]
    integral = np.concatenate([np.zeros((1, 2)), np.cumsum(held, axis=0)])
    scale = np.maximum(odometry[:, 1:3].std(axis=0), 1e-3)
    return _Drive(
        grid,
        commands[:, 0],
        integral,
        commands[-1, 1:],
        odometry[:, 0],
        odometry[:, 1:3],
        scale,
        robot.wheels.separation,
    )


def _delayed(drive: _Drive, delay: float) -> FloatArray:
    """Return the mean command of each step of the grid, late by ``delay``, shape (n, 2).

    Means make it smooth in the delay, which may be any part of a step.
    """
    edges = np.append(drive.grid, drive.grid[-1] + GRID_S) - delay
    sums = np.stack(
        [np.interp(edges, drive.command_times, drive.integral[:, axis]) for axis in (0, 1)], axis=-1
    )
    return np.diff(sums, axis=0) / GRID_S


def _predict(parameters: FloatArray, drive: _Drive) -> FloatArray:
    """Return v, w at the times of the odometry, shape (n, 2)."""
    left, right, separation, delay, lag, linear, angular = parameters
    command = _delayed(drive, delay)
    across = 0.5 * drive.separation * command[:, 1]
    wheel_left, wheel_right = left * (command[:, 0] - across), right * (command[:, 0] + across)
    wanted = np.stack(
        [
            0.5 * (wheel_left + wheel_right),
            (wheel_right - wheel_left) / (drive.separation * separation),
        ],
        axis=-1,
    )
    answer = np.empty((2, len(wanted)))
    for axis, acceleration in enumerate((linear, angular)):
        respond(np.ascontiguousarray(wanted[:, axis]), lag, acceleration, GRID_S, answer[axis])
    ends = drive.grid + GRID_S
    return np.stack([np.interp(drive.times, ends, answer[axis]) for axis in (0, 1)], axis=-1)


def _errors(parameters: FloatArray, drive: _Drive) -> FloatArray:
    return ((_predict(parameters, drive) - drive.measured) / drive.scale).ravel()


def _spread(parameters: FloatArray, drive: _Drive) -> FloatArray:
    """Return the standard error of each parameter, with errors that last as long as a block.

    The sandwich of Huber (1967) with blocks for clusters. What the drive does not show is infinite.
    """
    base = _errors(parameters, drive)
    steps = np.maximum(1e-4 * np.abs(parameters), 1e-5)
    jacobian = np.empty((len(base), len(parameters)))
    for k, step in enumerate(steps):
        moved = parameters.copy()
        moved[k] += step
        jacobian[:, k] = (_errors(moved, drive) - base) / step
    seen = np.abs(jacobian).max(axis=0) > 1e-9
    spread = np.full(len(parameters), np.inf)
    shown = jacobian[:, seen]
    bread = np.linalg.pinv(shown.T @ shown)
    block = np.repeat(((drive.times - drive.times[0]) / BLOCK_S).astype(int), 2)
    scores = np.zeros((block.max() + 1, shown.shape[1]))
    np.add.at(scores, block, shown * base[:, None])
    spread[seen] = np.sqrt(np.diag(bread @ (scores.T @ scores) @ bread))
    return spread
