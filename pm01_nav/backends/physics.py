# SPDX-License-Identifier: Apache-2.0
"""The same robots, worlds and episodes as in the planar simulator, moved by a physics engine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.backends.engine import MakeEngine, Motion, Scenario, View, ticks_in
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame
from pm01_nav.robot import RobotSpec
from pm01_nav.sim.settings import Perturbation
from pm01_nav.sim.simulator import Simulator
from pm01_nav.worlds.pool import WorldPool

FloatArray = NDArray[np.float64]

GOAL_MARKER = 0.15
"""Radius of the disc that marks the goal in pictures [m]."""
POSSIBLE = 1e7
"""No coordinate [m] or speed [m/s] is beyond; NaN is not below."""
DIVERGED = "the physics diverged"


class PhysicsSimulator(Simulator):
    """Robots with wheels, weight and contacts, moved by an engine.

    Worlds, starts, goals and movers are those that the planar simulator draws for the same seed.
    Clearance is measured in the plane. Readings have the described lidar's noise.
    """

    def __init__(
        self,
        make: MakeEngine,
        robot: RobotSpec,
        pool: WorldPool,
        num_envs: int,
        *,
        localized: bool = False,
        feels: bool = True,
        **how: Any,
    ) -> None:
        """Allocate the batch; ``how`` is as for ``Simulator``.

        ``localized`` robots know their place as if by a perfect map, whatever their wheels say. An
        engine that does not tell what robots touch ``feels`` nothing; the plane tells then.
        """
        super().__init__(robot, pool, num_envs, **how)
        self._localized, self._feels = localized, feels
        self._engine = make(robot, pool.worlds, num_envs, self.control_dt)
        self._motion = Motion.of(num_envs)

    @property
    def measured_pose(self) -> FloatArray:
        """Where the robot believes to be, like ``SimState.pose``."""
        odometry = self._engine.odometry
        return self.state.pose if odometry is None or self._localized else odometry.pose

    @property
    def measured_goal(self) -> FloatArray:
        """Distance and bearing of the goal as the robot believes [m, rad], shape (num_envs, 2)."""
        if self._engine.odometry is None or self._localized:
            return self.state.goal_polar
        x, y = to_frame(self.state.goal, self._engine.odometry.pose).T
        return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=-1)

    @property
    def measured_twist(self) -> FloatArray:
        """The robot's v and w by odometry [m/s, rad/s], shape (num_envs, 2)."""
        odometry = self._engine.odometry
        return self.state.twist if odometry is None else odometry.twist

    def perturb(self, ranges: Perturbation) -> None:
        """Refuse: only the planar simulator has perturbed robots."""
        raise InputError("randomization: only the backend planar has it")

    def reset(
        self,
        indices: NDArray[np.int64 | np.bool_] | None = None,
        worlds: NDArray[np.int64] | None = None,
    ) -> None:
        """Start new episodes in some environments (all by default); see ``Simulator``."""
        super().reset(indices, worlds)
        if indices is None:
            indices = np.arange(self.num_envs)
        elif indices.dtype == np.bool_:
            indices = np.flatnonzero(indices)
        self._set_down(indices)

    def place(self, indices: NDArray[np.int64], poses: ArrayLike, goals: ArrayLike) -> None:
        """Put robots at rest at ``poses`` (n, 3) with ``goals`` (n, 2) in their present worlds."""
        super().place(indices, poses, goals)
        self._set_down(indices)

    def resume(self) -> None:
        """Go on from arrays that were written from outside; an engine's own state is not in them.

        So robots begin at rest where they are.
        """
        self._set_down(np.arange(self.num_envs))

    def _set_down(self, indices: NDArray[Any]) -> None:
        """Put robots at rest into the engine where their poses are, and look around."""
        state = self.state
        for i in indices:
            movers = state.mover_position[i, : state.mover_count[i]]
            scenario = Scenario(int(state.world[i]), state.pose[i], movers)
            self._engine.reset(int(i), scenario)
        self._engine.cast(np.asarray(indices), state.ranges)
        self.faults = {i: why for i, why in self.faults.items() if i not in indices}
        self.perceive(np.asarray(indices, dtype=np.int64), first=True)

    def step(self, command: ArrayLike) -> None:
        """Apply velocity commands (num_envs, 2) [m/s, rad/s] for one control step.

        Raises:
            ValueError: their shape is another one.
        """
        command = self.checked(command)
        state, motion = self.state, self._motion
        motion.lost.clear()
        self._engine.step(command, self._tracks(), motion, state.ranges)
        moved = np.abs(np.concatenate([motion.pose, motion.twist], axis=1))
        # NaN is not below anything.
        sound: Any = np.less(moved.max(axis=1), POSSIBLE)
        self.faults = {int(i): motion.lost.get(int(i), DIVERGED) for i in np.flatnonzero(~sound)}
        # Whom the engine lost stands where it last was.
        np.copyto(state.pose, motion.pose, where=sound[:, None])
        state.twist[:] = np.where(sound[:, None], motion.twist, 0.0)
        state.heading[:, 0], state.heading[:, 1] = (
            np.cos(state.pose[:, 2]),
            np.sin(state.pose[:, 2]),
        )
        state.contact[:] = motion.contact & sound
        self.perceive(np.arange(self.num_envs), first=False)
        if not self._feels:
            state.contact[:] |= state.clearance <= 0.0

    def picture(self, i: int, eye_offset: FloatArray, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return a picture of robot ``i`` and its goal; see ``Simulator``."""
        x, y, _ = self.state.pose[i].tolist()
        goal = (float(self.state.goal[i, 0]), float(self.state.goal[i, 1]))
        eye = (x + eye_offset[0], y + eye_offset[1], eye_offset[2])
        return self._engine.picture(i, View(eye, (x, y, 0.1), size, goal, GOAL_MARKER))

    def _tracks(self) -> FloatArray:
        """Move what moves; return where it is at each tick, (ticks, num_envs, most movers, 2)."""
        before = self.state.mover_position.copy()
        self.move_obstacles()
        way = self.state.mover_position - before
        ticks = ticks_in(self.control_dt)
        share = np.arange(1, ticks + 1) / ticks
        return before + share[:, None, None, None] * way

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the environments only, as if there had never been others."""
        super().keep(indices)
        self._engine.keep(indices)
        self._motion = Motion.of(len(indices))
