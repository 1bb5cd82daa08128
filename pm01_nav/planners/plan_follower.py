# SPDX-License-Identifier: Apache-2.0
"""Lead any policy through a known map: the goal it is given is a point of a global plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame
from pm01_nav.worlds.global_plan import Costmap, GlobalPlan, plan_path

FloatArray = NDArray[np.float64]

LOOK_AHEAD = 2.0
"""How far ahead along the plan the policy's goal lies [m]."""
STRAYED = 1.0
"""A robot further from its plan gets a new one [m]."""
PATIENCE = 10
"""At least so many calls lie between two plans of a robot: a second at ten calls a second."""


def look_ahead_of(global_plan: bool, look_ahead: float | None) -> float | None:
    """Return how far ahead on a global plan the goal lies [m], or None without such a plan.

    Raises:
        InputError: a distance without a plan, or none above 0.
    """
    if look_ahead is not None and not global_plan:
        raise InputError(f"look-ahead = {look_ahead:g}: needs --global-plan")
    if look_ahead is not None and not 0.0 < look_ahead < math.inf:
        raise InputError(f"look-ahead = {look_ahead:g}: must be above 0 [m]")
    return (look_ahead or LOOK_AHEAD) if global_plan else None


class PlanFollower:
    """Replace the goals of some robots by the look-ahead points of their global plans.

    A policy knows nothing of it: it is given another goal, and needs no pose. Who knows the pose,
    a simulator or a robot's localisation, asks here for the goal before each ``Policy.act``.
    """

    def __init__(
        self, costmaps: Sequence[Costmap], goals: FloatArray, look_ahead: float = LOOK_AHEAD
    ) -> None:
        """Take each robot's map and its goal (n, 2) in it [m]; plans are made when first needed.

        Raises:
            InputError: ``look_ahead`` [m] is not positive.
        """
        if not look_ahead > 0.0:
            raise InputError(f"look_ahead = {look_ahead:g}: must be positive [m]")
        self._costmaps, self._goals, self._distance = costmaps, np.array(goals), look_ahead
        self.plans: list[GlobalPlan] = []
        """The present plan of each robot."""
        self._wait = np.zeros(len(self._goals), dtype=np.int64)

    def goals_in_base(self, poses: FloatArray) -> FloatArray:
        """Return what each robot should drive to now, x forward and y left [m], shape (n, 2).

        ``poses`` (n, 3) are in the map [m, m, rad].

        Raises:
            InputError: no way leads from a robot's first position to its goal.
        """
        if not self.plans:
            self.plans = [self._plan(i, pose[:2]) for i, pose in enumerate(poses)]
        points = np.array([self._point(i, pose[:2]) for i, pose in enumerate(poses)])
        return to_frame(points.reshape(-1, 2), poses)

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        self._costmaps = [self._costmaps[i] for i in robots]
        self._goals, self._wait = self._goals[robots], self._wait[robots]
        if self.plans:
            self.plans = [self.plans[i] for i in robots]

    def _plan(self, i: int, position: FloatArray) -> GlobalPlan:
        costmap = self._costmaps[i]
        return GlobalPlan(costmap, plan_path(costmap, position, self._goals[i]))

    def _point(self, i: int, position: FloatArray) -> FloatArray:
        ahead = self.plans[i].look_ahead(position, self._distance)
        self._wait[i] -= 1
        if (ahead.deviation > STRAYED or not ahead.visible) and self._wait[i] < 0:
            self._wait[i] = PATIENCE
            try:
                self.plans[i] = self._plan(i, position)
            except InputError:
                return ahead.point  # off the map's free space: the old plan is the best there is
            ahead = self.plans[i].look_ahead(position, self._distance)
        return ahead.point
