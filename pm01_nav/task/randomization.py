# SPDX-License-Identifier: Apache-2.0
"""How far a real robot may be from its description: one range for each quantity that can be off.

Each episode draws each quantity uniformly from its range [low, high], delays as whole numbers. A
range with low = high is a fixed perturbation. What is left out is not perturbed.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.perturbation import MAX_COMMAND_DELAY, Perturbation


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
CommandSteps = Annotated[int, Field(ge=0, le=MAX_COMMAND_DELAY)]
ScanSteps = Annotated[int, Field(ge=0, le=1)]

FactorRange = Annotated[tuple[Factor, Factor], Ordered]
ShareRange = Annotated[tuple[Share, Share], Ordered]
PositiveShareRange = Annotated[tuple[PositiveShare, PositiveShare], Ordered]
LengthRange = Annotated[tuple[Length, Length], Ordered]
OffsetRange = Annotated[tuple[Offset, Offset], Ordered]
CommandStepsRange = Annotated[tuple[CommandSteps, CommandSteps], Ordered]
ScanStepsRange = Annotated[tuple[ScanSteps, ScanSteps], Ordered]


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
    command_delay: CommandStepsRange = (0, 0)
    """Control steps by which a command comes late, up to 3."""
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
    scan_delay: ScanStepsRange = (0, 0)
    """Control steps by which a scan comes late, up to 1."""
    scan_sweep: ShareRange = (0.0, 0.0)
    """Share of the control period over which the beams sweep, the last one at its end."""
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

    def ranges(self, robot: RobotSpec) -> Perturbation:
        """Return the ranges as the simulator reads them, each of shape (2,)."""
        own = {"actuator_lag": robot.actuator.lag_s, "lidar_noise_std": robot.lidar.noise_std}
        values = {n: getattr(self, n) or (own[n], own[n]) for n in Perturbation._fields}
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
        command_delay=(0, 2),
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
        scan_delay=(0, 1),
        scan_sweep=(0.0, 1.0),
        odometry_scale=(0.99, 1.01),
        odometry_drift_per_m=(-0.005, 0.005),
        odometry_drift_per_rad=(-0.01, 0.01),
        goal_error=(0.0, 0.1),
        footprint_padding=(0.0, 0.03),
    )


def load_randomization(choice: str) -> RandomizationConfig | None:
    """Return what ``off``, ``on`` or the path of a YAML file of ranges stands for.

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
    return validate(RandomizationConfig, load_yaml(choice), choice)
