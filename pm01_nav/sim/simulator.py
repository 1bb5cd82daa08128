# SPDX-License-Identifier: Apache-2.0
"""The batched planar simulator: many independent robots, one call a control step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.robot import RobotSpec
from pm01_nav.sim import kernels
from pm01_nav.sim.random import stream_keys
from pm01_nav.sim.state import (
    PEDESTRIAN_MODELS,
    CrowdParams,
    Features,
    PedestrianModel,
    SimState,
    Sizes,
    TimeStep,
    base_params,
    lidar_params,
    new_scratch,
    new_state,
)
from pm01_nav.sim.threads import ThreadChoice
from pm01_nav.worlds.pool import WorldPool

NO_FEATURES = Features()
FEW = 64
"""Up to this many environments are reset by one thread."""
MAX_TRAVEL = 0.05
"""The robot moves at most this far between two checks for contact [m]."""


class PlanarSimulator:
    """Simulate ``num_envs`` independent robots in worlds of a pool.

    Every environment has a random stream of its own, so its trajectory depends on its seed and
    commands alone: not on the size of the batch, not on the number of threads.
    """

    def __init__(
        self,
        robot: RobotSpec,
        pool: WorldPool,
        num_envs: int,
        *,
        control_dt: float = 0.1,
        goal_distance: tuple[float, float] = (0.0, math.inf),
        features: Features = NO_FEATURES,
        pedestrians: PedestrianModel = "orca",
        pedestrians_avoid_robot: bool = True,
    ) -> None:
        """Allocate the batch; call ``seed`` and ``reset`` before the first ``step``.

        ``control_dt`` [s] is the time between commands, ``goal_distance`` [m] the least and the
        greatest straight distance from a start to its goal. ``pedestrians`` is how they avoid each
        other, and the robot too if ``pedestrians_avoid_robot``.
        """
        self.robot = robot
        self.pool = pool
        self.num_envs = num_envs
        self.control_dt = control_dt
        arrays, beams, trail = pool.arrays, robot.lidar.num_beams, features.trail
        sizes = Sizes(
            beams=beams,
            sectors=features.sectors or beams,
            movers=int(np.diff(arrays.mover_begin).max(initial=0)),
            path_cells=int(np.diff(arrays.way_begin).max()) if features.path_distances else 0,
            trail_capacity=trail.capacity,
            trail_sectors=trail.sectors,
        )
        self.state: SimState = new_state(num_envs, sizes)
        self._scratch = new_scratch(num_envs, sizes)
        self._trail = trail
        self._goal_distance = np.array(goal_distance, dtype=np.float64)
        self._threads = ThreadChoice()
        self._base = base_params(robot)
        self._lidar = lidar_params(robot)
        model = PEDESTRIAN_MODELS[pedestrians]
        self._crowd = CrowdParams(model, pedestrians_avoid_robot, control_dt)
        fastest = max(robot.limits.linear_max, -robot.limits.linear_min)
        substeps = max(2, math.ceil(fastest * control_dt / MAX_TRAVEL - 1e-9))
        dt, lag = control_dt / substeps, robot.actuator.lag_s
        self._time = TimeStep(dt, substeps, math.exp(-dt / lag) if lag > 0.0 else 0.0)

    @property
    def scan(self) -> NDArray[np.float32]:
        """Lidar ranges by REP-117 [m], shape (num_envs, num_beams), beam 0 at angle_min."""
        return self.state.scan

    def limit_goal_distance(self, limits: tuple[float, float]) -> None:
        """Set the least and the greatest distance from a start to its goal [m] from now on."""
        self._goal_distance[:] = limits

    def seed(self, seeds: ArrayLike) -> None:
        """Begin the random stream of each environment anew; ``seeds`` has shape (num_envs,)."""
        self.state.rng_key[:] = stream_keys(np.asarray(seeds))
        self.state.rng_count[:] = 0

    def reset(
        self, indices: NDArray[np.int64] | None = None, worlds: NDArray[np.int64] | None = None
    ) -> None:
        """Start new episodes in some environments (all by default).

        ``worlds`` fixes the world of each, shape like ``indices``; by default one is drawn.
        """
        if indices is None:
            indices = np.arange(self.num_envs)
        self.state.world[indices] = -1 if worlds is None else worlds
        reset = kernels.reset_few if len(indices) <= FEW else kernels.reset_many
        reset(
            self.state,
            indices,
            self._base,
            self._lidar,
            self.pool.arrays,
            self._trail,
            self._goal_distance,
            self._scratch,
        )

    def step(self, command: NDArray[np.float64]) -> None:
        """Apply velocity commands (num_envs, 2) [m/s, rad/s] for one control step."""
        self._threads(
            kernels.step_batch,
            self.state,
            command,
            self._base,
            self._lidar,
            self.pool.arrays,
            self._time,
            self._crowd,
            self._trail,
        )

    def movers(self, i: int) -> NDArray[np.float64]:
        """Return x, y and radius of the movers of environment i, shape (n, 3) [m]."""
        count = self.state.mover_count[i]
        position, radius = self.state.mover_position[i, :count], self.state.mover_radius[i, :count]
        return np.concatenate([position, radius[:, None]], axis=1)

    def place(self, indices: NDArray[np.int64], poses: ArrayLike, goals: ArrayLike) -> None:
        """Put robots at rest at ``poses`` (n, 3) with ``goals`` (n, 2) in their present worlds."""
        self.state.pose[indices] = poses
        yaw = self.state.pose[indices, 2]
        self.state.heading[indices] = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        self.state.goal[indices] = goals
        self.state.twist[indices] = 0.0
        self.state.contact[indices] = False
        kernels.observe_batch(
            self.state,
            indices,
            self._base,
            self._lidar,
            self.pool.arrays,
            self._trail,
            self._scratch,
        )
