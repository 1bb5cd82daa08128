# SPDX-License-Identifier: Apache-2.0
"""What is wrong with each simulated robot in its present episode, and the law of each draw."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.sim.random import bits, uniform
from pm01_nav.sim.state import padded

FloatArray = NDArray[np.float64]
LEAST_COMMANDS = 3
"""So many commands are kept at least, as they are in the checkpoints of early versions."""
SLICES = 8
"""Parts of a scan that are cast from places of their own while the robot moves."""


class Perturbation(NamedTuple):
    """One number for each quantity that can be off, or its range.

    What the episodes drew: arrays of shape (num_envs,). What they draw from: least and greatest,
    shape (2,). Meanings and units stand in ``RandomizationConfig``, which has the same names, but
    for what takes time while the robot drives: here it counts in control steps of the simulator.
    """

    wheel_left_factor: FloatArray
    wheel_right_factor: FloatArray
    wheel_separation_factor: FloatArray
    acceleration_factor: FloatArray
    actuator_lag: FloatArray
    command_delay: FloatArray
    """[control steps], which need not be whole."""
    slip: FloatArray
    slip_noise: FloatArray
    control_jitter: FloatArray
    lidar_noise_std: FloatArray
    lidar_noise_share: FloatArray
    lidar_dropout: FloatArray
    lidar_range_factor: FloatArray
    lidar_x_error: FloatArray
    lidar_y_error: FloatArray
    lidar_yaw_error: FloatArray
    dark_share: FloatArray
    dark_range: FloatArray
    scan_delay: FloatArray
    """[control steps]; what is drawn is whole."""
    scan_sweep: FloatArray
    """[control steps]"""
    odometry_scale: FloatArray
    odometry_drift_per_m: FloatArray
    odometry_drift_per_rad: FloatArray
    goal_error: FloatArray
    footprint_padding: FloatArray


class ErrorState(NamedTuple):
    """What a perturbed robot has beside its ``SimState``; kernels write it in place."""

    dark_key: NDArray[np.uint64]
    """Decides which obstacles are dark in the present episode, shape (num_envs,)."""
    command: FloatArray
    """What the base aims at, errors of the wheels included, like ``SimState.twist``."""
    command_history: FloatArray
    """The latest commands, newest first, as many as may be on their way, (num_envs, n, axes)."""
    odometry_pose: FloatArray
    """Where the robot believes to be: x, y, yaw in the world [m, m, rad], (num_envs, 3)."""
    odometry_goal: FloatArray
    """Where it believes the goal to be: x, y in the world [m], shape (num_envs, 2)."""
    measured_goal: FloatArray
    """Distance and bearing of the goal as the robot believes [m, rad], shape (num_envs, 2)."""
    measured_twist: FloatArray
    """As odometry says, like ``SimState.twist``."""
    waiting_ranges: NDArray[np.float32]
    """The latest ranges, newest first, as many as may be on their way, side by side: shape
    (num_envs, n x beams of ``ranges``)."""
    dark_ranges: NDArray[np.float32]
    """Ranges of dark obstacles alone, like ``SimState.ranges``; used within a step."""
    slice_pose: FloatArray
    """x, y, cos, sin of the lidar for each part of a scan; used within a step."""


def new_errors(num_envs: int, num_beams: int, axes: int, ranges: Perturbation) -> ErrorState:
    """Return a state of zeros, with room for the longest delays of ``ranges``."""
    commands = max(math.ceil(ranges.command_delay[1]), LEAST_COMMANDS)
    scans = max(math.floor(ranges.scan_delay[1] + 0.5), 1)
    return ErrorState(
        dark_key=np.zeros(num_envs, dtype=np.uint64),
        command=np.zeros((num_envs, axes)),
        command_history=np.zeros((num_envs, commands, axes)),
        odometry_pose=np.zeros((num_envs, 3)),
        odometry_goal=np.zeros((num_envs, 2)),
        measured_goal=np.zeros((num_envs, 2)),
        measured_twist=np.zeros((num_envs, axes)),
        waiting_ranges=np.zeros((num_envs, scans * padded(num_beams)), dtype=np.float32),
        dark_ranges=np.zeros((num_envs, padded(num_beams)), dtype=np.float32),
        slice_pose=np.zeros((num_envs, SLICES, 4)),
    )


def new_perturbation(num_envs: int) -> Perturbation:
    """Return a perturbation of zeros; the first reset draws it."""
    return Perturbation(*(np.zeros(num_envs) for _ in Perturbation._fields))


def fastest_factor(ranges: Perturbation) -> float:
    """Return by how much a robot may travel further in a control step than it is said to."""
    wheels = max(ranges.wheel_left_factor[1], ranges.wheel_right_factor[1])
    return float(wheels * (1.0 + ranges.control_jitter[1]))


@compiled
def between(limits, key, count, i):
    """Draw from U(least, greatest)."""
    return limits[0] + (limits[1] - limits[0]) * uniform(key, count, i)


@compiled(inline=False)
def draw_errors(errors, drawn, ranges, key, count, i):
    """Draw what is wrong in the next episode of environment i; the last episode leaves no trace."""
    p, r = drawn, ranges
    # All are U(least, greatest) of their range; scans, of which there is one a step, are late by
    # whole steps, the nearest to what was drawn.
    p.wheel_left_factor[i] = between(r.wheel_left_factor, key, count, i)
    p.wheel_right_factor[i] = between(r.wheel_right_factor, key, count, i)
    p.wheel_separation_factor[i] = between(r.wheel_separation_factor, key, count, i)
    p.acceleration_factor[i] = between(r.acceleration_factor, key, count, i)
    p.actuator_lag[i] = between(r.actuator_lag, key, count, i)
    p.command_delay[i] = between(r.command_delay, key, count, i)
    p.slip[i] = between(r.slip, key, count, i)
    p.slip_noise[i] = between(r.slip_noise, key, count, i)
    p.control_jitter[i] = between(r.control_jitter, key, count, i)
    p.lidar_noise_std[i] = between(r.lidar_noise_std, key, count, i)
    p.lidar_noise_share[i] = between(r.lidar_noise_share, key, count, i)
    p.lidar_dropout[i] = between(r.lidar_dropout, key, count, i)
    p.lidar_range_factor[i] = between(r.lidar_range_factor, key, count, i)
    p.lidar_x_error[i] = between(r.lidar_x_error, key, count, i)
    p.lidar_y_error[i] = between(r.lidar_y_error, key, count, i)
    p.lidar_yaw_error[i] = between(r.lidar_yaw_error, key, count, i)
    p.dark_share[i] = between(r.dark_share, key, count, i)
    p.dark_range[i] = between(r.dark_range, key, count, i)
    p.scan_delay[i] = np.floor(between(r.scan_delay, key, count, i) + 0.5)
    p.scan_sweep[i] = between(r.scan_sweep, key, count, i)
    p.odometry_scale[i] = between(r.odometry_scale, key, count, i)
    p.odometry_drift_per_m[i] = between(r.odometry_drift_per_m, key, count, i)
    p.odometry_drift_per_rad[i] = between(r.odometry_drift_per_rad, key, count, i)
    p.goal_error[i] = between(r.goal_error, key, count, i)
    p.footprint_padding[i] = between(r.footprint_padding, key, count, i)
    # 64 fair bits: which obstacles are dark.
    errors.dark_key[i] = bits(key, count, i)
