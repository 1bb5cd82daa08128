# SPDX-License-Identifier: Apache-2.0
"""What a robot really is, from a recorded drive: its description, and ranges to train on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pm01_nav.config import validate
from pm01_nav.deploy.base_fit import BaseFit, Estimate, fit_drives
from pm01_nav.deploy.excitation import check_identifiable
from pm01_nav.deploy.lidar_fit import at_rest, fit_noise, fit_travel
from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.recording import Recording
from pm01_nav.deploy.scan_check import by_rep_117
from pm01_nav.errors import InputError
from pm01_nav.robot import Lidar, RobotSpec
from pm01_nav.task.randomization import RandomizationConfig

MIN_COMMANDS, MIN_ODOMETRY = 20, 200
MOVING = 0.98
"""The quantile of odometry's speeds that tells whether it moved: spikes are rarer."""
LIMITS = ("linear_max", "linear_min", "angular_max", "linear_acceleration", "angular_acceleration")
TOLD_AS_THEY_ARE = (
    "command_delay_s",
    "actuator_lag",
    "lidar_noise_std",
    "lidar_noise_share",
    "lidar_dropout",
)
TOO_LITTLE_REST = "too few scans at rest"
TOO_LITTLE_MATCH = "scans do not tell the way between them: too little motion, or too little to see"
LIDAR_REASONS = {
    "lidar_noise_std": TOO_LITTLE_REST,
    "lidar_noise_share": TOO_LITTLE_REST,
    "lidar_dropout": TOO_LITTLE_REST,
    "travel_scale": TOO_LITTLE_MATCH,
    "turn_scale": TOO_LITTLE_MATCH,
}


class Identification(NamedTuple):
    """Everything that drives tell of a robot."""

    base: BaseFit
    estimates: dict[str, Estimate]
    """Of base and lidar; what the drives do not show is missing."""
    not_shown: dict[str, str]
    """Why a quantity is missing, by its name."""


def identify(recordings: Recording | Sequence[Recording], robot: RobotSpec) -> Identification:
    """Fit base and lidar of ``robot`` to a drive, or to several.

    Raises:
        InputError: the drives are too short, the robot stood, or its drive has no model.
    """
    check_identifiable(robot)
    drives = [recordings] if isinstance(recordings, Recording) else list(recordings)
    _check(drives)
    base = fit_drives([(one.commands, one.odometry[:, :3]) for one in drives], robot)
    estimates = {name: one for name, one in base.estimates.items() if name not in base.not_shown}
    lidar = robot.lidar
    mount = np.array([lidar.x, lidar.y, lidar.yaw])
    seen = [(_readings(one, lidar), one.odometry) for one in drives]
    rest = [triple for scans, odometry in seen for triple in at_rest(scans, odometry)]
    found = fit_noise(rest) | fit_travel(seen, mount)
    looked_for = LIDAR_REASONS if any(scans for scans, _ in seen) else {}
    missing = {name: why for name, why in looked_for.items() if name not in found}
    return Identification(base, estimates | found, base.not_shown | missing)


def _readings(drive: Recording, lidar: Lidar) -> list[Scan]:
    scans = [by_rep_117(scan, lidar.zero_means) for scan in drive.scans]
    return [scan.mirrored() for scan in scans] if lidar.upside_down else scans


def _check(drives: list[Recording]) -> None:
    commands = sum(len(one.commands) for one in drives)
    odometry = sum(len(one.odometry) for one in drives)
    if commands < MIN_COMMANDS or odometry < MIN_ODOMETRY:
        raise InputError(
            f"drive: {commands} commands and {odometry} odometries; at least "
            f"{MIN_COMMANDS} and {MIN_ODOMETRY} are needed (pm01 record excite ...)"
        )
    for one in drives:
        if min(len(one.commands), len(one.odometry)) < 2:
            raise InputError("drive: a bag, or its part, has no commands or no odometry")
    if (
        max(np.quantile(np.abs(one.odometry[:, 1:3]), MOVING, axis=0).max() for one in drives)
        < 0.02
    ):
        raise InputError("drive: the robot stands all the time (try: pm01 drive excite ...)")


def described(robot: RobotSpec) -> dict[str, float]:
    """Return what a robot is described as, by the names of the estimates."""
    values = {name: abs(float(getattr(robot.limits, name))) for name in LIMITS}
    values |= dict.fromkeys(("wheel_left_factor", "wheel_right_factor"), 1.0)
    values |= dict.fromkeys(("wheel_separation_factor", "travel_scale", "turn_scale"), 1.0)
    values |= {"command_delay_s": 0.0, "actuator_lag": robot.actuator.lag_s}
    return values | {"lidar_noise_std": robot.lidar.noise_std}


def identified_robot(robot: RobotSpec, estimates: dict[str, Estimate]) -> dict[str, Any]:
    """Return the robot's description with what was identified, as plain data.

    Raises:
        InputError: what was identified makes no robot.
    """
    data = robot.model_dump(mode="json")
    data["name"] = f"{robot.name}_identified"
    if "actuator_lag" in estimates:
        data["actuator"]["lag_s"] = _rounded(estimates["actuator_lag"].value)
    for name in LIMITS:
        if name in estimates:
            sign = -1.0 if name == "linear_min" else 1.0
            data["limits"][name] = sign * _rounded(estimates[name].value)
    if "lidar_noise_std" in estimates:
        data["lidar"]["noise_std"] = _rounded(estimates["lidar_noise_std"].value)
    validate(RobotSpec, data, f"robot {data['name']}")
    return data


def identified_ranges(robot: RobotSpec, estimates: dict[str, Estimate]) -> dict[str, Any]:
    """Return ranges for ``--randomization``: the intervals of what was identified."""
    travel = estimates.get("travel_scale", Estimate(1.0, 1.0, 1.0))
    turn = estimates.get("turn_scale", Estimate(1.0, 1.0, 1.0))
    ranges: dict[str, tuple[float, float]] = {}
    for name in ("wheel_left_factor", "wheel_right_factor"):
        if name in estimates:
            # Odometry saw the wheels turn; travel over ground is what they do.
            ranges[name] = _product(estimates[name], travel)
    if "wheel_separation_factor" in estimates:
        across = _product(estimates["wheel_separation_factor"], travel)
        ranges["wheel_separation_factor"] = (across[0] / turn.high, across[1] / turn.low)
    if "linear_acceleration" in estimates:
        known, nominal = estimates["linear_acceleration"], robot.limits.linear_acceleration
        ranges["acceleration_factor"] = (known.low / nominal, known.high / nominal)
    for name in TOLD_AS_THEY_ARE:
        if name in estimates:
            ranges[name] = estimates[name][1:]
    if "travel_scale" in estimates:
        ranges["odometry_scale"] = (1.0 / travel.high, 1.0 / travel.low)
    data: dict[str, Any] = {name: _allowed(name, *limits) for name, limits in ranges.items()}
    # Checked before it is written: a training must be able to read it.
    validate(RandomizationConfig, data, "ranges")
    return data


def _allowed(name: str, low: float, high: float) -> list[float]:
    """Return a range within what randomization takes."""
    least, most = (0.1, 10.0) if name.endswith(("_factor", "_scale")) else (0.0, 1.0)
    return [min(max(_rounded(value), least), most) for value in (low, high)]


def _product(first: Estimate, second: Estimate) -> tuple[float, float]:
    """Return the interval of a product of two independent quantities."""
    value = first.value * second.value
    relative = math.hypot(
        (first.high - first.low) / first.value, (second.high - second.low) / second.value
    )
    return value * (1.0 - 0.5 * relative), value * (1.0 + 0.5 * relative)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
