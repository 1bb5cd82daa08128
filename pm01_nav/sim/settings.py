# SPDX-License-Identifier: Apache-2.0
"""What a task tells the simulator. Reading a task needs this, and so no compiler."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
PedestrianModel = Literal["orca", "social_force"]
ORCA, SOCIAL_FORCE = 0, 1
PEDESTRIAN_MODELS: dict[PedestrianModel, int] = {"orca": ORCA, "social_force": SOCIAL_FORCE}


class TrailParams(NamedTuple):
    """The trail as the kernels read it; see ``task.trail.TrailLayout``."""

    sectors: int = 0
    """0 keeps no trail."""
    interval_steps: int = 1
    capacity: int = 0
    reach: float = 1.0
    near: float = 1.0
    settled_places: int = 1


class Features(NamedTuple):
    """What is computed in each step because a task asks for it."""

    sectors: int = 0
    """Parts of the scan, as equal as can be, in each of which the nearest range is kept; 0 makes
    every beam a part."""
    trail: TrailParams = TrailParams()
    """How each robot's way so far is remembered."""
    path_distances: bool = False
    """Whether the length of the way to the goal is known; else it is the straight distance."""


SWITCHES = frozenset(n for n, v in Features._field_defaults.items() if isinstance(v, bool))
"""Features that need no more than to be asked for; others belong to a part of the observation."""


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
