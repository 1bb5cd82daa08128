# SPDX-License-Identifier: Apache-2.0
"""Put a controller together from the names that a person gives."""

from __future__ import annotations

from pm01_nav.deploy.controller import Controller
from pm01_nav.deploy.excitation import Excitation
from pm01_nav.deploy.safety import SafetyConfig
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.robot import load_robot
from pm01_nav.task.observation import scan_geometry

GOAL_RADIUS = 0.3
"""Where the policy's file does not say how near counts as there [m]."""
EXCITATION_DT = 0.1
"""Time between two commands of ``excite`` [s]."""


def load_controller(
    policy: str,
    robot: str | None = None,
    *,
    goal_radius: float | None = None,
    safety: SafetyConfig | None = None,
    same_clock: bool = False,
) -> Controller:
    """Return what drives ``robot`` (a name or a YAML file) by a policy's file, or ``excite``.

    Without a robot it is the one that the policy was trained with, which must then be one of ours.
    The rest is as for ``Controller``.

    Raises:
        InputError: the policy cannot be used, or does not fit the robot.
    """
    if policy == "excite":
        return _excitation(robot, safety or SafetyConfig(), same_clock)
    if robot is None:
        robot = str(OnnxPolicy(policy).metadata.get("robot"))
    spec = load_robot(robot)
    driver = OnnxPolicy(policy, spec)
    task = driver.metadata.get("task")
    trained_radius = task.get("goal_radius") if isinstance(task, dict) else None
    radius = goal_radius or trained_radius or GOAL_RADIUS
    if not 0.0 < radius < 100.0:
        raise InputError(f"goal_radius = {radius}: must be above 0 m and below 100 m")
    return Controller(
        driver,
        spec,
        driver.layout.scan,
        control_dt=driver.control_dt,
        goal_radius=float(radius),
        safety=safety or SafetyConfig(),
        same_clock=same_clock,
    )


def _excitation(robot: str | None, safety: SafetyConfig, same_clock: bool) -> Controller:
    """Return what drives a robot so that it can be identified."""
    if robot is None:
        raise InputError("excite: give --robot, a name or a YAML file")
    spec = load_robot(robot)
    return Controller(
        Excitation(spec, EXCITATION_DT),
        spec,
        scan_geometry(spec.lidar),
        control_dt=EXCITATION_DT,
        goal_radius=GOAL_RADIUS,
        safety=safety,
        same_clock=same_clock,
    )
