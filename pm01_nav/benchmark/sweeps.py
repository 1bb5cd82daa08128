# SPDX-License-Identifier: Apache-2.0
"""How success falls as the world gets fuller, or robot and sensors worse; one thing at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple


class SweepPoint(NamedTuple):
    """Where a suite lies on a sweep."""

    sweep: str
    label: str
    """What varies, with its unit."""
    suite: str
    """The suite that it varies."""
    value: float


@dataclass(frozen=True)
class Sweep:
    """One quantity that varies, everything else as in the suite."""

    label: str
    suite: str
    values: tuple[float, ...]
    changes: Callable[[float], dict[str, Any]]
    """From a value to changes of the task."""


def _worlds(parameter: str) -> Callable[[float], dict[str, Any]]:
    return lambda value: {"suite_params": {parameter: value}}


def _fixed(*keys: str) -> Callable[[float], dict[str, Any]]:
    """Perturb these quantities of ``RandomizationConfig`` by a fixed value."""
    return lambda value: {"randomization": {key: (value, value) for key in keys}}


SWEEPS: dict[str, Sweep] = {
    "density": Sweep(
        "obstacles in 10 m x 10 m", "static", (0, 8, 16, 24, 32, 40), _worlds("obstacles")
    ),
    "pedestrians": Sweep("pedestrians", "crowd", (0, 5, 10, 15, 20, 25), _worlds("pedestrians")),
    "pedestrian_speed": Sweep(
        "pedestrians' speed, of the usual",
        "crowd",
        (0.25, 0.5, 1.0, 1.5, 2.0),
        _worlds("speed_factor"),
    ),
    "lidar_noise": Sweep(
        "standard deviation of a range [m]",
        "static",
        (0.0, 0.02, 0.05, 0.1, 0.2),
        _fixed("lidar_noise_std"),
    ),
    "lidar_dropout": Sweep(
        "beams without a return", "static", (0.0, 0.1, 0.3, 0.5, 0.8), _fixed("lidar_dropout")
    ),
    "command_delay": Sweep(
        "delay of commands [s]", "static", (0.0, 0.1, 0.2, 0.3), _fixed("command_delay_s")
    ),
    "odometry_drift": Sweep(
        "drift of the heading [rad/m]",
        "static",
        (0.0, 0.02, 0.05, 0.1, 0.2),
        _fixed("odometry_drift_per_m"),
    ),
}
"""Sweeps by name."""
