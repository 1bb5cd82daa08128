# SPDX-License-Identifier: Apache-2.0
"""Put a controller together from the names that a person gives."""

from __future__ import annotations

from typing import Any

from pm01_nav.deploy.controller import Controller
from pm01_nav.deploy.excitation import Excitation
from pm01_nav.deploy.safety import SafetyConfig
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.robot import RobotSpec, changed_robot, load_robot
from pm01_nav.task.scans import scan_geometry

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

    Without a robot it is the one that the policy was trained with. What its training changed about
    that robot (``robot_changes``) is changed here, too. The rest is as for ``Controller``.

    Raises:
        InputError: the policy cannot be used, or does not fit the robot.
    """
    if policy == "excite":
        return _excitation(robot, safety or SafetyConfig(), same_clock)
    driver = OnnxPolicy(policy)
    spec = _robot(driver, robot)
    driver.check_robot(spec)
    radius = goal_radius or _task(driver).get("goal_radius") or GOAL_RADIUS
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


def _task(policy: OnnxPolicy) -> dict[str, Any]:
    """Return what a policy's file says of the task that it was trained on."""
    task = policy.metadata.get("task")
    return task if isinstance(task, dict) else {}


def _robot(policy: OnnxPolicy, name: str | None) -> RobotSpec:
    """Return the robot of that name or file, as the policy's training had it."""
    own = policy.metadata.get("robot")
    task = _task(policy)
    try:
        robot = load_robot(name or str(task.get("robot") or own))
    except InputError as error:
        if name is not None:
            raise
        raise InputError(f"{policy.path}: {error}; give --robot, its description") from error
    changes = task.get("robot_changes") or {}
    if robot.name != own:
        return robot
    if not isinstance(changes, dict):
        raise InputError(f"{policy.path}: task.robot_changes = {changes!r}: must be a mapping")
    return changed_robot(robot, changes)


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
