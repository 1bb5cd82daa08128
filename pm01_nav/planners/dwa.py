# SPDX-License-Identifier: Apache-2.0
"""Dynamic window approach: of the speeds within reach, those of the best short arc.

D. Fox, W. Burgard, S. Thrun, "The Dynamic Window Approach to Collision Avoidance", IEEE Robotics &
Automation Magazine 4 (1), 1997. As in ROS's local planners, arcs are judged by the plan's point
ahead instead of the goal, so that a global plan leads out of dead ends.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray
from pydantic import Field

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.planners.distance_field import DistanceFields, clearance_at, covering_discs
from pm01_nav.planners.guided import GuidedPlanner, GuideParams, Situation
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.collision import polar
from pm01_nav.sim.dynamics import arc, next_speed

FloatArray = NDArray[np.float64]


class DWAParams(FrozenModel):
    """Parameters of the dynamic window approach."""

    guide: GuideParams = GuideParams()
    look_ahead: float = Field(gt=0.0)
    """Of the plan's point that arcs should lead to [m]."""
    linear_samples: int = Field(ge=2)
    angular_samples: int = Field(ge=3)
    window: float = Field(gt=0.0)
    """Speeds are within reach that the robot can have after so long [s]."""
    horizon: float = Field(gt=0.0)
    """How long the arcs are [s]."""
    steps: int = Field(ge=1)
    """Places looked at on each arc."""
    margin: float = Field(ge=0.0)
    """The footprint is taken so much larger [m]."""
    heading_weight: float = Field(ge=0.0)
    """For the direction from the arc's end to the point, 0 to 1."""
    progress_weight: float = Field(ge=0.0)
    """For coming closer to the point, in proportion to the longest arc."""
    clearance_weight: float = Field(ge=0.0)
    """For the least distance to obstacles, 0 to 1 ..."""
    clearance_limit: float = Field(gt=0.0)
    """... at so much beside the footprint [m]."""
    velocity_weight: float = Field(ge=0.0)
    """For the speed, in proportion to the robot's greatest."""


@planner("dwa", DWAParams)
class DWA(GuidedPlanner):
    """Try the arcs of a grid of speeds."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: DWAParams) -> None:
        """Drive a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        limits = robot.limits
        reach = limits.linear_max * params.horizon + params.clearance_limit
        self._fields = DistanceFields(robot, reach + robot.footprint.circumscribed_radius)
        self._limits = (
            limits.linear_max,
            limits.angular_max,
            limits.linear_acceleration,
            limits.angular_acceleration,
        )
        self._discs = covering_discs(robot.footprint)
        self._arcs = (
            params.margin,
            params.window,
            params.horizon,
            params.steps,
            params.clearance_limit,
            control_dt,
            _left_by_lag(robot, params.horizon / params.steps),
        )
        self._samples = (params.linear_samples, params.angular_samples)
        self._weights = (
            params.heading_weight,
            params.progress_weight,
            params.clearance_weight,
            params.velocity_weight,
        )

    def command(self, situation: Situation) -> FloatArray:
        """Return the speeds of the best arcs."""
        chosen = np.zeros_like(situation.carrot)
        _choose(
            self._fields(situation.scan),
            self._discs,
            situation.carrot,
            np.ascontiguousarray(situation.velocity),
            self._limits,
            self._arcs,
            self._samples,
            self._weights,
            chosen,
        )
        return chosen


def _left_by_lag(robot: RobotSpec, dt: float) -> float:
    """Return the part of a speed's error that the actuators' lag leaves after ``dt`` [s]."""
    lag = robot.actuator.lag_s
    return float(np.exp(-dt / lag)) if lag > 0.0 else 0.0


@compiled(parallel=True)
def _choose(fields, discs, carrot, velocity, limits, arcs, samples, weights, chosen):
    """Write the speeds of the best admissible arc of each robot; on the spot if there is none."""
    v_max, w_max, v_acceleration, w_acceleration = limits
    window = arcs[1]
    for i in prange(carrot.shape[0]):
        best = -np.inf
        v_low = max(velocity[i, 0] - v_acceleration * window, 0.0)
        v_high = min(max(velocity[i, 0] + v_acceleration * window, v_low), v_max)
        w_low = max(velocity[i, 1] - w_acceleration * window, -w_max)
        w_high = min(velocity[i, 1] + w_acceleration * window, w_max)
        chosen[i, 0] = 0.0
        # Only a disc turns on the spot in the room that it takes.
        turn = w_max if discs.shape[0] == 1 else 0.0
        chosen[i, 1] = turn if carrot[i, 1] >= 0.0 else -turn
        for a in range(samples[0]):
            v = v_low + (v_high - v_low) * a / (samples[0] - 1)
            for b in range(samples[1]):
                w = w_low + (w_high - w_low) * b / (samples[1] - 1)
                speeds = (velocity[i, 0], velocity[i, 1], v, w)
                score = _judge(fields, discs, carrot, i, speeds, limits, arcs, weights)
                if score > best:
                    best = score
                    chosen[i, 0], chosen[i, 1] = v, w


@compiled(inline=False)
def _judge(fields, discs, carrot, i, speeds, limits, arcs, weights):
    """Return how good a pair of speeds is, minus infinity if it leads into an obstacle.

    The robot takes on the commanded speeds as it can, which bends the beginning of the arc.
    """
    margin, _, horizon, steps, clearance_limit, reaction, keep = arcs
    dt = horizon / steps
    v, w, v_aim, w_aim = speeds
    x = y = sin = 0.0
    cos = 1.0
    start = clearance_at(fields, discs, i, x, y, cos, sin)
    least = start
    for k in range(steps):
        v = next_speed(v, v_aim, keep, limits[2] * dt)
        w = next_speed(w, w_aim, keep, limits[3] * dt)
        x, y, cos, sin = arc(x, y, cos, sin, v, 0.0, w, dt)
        here = clearance_at(fields, discs, i, x, y, cos, sin)
        least = min(least, here)
        # A robot that is close already may move away.
        if here < min(margin, start):
            # Fox et al., eq. 14: slow enough to stop within the way and the turn that are left.
            left = max(k * dt - reaction, 0.0)
            stops = v_aim <= 2.0 * left * limits[2] and abs(w_aim) <= 2.0 * left * limits[3]
            if not stops or k == 0:
                return -np.inf
            break
    before = np.sqrt(carrot[i, 0] * carrot[i, 0] + carrot[i, 1] * carrot[i, 1])
    away, bearing = polar(carrot[i, 0] - x, carrot[i, 1] - y, cos, sin)
    progress = (before - away) / (limits[0] * horizon)
    clear = min(max(least - margin, 0.0) / clearance_limit, 1.0)
    score = weights[0] * (1.0 - abs(bearing) / np.pi) + weights[1] * progress
    return score + weights[2] * clear + weights[3] * v_aim / limits[0]
