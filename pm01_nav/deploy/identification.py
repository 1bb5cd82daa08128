# SPDX-License-Identifier: Apache-2.0
"""What a robot really is, from a recorded drive: its description, and ranges to train on."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pm01_nav.deploy.base_fit import BaseFit, Estimate, fit_base
from pm01_nav.deploy.lidar_fit import at_rest, fit_noise, fit_travel
from pm01_nav.deploy.recording import Recording
from pm01_nav.deploy.scan_check import by_rep_117
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.task.randomization import LONGEST_S, RandomizationConfig

MIN_COMMANDS, MIN_ODOMETRY = 50, 200
LIKELY_ACCELERATION = 3.0
"""A limit that is not known within this factor was not reached in the drive."""


class Identification(NamedTuple):
    """Everything that a drive tells of a robot."""

    base: BaseFit
    estimates: dict[str, Estimate]
    """Of base and lidar; what the drive does not show is missing."""


def identify(recording: Recording, robot: RobotSpec) -> Identification:
    """Fit base and lidar of ``robot`` to a drive.

    Raises:
        InputError: the drive is too short, or the robot stood.
    """
    commands, odometry = recording.commands, recording.odometry
    if len(commands) < MIN_COMMANDS or len(odometry) < MIN_ODOMETRY:
        raise InputError(
            f"drive: {len(commands)} commands and {len(odometry)} odometries; at least "
            f"{MIN_COMMANDS} and {MIN_ODOMETRY} are needed (pm01 record excite ...)"
        )
    if np.abs(odometry[:, 1:3]).max() < 0.02:
        raise InputError("drive: the robot stands all the time (try: pm01 drive excite ...)")
    base = fit_base(commands, odometry[:, :3], robot)
    lidar = robot.lidar
    mount = np.array([lidar.x, lidar.y, lidar.yaw])
    estimates = dict(base.estimates)
    for name in ("linear_acceleration", "angular_acceleration"):
        known = estimates[name]
        if not (known.low > 0.0 and known.high / known.low < LIKELY_ACCELERATION):
            del estimates[name]
    scans = [by_rep_117(scan, lidar.zero_means) for scan in recording.scans]
    if lidar.upside_down:
        scans = [scan.mirrored() for scan in scans]
    estimates |= fit_noise(at_rest(scans, odometry))
    estimates |= fit_travel(scans, odometry, mount)
    return Identification(base, estimates)


def identified_robot(robot: RobotSpec, estimates: dict[str, Estimate]) -> dict[str, Any]:
    """Return the robot's description with what was identified, as plain data."""
    data = robot.model_dump(mode="json")
    data["name"] = f"{robot.name}_identified"
    data["actuator"]["lag_s"] = _rounded(estimates["actuator_lag"].value)
    for name in ("linear_acceleration", "angular_acceleration"):
        if name in estimates:
            data["limits"][name] = _rounded(estimates[name].value)
    if "lidar_noise_std" in estimates:
        data["lidar"]["noise_std"] = _rounded(estimates["lidar_noise_std"].value)
    return data


def identified_ranges(robot: RobotSpec, estimates: dict[str, Estimate]) -> dict[str, Any]:
    """Return ranges for ``--randomization``: the intervals of what was identified."""
    travel = estimates.get("travel_scale", Estimate(1.0, 1.0, 1.0))
    ranges: dict[str, tuple[float, float]] = {}
    for name in ("wheel_left_factor", "wheel_right_factor"):
        # Odometry saw the wheels turn; travel over ground is what they do.
        ranges[name] = _product(estimates[name], travel)
    turn = estimates.get("turn_scale", Estimate(1.0, 1.0, 1.0))
    separation = estimates["wheel_separation_factor"]
    across = _product(separation, travel)
    ranges["wheel_separation_factor"] = (across[0] / turn.high, across[1] / turn.low)
    ranges["actuator_lag"] = _interval(estimates["actuator_lag"])
    low, high = _interval(estimates["command_delay_s"])
    ranges["command_delay_s"] = min(low, LONGEST_S), min(high, LONGEST_S)
    if "linear_acceleration" in estimates:
        known, nominal = estimates["linear_acceleration"], robot.limits.linear_acceleration
        ranges["acceleration_factor"] = (known.low / nominal, known.high / nominal)
    for name in ("lidar_noise_std", "lidar_noise_share", "lidar_dropout"):
        if name in estimates:
            ranges[name] = _interval(estimates[name])
    if "travel_scale" in estimates:
        ranges["odometry_scale"] = (1.0 / travel.high, 1.0 / travel.low)
    data: dict[str, Any] = {
        name: [_rounded(low), _rounded(high)] for name, (low, high) in ranges.items()
    }
    # Checked before it is written: a training must be able to read it.
    RandomizationConfig.model_validate(data)
    return data


def _interval(estimate: Estimate) -> tuple[float, float]:
    return max(estimate.low, 0.0), max(estimate.high, 0.0)


def _product(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Return the interval of a product of two independent quantities."""
    value = first.value * second.value
    relative = math.hypot(
        (first.high - first.low) / first.value, (second.high - second.low) / second.value
    )
    return value * (1.0 - 0.5 * relative), value * (1.0 + 0.5 * relative)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
