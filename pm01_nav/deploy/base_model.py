# SPDX-License-Identifier: Apache-2.0
"""How a base answers commands, solved exactly between commands and odometry.

The model is the simulator's. A command comes late, is cut to what the base can do, becomes wheel
speeds by the nominal wheels and motion by the true ones. Each speed follows by
dv/dt = clip((wanted - v) / lag, -acceleration, acceleration).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled

FloatArray = NDArray[np.float64]
NAMES = (
    "wheel_left_factor",
    "wheel_right_factor",
    "wheel_separation_factor",
    "command_delay_s",
    "actuator_lag",
    "linear_acceleration",
    "angular_acceleration",
    "linear_max",
    "linear_min",
    "angular_max",
)
"""The parameters in the model's order; ``linear_min`` is the speed backwards, not negative."""
LOW = np.array([0.8, 0.8, 0.5, -0.1, 1e-3, 0.02, 0.05, 0.01, 0.01, 0.02])
"""Wheels are a few percent off, skid steer's separation more; a clock's error is a delay < 0."""
HIGH = np.array([1.25, 1.25, 2.5, 1.0, 1.0, 50.0, 100.0, 20.0, 20.0, 50.0])


class Drive(NamedTuple):
    """A drive, prepared for the model."""

    command_times: FloatArray
    """When commands came, the first one long ago, shape (n,) [s]."""
    commands: FloatArray
    """v, w, shape (n, 2); the first one keeps the speed at the start."""
    times: FloatArray
    """Of the odometry, shape (m,) [s]."""
    measured: FloatArray
    """v, w by odometry, shape (m, 2)."""
    separation: float
    """Of the wheels as described [m]."""


@compiled
def _follow(speed, wanted, lag, acceleration, seconds):
    """Return the speed after some time with one command."""
    error = wanted - speed
    even = abs(error) / acceleration - lag
    if even > 0.0:
        if seconds <= even:
            return speed + math.copysign(acceleration * seconds, error)
        seconds -= even
        error = math.copysign(acceleration * lag, error)
    return wanted - error * math.exp(-seconds / lag)


@compiled
def _wanted(command, p, separation, wanted):
    """Write into ``wanted`` (2,) what the true wheels make of a command."""
    v = min(max(command[0], -p[8]), p[7])
    w = min(max(command[1], -p[9]), p[9])
    left, right = p[0] * (v - 0.5 * separation * w), p[1] * (v + 0.5 * separation * w)
    wanted[0] = 0.5 * (left + right)
    wanted[1] = (right - left) / (separation * p[2])


@compiled(allocates=True)
def _respond(command_times, commands, times, p, separation, speed, out):
    """Write v, w at ``times`` (m,) into ``out`` (m, 2); ``speed`` (2,) is that at the start."""
    wanted = np.empty(2)
    now, k, last = times[0], 0, command_times.shape[0] - 1
    while k < last and command_times[k + 1] + p[3] <= now:
        k += 1
    _wanted(commands[k], p, separation, wanted)
    for row in range(times.shape[0]):
        while k < last and command_times[k + 1] + p[3] <= times[row]:
            then = max(command_times[k + 1] + p[3], now)
            for axis in range(2):
                speed[axis] = _follow(speed[axis], wanted[axis], p[4], p[5 + axis], then - now)
            now, k = then, k + 1
            _wanted(commands[k], p, separation, wanted)
        for axis in range(2):
            speed[axis] = _follow(speed[axis], wanted[axis], p[4], p[5 + axis], times[row] - now)
            out[row, axis] = speed[axis]
        now = times[row]


def prepare(commands: FloatArray, odometry: FloatArray, separation: float) -> Drive:
    """Prepare ``commands`` (n, 3) and ``odometry`` (m, 3), both t, v, w in order of time.

    Odometry from before the first command and after the last one is left out.
    """
    during = (odometry[:, 0] >= commands[0, 0]) & (odometry[:, 0] <= commands[-1, 0])
    odometry = np.asarray(odometry[during, :3], dtype=np.float64)
    before = [[-np.inf, *_start(odometry[0, 1:], commands)]] if len(odometry) else []
    commands = np.array([*before, *commands[:, :3]], dtype=np.float64)
    times, measured = odometry[:, 0].copy(), odometry[:, 1:].copy()
    return Drive(commands[:, 0].copy(), commands[:, 1:].copy(), times, measured, separation)


def predict(parameters: FloatArray, drive: Drive) -> FloatArray:
    """Return v, w at the times of the odometry, shape (m, 2)."""
    answer = np.empty_like(drive.measured)
    d, speed = drive, drive.commands[0].copy()
    _respond(d.command_times, d.commands, d.times, parameters, d.separation, speed, answer)
    return answer


def _start(measured: FloatArray, commands: FloatArray) -> FloatArray:
    """Return the speed at the start, which may be a spike: no faster than any command."""
    least = np.minimum(commands[:, 1:3].min(axis=0), 0.0)
    most = np.maximum(commands[:, 1:3].max(axis=0), 0.0)
    return np.clip(measured, least, most)
