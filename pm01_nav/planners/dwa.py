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
from pm01_nav.planners.distance_field import DistanceFields, distance_at
from pm01_nav.planners.guided import GuidedPlanner, GuideParams, Situation
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.collision import polar
from pm01_nav.sim.dynamics import arc

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
        radius = robot.footprint.circumscribed_radius + params.margin
        self._arcs = (
            radius,
            params.window,
            params.horizon,
            params.steps,
            params.clearance_limit,
            control_dt + robot.actuator.lag_s,
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
            situation.carrot,
            np.ascontiguousarray(situation.velocity),
            self._limits,
            self._arcs,
            self._samples,
            self._weights,
            chosen,
        )
        return chosen


@compiled(parallel=True)
def _choose(fields, carrot, velocity, limits, arcs, samples, weights, chosen):
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
        chosen[i, 1] = w_max if carrot[i, 1] >= 0.0 else -w_max
        for a in range(samples[0]):
            v = v_low + (v_high - v_low) * a / (samples[0] - 1)
            for b in range(samples[1]):
                w = w_low + (w_high - w_low) * b / (samples[1] - 1)
                score = _judge(fields, carrot, i, v, w, limits, arcs, weights)
                if score > best:
                    best = score
                    chosen[i, 0], chosen[i, 1] = v, w


@compiled(inline=False)
def _judge(fields, carrot, i, v, w, limits, arcs, weights):
    """Return how good an arc is, minus infinity if the robot could not stop before an obstacle."""
    radius, _, horizon, steps, clearance_limit, reaction = arcs
    dt = horizon / steps
    x = y = sin = 0.0
    cos = 1.0
    start = distance_at(fields, i, 0.0, 0.0)
    least = start
    for k in range(steps):
        x, y, cos, sin = arc(x, y, cos, sin, v, w, dt)
        here = distance_at(fields, i, x, y)
        least = min(least, here)
        if here < radius and here <= start:
            # Fox et al., eq. 14: slow enough to stop within the way that is left.
            way = v * max(k * dt - reaction, 0.0)
            if v > np.sqrt(2.0 * way * limits[2]) or k == 0:
                return -np.inf
            break
    before = np.sqrt(carrot[i, 0] * carrot[i, 0] + carrot[i, 1] * carrot[i, 1])
    away, bearing = polar(carrot[i, 0] - x, carrot[i, 1] - y, cos, sin)
    progress = (before - away) / (limits[0] * horizon)
    clear = min(max(least - radius, 0.0) / clearance_limit, 1.0)
    score = weights[0] * (1.0 - abs(bearing) / np.pi) + weights[1] * progress
    return score + weights[2] * clear + weights[3] * v / limits[0]
