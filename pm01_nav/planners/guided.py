# SPDX-License-Identifier: Apache-2.0
"""What local planners have in common: a costmap on the way, and A* over it to the goal."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from pm01_nav.config import FrozenModel
from pm01_nav.durations import CONTROL_DT, in_seconds, whole_steps
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, to_world
from pm01_nav.planners.rolling_costmap import CostmapParams, RollingCostmap
from pm01_nav.planners.scan_planner import ScanPlanner, clean_ranges
from pm01_nav.policy.step_timer import StepTimer
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.global_plan import SNAP_DISTANCE, Costmap, GlobalPlan, plan_path

FloatArray = NDArray[np.float64]

LEAST_AHEAD = 0.3
"""A point that is nearer on the plan gives no direction [m]."""
EDGE = 3
"""A goal beyond the map is sought this many cells inside its edge."""


EARLY = {"replan_steps": "replan_s", "patience_steps": "patience_s"}
"""What early parameters counted in control steps, and the present keys."""


class GuideParams(FrozenModel):
    """How the way to the goal is planned."""

    costmap: CostmapParams = CostmapParams()
    replan_s: float = Field(default=1.0, gt=0.0)
    """Time between two plans of a robot that keeps to its plan [s]."""
    patience_s: float = Field(default=0.3, gt=0.0)
    """Time between two plans of one that does not [s]; both are rounded to control periods."""
    strayed: float = Field(default=0.5, gt=0.0)
    """A robot further from its plan does not keep to it [m]."""
    snap: float = Field(default=1.5, ge=0.0)
    """A goal in a closed cell is replaced by a free one no further away [m]."""

    @model_validator(mode="before")
    @classmethod
    def _in_seconds(cls, given: Any) -> Any:
        return in_seconds(given, EARLY, CONTROL_DT) if isinstance(given, Mapping) else given


@dataclass(frozen=True)
class Situation:
    """What a local planner decides by; one row a robot, all in base_link."""

    scan: FloatArray
    """Clean ranges [m] (``clean_ranges``), shape (n, num_beams)."""
    carrot: FloatArray
    """A point some way ahead on the plan to the goal [m], shape (n, 2)."""
    velocity: FloatArray
    """Measured v, w [m/s, rad/s], shape (n, 2)."""


def _not_too_near(plan: GlobalPlan, point: FloatArray) -> FloatArray:
    """Return a plan's point ahead, or the one at ``LEAST_AHEAD`` if the robot is there already."""
    along = np.cumsum([0.0, *np.linalg.norm(np.diff(plan.path, axis=0), axis=1)])
    here, least = (
        np.array([np.interp(plan.progress + ahead, along, plan.path[:, k]) for k in range(2)])
        for ahead in (0.0, LEAST_AHEAD)
    )
    return least if np.linalg.norm(point - here) < LEAST_AHEAD else point


class GuidedPlanner(ScanPlanner):
    """Plan with A* on a rolling costmap, and leave the next command to a subclass.

    The planner remembers n robots from the first call after ``reset`` on; a call with another
    number of them begins anew.
    """

    def __init__(
        self, robot: RobotSpec, control_dt: float, guide: GuideParams, look_ahead: float
    ) -> None:
        """Plan for a robot that is commanded every ``control_dt`` [s].

        ``look_ahead`` [m] is how far ahead on the plan the carrot lies.
        """
        super().__init__(robot)
        self.control_dt = control_dt
        self._guide, self._look_ahead = guide, look_ahead
        self._replan_after = whole_steps(guide.replan_s, control_dt)
        self._patience = whole_steps(guide.patience_s, control_dt)
        self._map: RollingCostmap | None = None
        self._timer = StepTimer(control_dt)
        self._told: tuple[float | None, ArrayLike | None] = (None, None)
        """The time and the poses of the present call, if they are known."""
        self._plans: list[GlobalPlan | None] = []
        self._spaces: list[FreeSpace | None] = []
        self._age = np.zeros(0, dtype=np.int64)

    @abstractmethod
    def command(self, situation: Situation) -> FloatArray:
        """Return the next commands (n, 2) [m/s, rad/s]."""

    def act(
        self,
        scan: ArrayLike,
        goal: ArrayLike,
        velocity: ArrayLike,
        *,
        now: float | None = None,
        applied: ArrayLike | None = None,
        pose: ArrayLike | None = None,
    ) -> FloatArray:
        """Return commands; see ``TimedPolicy.act``. What was applied does not matter.

        After a pause maps begin anew, unless odometry tells how far the robots came.

        Raises:
            InputError: as for ``Policy.act``, or a time or pose is not finite.
        """
        self._told = (now, pose)
        return super().act(scan, goal, velocity)

    def reset(self) -> None:
        """Forget maps and plans."""
        self._map = None
        self._timer.reset()

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only; there must have been a call of ``act``."""
        assert self._map is not None
        self._map.keep(robots)
        self._timer.keep(robots)
        self._plans = [self._plans[i] for i in robots]
        self._spaces = [self._spaces[i] for i in robots]
        self._age = self._age[robots]

    def begin(self, count: int) -> None:
        """Begin the memory of ``count`` robots; a subclass adds its own."""
        self._map = RollingCostmap(self.robot, self.control_dt, count, self._guide.costmap)
        self._plans = [None] * count
        self._spaces = [None] * count
        self._age = np.zeros(count, dtype=np.int64)

    def plan(self, scan: NDArray[np.float32], goal: FloatArray, velocity: FloatArray) -> FloatArray:
        """Follow the robots, plan where it is time to, and ask the subclass for commands."""
        seconds, _, paused, motion = self._timer.next(*self._told)
        lost = paused and motion is None
        if self._map is None or len(self._plans) != len(goal) or lost:
            self.begin(len(goal))
        assert self._map is not None
        self._map.observe(scan, velocity, seconds=seconds, motion=motion)
        clean = clean_ranges(scan, self.geometry)
        return self.command(Situation(clean, self._carrots(self._map, goal), velocity))

    def _carrots(self, maps: RollingCostmap, goals: FloatArray) -> FloatArray:
        """Return the carrots in base_link [m], shape (n, 2)."""
        targets = to_world(goals, maps.pose)
        points = np.array([self._point(maps, i, target) for i, target in enumerate(targets)])
        return to_frame(points.reshape(-1, 2), maps.pose)

    def _point(self, maps: RollingCostmap, i: int, goal: FloatArray) -> FloatArray:
        """Return robot i's carrot in the frame of its odometry [m], shape (2,)."""
        position = maps.pose[i, :2]
        self._age[i] += 1
        plan = self._plans[i]
        if plan is None or self._age[i] >= self._replan_after:
            plan = self._replan(maps, i, goal)
        ahead = plan.look_ahead(position, self._look_ahead)
        keeps = ahead.visible and ahead.deviation <= self._guide.strayed
        if not keeps and self._age[i] >= self._patience:
            plan = self._replan(maps, i, goal)
            ahead = plan.look_ahead(position, self._look_ahead)
        return self._way_out(i, position, _not_too_near(plan, ahead.point))

    def _way_out(self, i: int, position: FloatArray, point: FloatArray) -> FloatArray:
        """Return a point towards free space for a robot that is too close, else ``point``.

        The straight way to a point ahead may lead along the very corner that it is too close to.
        """
        space = self._spaces[i]
        assert space is not None
        x, y = position
        own, cell = space.cell(x, y), space.nearest_free(x, y, SNAP_DISTANCE)
        if cell is None or own is None or cell == own:
            return point
        way = space.centre(*np.array(cell)[:, None])[0] - position
        # Further away than the cell, so that it gives a direction.
        return position + LEAST_AHEAD / max(float(np.linalg.norm(way)), 1e-6) * way

    def _replan(self, maps: RollingCostmap, i: int, goal: FloatArray) -> GlobalPlan:
        """Plan from where robot i is; if there is no way, straight at the goal."""
        position, (costmap, roomy) = maps.pose[i, :2], maps.costmaps(i)
        try:
            path = plan_path(costmap, position, self._reachable(costmap, goal))
        except InputError:
            path = np.array([position, goal])
        self._plans[i] = plan = GlobalPlan(roomy, path)
        self._spaces[i] = costmap.space
        self._age[i] = 0
        return plan

    def _reachable(self, costmap: Costmap, goal: FloatArray) -> FloatArray:
        """Return the goal, or a free place on the map near it."""
        space = costmap.space
        low = np.array(space.origin) + EDGE * space.resolution
        height, width = space.free.shape
        high = low + (np.array([width, height]) - 2 * EDGE) * space.resolution
        inside = np.clip(goal, low, high)
        cell = space.nearest_free(inside[0], inside[1], self._guide.snap)
        if cell is None:
            return inside
        own = space.cell(inside[0], inside[1])
        return inside if cell == own else space.centre(*np.array(cell)[:, None])[0]
