# SPDX-License-Identifier: Apache-2.0
"""Model predictive path integral control: the mean of many random futures, the better the heavier.

G. Williams et al., "Information Theoretic MPC for Model-Based Reinforcement Learning", ICRA 2017.
The terms of the cost are some of those of Nav2's MPPI controller: obstacles, path follow, path
angle and prefer forward.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy import ndimage

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.durations import CONTROL_DT, in_seconds, whole_steps
from pm01_nav.planners.distance_field import DistanceFields, clearance_at, covering_discs
from pm01_nav.planners.guided import GuidedPlanner, GuideParams, Situation
from pm01_nav.planners.registry import planner
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.collision import polar
from pm01_nav.sim.dynamics import arc

FloatArray = NDArray[np.float64]
NOISE_SEED = 0
SHIFT = 7
"""Steps by which the noise is moved along the rollouts from one control step to the next."""
SMOOTHING = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
"""Savitzky-Golay filter of 5 points and 2nd order, with which Nav2, too, smooths the commands."""


EARLY = {"steps": "horizon_s"}
"""What early parameters counted in control steps, and the present key."""


class MPPIParams(FrozenModel):
    """Parameters of MPPI."""

    guide: GuideParams = GuideParams()
    look_ahead: float = Field(gt=0.0)
    """Of the plan's point that the futures should lead to [m]."""
    rollouts: int = Field(ge=2)
    horizon_s: float = Field(gt=0.0)
    """Time that a rollout covers [s], rounded to control periods."""
    linear_std: float = Field(gt=0.0)
    """Standard deviation of the random speeds [m/s]."""
    angular_std: float = Field(gt=0.0)
    """Standard deviation of the random turn rates [rad/s]."""
    temperature: float = Field(gt=0.0)
    """The lower, the more the best rollouts count."""
    gamma: float = Field(ge=0.0)
    """Price of leaving the last plan of commands."""
    margin: float = Field(ge=0.0)
    """The footprint is taken so much larger [m]."""
    collision_weight: float = Field(ge=0.0)
    """For a rollout that collides, once."""
    repulsion_weight: float = Field(ge=0.0)
    """For nearness to obstacles, 0 to 1, as a mean over the rollout ..."""
    repulsion_distance: float = Field(gt=0.0)
    """... within so much beside the footprint [m]."""
    follow_weight: float = Field(ge=0.0)
    """Per metre between the end of the rollout and the plan's point."""
    angle_weight: float = Field(ge=0.0)
    """Per radian between the end's heading and the direction of the plan's point."""
    forward_weight: float = Field(ge=0.0)
    """Per metre driven backwards."""

    @model_validator(mode="before")
    @classmethod
    def _in_seconds(cls, given: Any) -> Any:
        return in_seconds(given, EARLY, CONTROL_DT) if isinstance(given, Mapping) else given


@planner("mppi", MPPIParams)
class MPPI(GuidedPlanner):
    """Sample futures around the last plan of commands."""

    def __init__(self, robot: RobotSpec, control_dt: float, params: MPPIParams) -> None:
        """Drive a robot that is commanded every ``control_dt`` [s]."""
        super().__init__(robot, control_dt, params.guide, params.look_ahead)
        self.params = params
        self._steps = max(2, whole_steps(params.horizon_s, control_dt))
        limits = robot.limits
        self._discs = covering_discs(robot.footprint)
        radius = robot.footprint.circumscribed_radius + params.margin
        reach = limits.linear_max * self._steps * control_dt + params.repulsion_distance
        self._fields = DistanceFields(
            robot, min(reach + radius, params.guide.costmap.obstacle_range)
        )
        self._limits = (
            limits.linear_min,
            limits.linear_max,
            limits.angular_max,
            limits.linear_acceleration * control_dt,
            limits.angular_acceleration * control_dt,
            control_dt,
        )
        self._weights = (
            params.margin,
            params.collision_weight,
            params.repulsion_weight,
            params.repulsion_distance,
            params.follow_weight,
            params.angle_weight,
            params.forward_weight,
            params.gamma,
            params.temperature,
        )
        # Drawing noise anew takes longer than all the rest. The same noise moved along in time does
        # not add the same error to the plan at each step.
        rng = np.random.default_rng(NOISE_SEED)
        noise = rng.standard_normal((params.rollouts, self._steps, 2))
        noise *= [params.linear_std, params.angular_std]
        self._noise = np.concatenate([noise, noise], axis=1)
        self._std = np.array([params.linear_std, params.angular_std])

    def begin(self, count: int) -> None:
        """Begin maps and plans; all commands are zero."""
        super().begin(count)
        self._plan = np.zeros((count, self._steps, 2))
        self._count = 0

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        super().keep(robots)
        self._plan = self._plan[robots]

    def command(self, situation: Situation) -> FloatArray:
        """Return the first commands of the improved plans."""
        shift = SHIFT * self._count % self._steps
        self._count += 1
        _improve(
            self._plan,
            self._noise[:, shift : shift + self._steps],
            self._std,
            self._fields(situation.scan),
            self._discs,
            situation.carrot,
            np.ascontiguousarray(situation.velocity),
            self._limits,
            self._weights,
            np.empty((len(self._plan), self.params.rollouts)),
        )
        smooth = ndimage.convolve1d(self._plan, SMOOTHING, axis=1, mode="nearest")
        limits = self.robot.limits
        low, high = (
            (limits.linear_min, -limits.angular_max),
            (limits.linear_max, limits.angular_max),
        )
        self._plan = np.clip(smooth, low, high)
        command = self._plan[:, 0].copy()
        # The next step begins with what is left of the plan.
        self._plan[:, :-1] = self._plan[:, 1:]
        return command


@compiled(parallel=True)
def _improve(plan, noise, std, fields, discs, carrot, velocity, limits, weights, costs):
    """Replace each robot's plan (steps, 2) by the weighted mean of its rollouts."""
    rollouts, steps = noise.shape[0], noise.shape[1]
    for i in prange(plan.shape[0]):
        least = np.inf
        for k in range(rollouts):
            costs[i, k] = _roll_out(
                plan, noise, std, fields, discs, carrot, velocity, limits, weights, i, k
            )
            least = min(least, costs[i, k])
        total = 0.0
        for k in range(rollouts):
            costs[i, k] = np.exp(-(costs[i, k] - least) / weights[8])
            total += costs[i, k]
        for t in range(steps):
            v = w = 0.0
            for k in range(rollouts):
                v += costs[i, k] * noise[k, t, 0]
                w += costs[i, k] * noise[k, t, 1]
            plan[i, t, 0] = min(max(plan[i, t, 0] + v / total, limits[0]), limits[1])
            plan[i, t, 1] = min(max(plan[i, t, 1] + w / total, -limits[2]), limits[2])


@compiled(inline=False)
def _roll_out(plan, noise, std, fields, discs, carrot, velocity, limits, weights, i, k):
    """Return the cost of one future of robot i."""
    v_min, v_max, w_max, v_change, w_change, dt = limits
    margin, collision, repulsion, distance = weights[0], weights[1], weights[2], weights[3]
    x = y = sin = cost = 0.0
    cos = 1.0
    v, w = velocity[i, 0], velocity[i, 1]
    start = clearance_at(fields, discs, i, x, y, cos, sin)
    steps = plan.shape[1]
    for t in range(steps):
        v_aim = min(max(plan[i, t, 0] + noise[k, t, 0], v_min), v_max)
        w_aim = min(max(plan[i, t, 1] + noise[k, t, 1], -w_max), w_max)
        v += min(max(v_aim - v, -v_change), v_change)
        w += min(max(w_aim - w, -w_change), w_change)
        x, y, cos, sin = arc(x, y, cos, sin, v, 0.0, w, dt)
        here = clearance_at(fields, discs, i, x, y, cos, sin)
        if here < min(margin, start):
            cost += collision
            break
        near = 1.0 - (here - margin) / distance
        cost += repulsion * max(near, 0.0) / steps + weights[6] * max(-v, 0.0) * dt
        change = plan[i, t, 0] * noise[k, t, 0] / (std[0] * std[0])
        change += plan[i, t, 1] * noise[k, t, 1] / (std[1] * std[1])
        cost += weights[7] * change
    away, bearing = polar(carrot[i, 0] - x, carrot[i, 1] - y, cos, sin)
    # Near the point its direction says nothing.
    return cost + weights[4] * away + weights[5] * abs(bearing) * min(away / 0.3, 1.0)
