# SPDX-License-Identifier: Apache-2.0
"""Regulated pure pursuit: slower in bends and close to obstacles.

S. Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", Autonomous Robots 47, 2023;
the heuristics are those of Nav2's controller of that name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.compilation import compiled
from pm01_nav.planners.distance_field import (
    DistanceFields,
    Fields,
    clearance_at,
    covering_discs,
)
from pm01_nav.planners.guided import GuidedPlanner, Situation
from pm01_nav.planners.pure_pursuit import PurePursuitParams, pursue
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.dynamics import arc

FloatArray = NDArray[np.float64]
ALIGNED = 0.1
"""Turning on the spot to a point less far to the side changes nothing [rad]."""
STEPS = 20
"""Places looked at on an arc."""


class RegulatedPurePursuitParams(PurePursuitParams):
    """Parameters of regulated pure pursuit, beside those of pure pursuit."""

    least_radius: float = Field(gt=0.0)
    """Arcs of a smaller radius are driven in proportion to it [m]."""
    proximity: float = Field(gt=0.0)
    """Obstacles nearer to the footprint than this slow down in proportion [m]."""
    proximity_gain: float = Field(gt=0.0, le=1.0)
    """What proportion of the speed is left at the very edge of that distance."""
    least_speed: float = Field(gt=0.0, le=1.0)
    """It never gets slower than this, of the robot's greatest."""
    collision_time: float = Field(gt=0.0)
    """The arc must be free for so long [s], else the robot turns on the spot."""
    collision_margin: float = Field(ge=0.0)
    """The footprint is taken so much larger for that [m]."""


@planner("regulated_pure_pursuit", RegulatedPurePursuitParams)
class RegulatedPurePursuit(GuidedPlanner):
    """Follow the plan, slower where it is tight."""

    def __init__(
        self, robot: RobotSpec, control_dt: float, params: RegulatedPurePursuitParams
    ) -> None:
        """Follow plans with a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        self.params = params
        self._discs = covering_discs(robot.footprint)
        reach = robot.limits.linear_max * params.collision_time + 1.0
        self._fields = DistanceFields(robot, reach)

    def command(self, situation: Situation) -> FloatArray:
        """Return the regulated arcs to the carrots.

        Where an arc would collide it is tried slower, which is shorter. Else the robot turns on
        the spot, and where that collides or changes nothing it backs up, like Nav2's recovery.
        """
        limits, params, carrot = self.robot.limits, self.params, situation.carrot
        fields, clearance = self._fields(situation.scan), np.zeros(len(carrot))
        _clearance(fields, self._discs, clearance)
        squared = np.maximum((carrot**2).sum(axis=1), 1e-6)
        arc_radius = squared / np.maximum(2.0 * np.abs(carrot[:, 1]), 1e-9)
        bend = np.minimum(arc_radius / params.least_radius, 1.0)
        near = np.where(
            clearance < params.proximity, params.proximity_gain * clearance / params.proximity, 1.0
        )
        least = params.least_speed * limits.linear_max
        speed = np.maximum(params.speed * limits.linear_max * np.minimum(bend, near), least)
        command = pursue(carrot, speed, limits.angular_max, params)
        bearing = np.arctan2(carrot[:, 1], carrot[:, 0])
        turning = np.clip(params.rotate_gain * bearing, -limits.angular_max, limits.angular_max)
        turning *= np.abs(bearing) > ALIGNED
        back = np.full(len(carrot), max(-least, limits.linear_min))
        on_the_spot, backwards = (
            self._freed(fields, np.stack(twist, axis=-1))
            for twist in ((0.0 * turning, turning), (back, 0.0 * back))
        )
        command = self._freed(fields, command)
        command = np.where(command.any(axis=1, keepdims=True), command, on_the_spot)
        return np.where(command.any(axis=1, keepdims=True), command, backwards)

    def _freed(self, fields: Fields, command: FloatArray) -> FloatArray:
        """Return commands (n, 2) slowed until they are free, zero if they cannot be."""
        scale = np.zeros(len(command))
        reach = (self.params.collision_margin, self.params.collision_time)
        _slow_down(fields, self._discs, command, reach, scale)
        return scale[:, None] * command


@compiled
def _clearance(fields, discs, clearance):
    """Write how much room each robot has [m], 0 in contact."""
    for i in range(clearance.shape[0]):
        clearance[i] = max(clearance_at(fields, discs, i, 0.0, 0.0, 1.0, 0.0), 0.0)


@compiled
def _slow_down(fields, discs, command, reach, scale):
    """Write by which factor each command must be slowed to be free, or 0 if it cannot be."""
    for i in range(command.shape[0]):
        scale[i] = 1.0
        while scale[i] > 0.0 and not _is_free(fields, discs, i, command, scale[i], reach):
            scale[i] = 0.5 * scale[i] if scale[i] > 0.2 else 0.0


@compiled(inline=False)
def _is_free(fields, discs, i, command, scale, reach):
    """Tell whether a robot can follow a slowed command with some margin [m] for some time [s]."""
    margin, duration = reach
    dt = duration / STEPS
    v, w = scale * command[i, 0], scale * command[i, 1]
    x = y = sin = 0.0
    cos = 1.0
    # A robot that is close already may move away.
    least = min(margin, clearance_at(fields, discs, i, x, y, cos, sin))
    for _ in range(STEPS):
        x, y, cos, sin = arc(x, y, cos, sin, v, 0.0, w, dt)
        if clearance_at(fields, discs, i, x, y, cos, sin) < least:
            return False
    return True
