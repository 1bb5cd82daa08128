# SPDX-License-Identifier: Apache-2.0
"""How far a real robot may be from its description: one range for each quantity that can be off.

Each episode draws each quantity uniformly from its range [low, high]. A range with low = high is a
fixed perturbation. What is left out is not perturbed.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.durations import CONTROL_DT
from pm01_nav.errors import InputError, InputWarning
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.settings import Perturbation

IN_STEPS = ("command_delay", "scan_delay", "scan_sweep")
"""What the simulator counts in its steps, and early files in control steps."""
LONGEST_S = 1.0
"""The longest delay and sweep [s]."""
WHOLE = 1e-9
"""So near to a whole number of steps a delay is one."""


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = limits
    if low > high:
        raise ValueError(f"low ({low:g}) must not exceed high ({high:g})")
    return limits


Ordered = AfterValidator(_ordered)
Factor = Annotated[float, Field(ge=0.1, le=10.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
PositiveShare = Annotated[float, Field(gt=0.0, le=1.0)]
Length = Annotated[float, Field(ge=0.0, le=100.0)]
Offset = Annotated[float, Field(ge=-10.0, le=10.0)]
Seconds = Annotated[float, Field(ge=0.0, le=LONGEST_S)]

FactorRange = Annotated[tuple[Factor, Factor], Ordered]
ShareRange = Annotated[tuple[Share, Share], Ordered]
PositiveShareRange = Annotated[tuple[PositiveShare, PositiveShare], Ordered]
LengthRange = Annotated[tuple[Length, Length], Ordered]
OffsetRange = Annotated[tuple[Offset, Offset], Ordered]
SecondsRange = Annotated[tuple[Seconds, Seconds], Ordered]


class RandomizationConfig(FrozenModel):
    """What each episode draws; each value is a range [low, high]."""

    wheel_left_factor: FactorRange = (1.0, 1.0)
    """True radius of the left wheel, of the nominal one."""
    wheel_right_factor: FactorRange = (1.0, 1.0)
    wheel_separation_factor: FactorRange = (1.0, 1.0)
    """True separation of the wheels, of the nominal one."""
    acceleration_factor: FactorRange = (1.0, 1.0)
    """Limits of acceleration, of the nominal ones: below 1 for a heavier robot."""
    actuator_lag: Annotated[tuple[Share, Share], Ordered] | None = None
    """Time constant of the base's answer [s], up to 1; None keeps the robot's own."""
    command_delay_s: SecondsRange = (0.0, 0.0)
    """By how much a command comes late [s], up to 1. It need be no multiple of the control period:
    in a step in which two commands count, the base is told their mean, weighted by their time."""
    slip: ShareRange = (0.0, 0.0)
    """Share of their travel that both wheels lose."""
    slip_noise: ShareRange = (0.0, 0.0)
    """In each step the slip of each wheel is off by up to this, to either side."""
    control_jitter: ShareRange = (0.0, 0.0)
    """Each control period is longer or shorter by up to this share."""
    lidar_noise_std: LengthRange | None = None
    """Standard deviation of the additive error of a range [m]; None keeps the robot's own."""
    lidar_noise_share: ShareRange = (0.0, 0.0)
    """Standard deviation of the proportional error, as a share of the range."""
    lidar_dropout: ShareRange = (0.0, 0.0)
    """Probability that a beam gets no return."""
    lidar_range_factor: PositiveShareRange = (1.0, 1.0)
    """How far the lidar really sees, of its range_max."""
    lidar_x_error: OffsetRange = (0.0, 0.0)
    """How far the lidar is mounted from where it should be [m]."""
    lidar_y_error: OffsetRange = (0.0, 0.0)
    lidar_yaw_error: OffsetRange = (0.0, 0.0)
    """[rad]"""
    dark_share: ShareRange = (0.0, 0.0)
    """Probability that an obstacle is dark: it swallows beams that meet it beyond dark_range.

    An obstacle is a disc, a wall or side of a polygon, or a square of 0.5 m of a grid; those that
    move are never dark.
    """
    dark_range: LengthRange = (0.0, 0.0)
    """Up to this range a dark obstacle is seen [m]."""
    scan_delay_s: SecondsRange = (0.0, 0.0)
    """By how much a scan comes late [s], up to 1, rounded to control periods: one scan is made in
    each."""
    scan_sweep_s: SecondsRange = (0.0, 0.0)
    """How long the beams sweep [s], up to 1, the last one at the end of the control period."""
    odometry_scale: FactorRange = (1.0, 1.0)
    """Travel by odometry, of the true one."""
    odometry_drift_per_m: OffsetRange = (0.0, 0.0)
    """Error of odometry's heading for each metre forwards [rad/m]."""
    odometry_drift_per_rad: OffsetRange = (0.0, 0.0)
    """Error of odometry's heading for each radian turned to the left."""
    goal_error: LengthRange = (0.0, 0.0)
    """How far the goal that the robot is told lies from the true one [m], in any direction."""
    footprint_padding: LengthRange = (0.0, 0.0)
    """What the footprint is larger by, to every side [m]."""

    def ranges(self, robot: RobotSpec, control_dt: float) -> Perturbation:
        """Return what a simulator with steps of ``control_dt`` [s] reads, each of shape (2,)."""
        own = {"actuator_lag": robot.actuator.lag_s, "lidar_noise_std": robot.lidar.noise_std}
        named = set(Perturbation._fields) - set(IN_STEPS)
        values = {n: getattr(self, n) or (own[n], own[n]) for n in named}
        for name in IN_STEPS:
            values[name] = tuple(_steps(s, control_dt) for s in getattr(self, f"{name}_s"))
        return Perturbation(**{n: np.array(v, dtype=np.float64) for n, v in values.items()})


def default_randomization() -> RandomizationConfig:
    """Return the ranges that ``--randomization on`` stands for.

    They are chosen for a small robot of which nothing was measured; a source is named where there
    is one.
    """
    return RandomizationConfig(
        wheel_left_factor=(0.98, 1.02),
        wheel_right_factor=(0.98, 1.02),
        wheel_separation_factor=(0.95, 1.05),
        acceleration_factor=(0.6, 1.2),
        actuator_lag=(0.0, 0.15),
        command_delay_s=(0.0, 0.2),
        slip=(0.0, 0.05),
        slip_noise=(0.0, 0.02),
        control_jitter=(0.0, 0.1),
        # LDS-01 data sheet: precision 10 mm below 0.5 m, 3.5 % of the range beyond.
        lidar_noise_std=(0.0, 0.01),
        lidar_noise_share=(0.0, 0.035),
        lidar_dropout=(0.0, 0.05),
        lidar_range_factor=(0.8, 1.0),
        lidar_x_error=(-0.02, 0.02),
        lidar_y_error=(-0.02, 0.02),
        lidar_yaw_error=(-0.035, 0.035),
        dark_share=(0.0, 0.1),
        dark_range=(0.7, 2.0),
        scan_delay_s=(0.0, 0.1),
        scan_sweep_s=(0.0, 0.1),
        odometry_scale=(0.99, 1.01),
        odometry_drift_per_m=(-0.005, 0.005),
        odometry_drift_per_rad=(-0.01, 0.01),
        goal_error=(0.0, 0.1),
        footprint_padding=(0.0, 0.03),
    )


def delays_in_seconds(ranges: Mapping[str, Any], control_dt: Any, source: str) -> dict[str, Any]:
    """Return ranges, in which early files counted delays in control steps, with seconds.

    A warning says what was converted, and by which control period. Where ``control_dt`` is no
    number, nothing is: whoever checks the task will say so.

    Raises:
        InputError: a delay stands there in both ways.
    """
    changed, told = dict(ranges), []
    if not isinstance(control_dt, (int, float)):
        return changed
    for name in IN_STEPS:
        if name not in ranges:
            continue
        key, steps = f"{name}_s", changed.pop(name)
        if key in ranges:
            raise InputError(f"{source}: {name}: stands beside {key}; give {key} alone")
        seconds = _times(steps, control_dt)
        changed[key] = seconds
        told.append(f"{name} = {steps} as {key} = {seconds}")
    if told:
        warnings.warn(
            f"{source}: {', '.join(told)}: delays are in seconds now; these were taken for "
            f"control steps of {control_dt:g} s",
            InputWarning,
            stacklevel=2,
        )
    return changed


def _times(steps: Any, control_dt: float) -> Any:
    """Return a range of steps in seconds; what is none is left for the check to find."""
    if not isinstance(steps, (list, tuple)):
        return steps
    numbers = (int, float)
    return [round(n * control_dt, 9) if isinstance(n, numbers) else n for n in steps]


def _steps(seconds: float, control_dt: float) -> float:
    """Return a time in steps; 0.3 s are three steps of 0.1 s, though their quotient is not 3."""
    steps = seconds / control_dt
    whole = float(round(steps))
    return whole if abs(steps - whole) < WHOLE * max(whole, 1.0) else steps


def load_randomization(choice: str, control_dt: float = CONTROL_DT) -> RandomizationConfig | None:
    """Return what ``off``, ``on`` or the path of a YAML file of ranges stands for.

    ``control_dt`` [s] is for early files, which counted delays in control steps.

    Raises:
        InputError: the choice is none of these, or the file does not hold usable ranges.
    """
    if choice == "off":
        return None
    if choice == "on":
        return default_randomization()
    if not choice.endswith((".yaml", ".yml")):
        raise InputError(
            f"randomization = {choice!r}: unknown; allowed: off, on, or the path of a .yaml file"
        )
    return validate(
        RandomizationConfig, delays_in_seconds(load_yaml(choice), control_dt, choice), choice
    )
