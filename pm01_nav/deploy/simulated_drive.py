# SPDX-License-Identifier: Apache-2.0
"""A controller and a simulated robot in one loop, as fast as it goes."""

from __future__ import annotations

from collections.abc import Iterator

from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.recording import Recorder
from pm01_nav.deploy.simulated_robot import SimulatedRobot


def drive_simulated(
    controller: Controller, robot: SimulatedRobot, seconds: float, recorder: Recorder | None = None
) -> int:
    """Drive for ``seconds`` of simulated time; return how many goals were reached.

    After each goal the robot gets another one in the same world.
    """
    arrived, due, until = 0, robot.time, robot.time + seconds
    goals = _goals(robot)
    controller.set_goal(next(goals))
    while robot.time < until - 1e-9:
        new_scan = robot.step()
        odometry = robot.odometry()
        controller.see_odometry(odometry, robot.time)
        if recorder is not None:
            recorder.odometry(odometry, robot.time)
        if new_scan:
            scan = robot.scan()
            controller.see_scan(scan, robot.time)
            if recorder is not None:
                recorder.scan(scan, robot.time)
        if robot.time < due - 1e-9:
            continue
        due += controller.control_dt
        status = controller.step(robot.time)
        robot.command(*status.verdict.command)
        if recorder is not None:
            recorder.command(status.verdict.command, robot.time)
        if status.arrived:
            arrived += 1
            controller.set_goal(next(goals))
    return arrived


def _goals(robot: SimulatedRobot) -> Iterator[Goal]:
    """Yield the episode's goal, then its start, and so on: a way there is a way back."""
    there, back = robot.goal, robot.pose[:2]
    while True:
        yield Goal(*map(float, there))
        there, back = back, there
