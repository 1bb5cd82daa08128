# SPDX-License-Identifier: Apache-2.0
"""The batched planar simulator: many independent robots, one call a control step."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.arrays import array_namespace
from pm01_nav.compilation import bound
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.sim import engine_kernels, kernels
from pm01_nav.sim.kernels import ABSENT
from pm01_nav.sim.lidar import read_scans
from pm01_nav.sim.perturbation import (
    ErrorState,
    Perturbation,
    fastest_factor,
    new_errors,
    new_perturbation,
)
from pm01_nav.sim.random import stream_keys
from pm01_nav.sim.state import (
    PEDESTRIAN_MODELS,
    CrowdParams,
    Features,
    FloatArray,
    PedestrianModel,
    SimState,
    Sizes,
    TimeStep,
    base_params,
    lidar_params,
    new_scratch,
    new_state,
    rows,
)
from pm01_nav.sim.threads import ThreadChoice
from pm01_nav.worlds.pool import WorldPool

NO_FEATURES = Features()
MAX_TRAVEL = 0.05
"""The robot moves at most this far between two checks for contact [m]."""


class Simulator(ABC):
    """``num_envs`` independent robots in worlds of a pool; what moves them adds ``step``.

    Worlds, starts, goals, moving obstacles and what sensors say are here, the same for all that
    move robots. Every environment has a random stream of its own, so its trajectory depends on its
    seed and commands alone: not on the size of the batch, not on the number of threads.
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
        self.drive = robot.base
        self.pool = pool
        self.num_envs = num_envs
        self.control_dt = control_dt
        arrays = pool.arrays_for(robot.lidar.range_max)
        beams, trail = robot.lidar.num_beams, features.trail
        sizes = Sizes(
            beams=beams,
            sectors=features.sectors or beams,
            axes=self.drive.size,
            movers=int(np.diff(arrays.mover_begin).max(initial=0)),
            path_cells=int(np.diff(arrays.way_begin).max()) if features.path_distances else 0,
            trail_capacity=trail.capacity,
            trail_size=trail.sectors + 1 if trail.sectors else 0,
        )
        self.state: SimState = new_state(num_envs, sizes)
        self._has_movers = sizes.movers > 0
        self._scratch = new_scratch(num_envs, sizes)
        self._trail = trail
        self._goal_distance = np.array(goal_distance, dtype=np.float64)
        self._threads = ThreadChoice(alone=num_envs == 1)
        crowd = CrowdParams(PEDESTRIAN_MODELS[pedestrians], pedestrians_avoid_robot, control_dt)
        self._crowd = crowd if self._has_movers else ABSENT
        self._scene = (base_params(robot), lidar_params(robot), arrays)
        self._time = self._time_step(1.0)
        self.errors: ErrorState | None = None
        """What perturbed robots have beside ``state``; None if all are as described."""
        self.drawn: Perturbation | None = None
        """What is wrong with each robot in its present episode; None if nothing is."""
        self.faults: dict[int, str] = {}
        """Environments that cannot go on, with the reason; the plane knows none."""
        self._ranges: Perturbation | None = None
        self._run_step: Callable[[FloatArray], None] | None = None
        self._run_reset: Callable[[NDArray[np.int64]], None] | None = None

    def _time_step(self, fastest_factor: float) -> TimeStep:
        """Divide a control step for a robot that goes faster than described by a factor."""
        lag = self.robot.actuator.lag_s
        fastest = fastest_factor * self.drive.top_speed
        substeps = max(2, math.ceil(fastest * self.control_dt / MAX_TRAVEL - 1e-9))
        dt = self.control_dt / substeps
        return TimeStep(dt, substeps, math.exp(-dt / lag) if lag > 0.0 else 0.0)

    def perturb(self, ranges: Perturbation) -> None:
        """Let each episode draw what is wrong with its robot from ``ranges``, each of shape (2,).

        It counts from the next ``reset`` on, which all environments need.
        """
        self.errors = new_errors(self.num_envs, self.robot.lidar.num_beams, self.drive.size, ranges)
        self.drawn = new_perturbation(self.num_envs)
        self._ranges = ranges
        self._time = self._time_step(fastest_factor(ranges))
        self._run_step = self._run_reset = None  # other kernels from now on

    @abstractmethod
    def step(self, command: Any) -> None:
        """Apply velocity commands (num_envs, axes) [m/s, rad/s] for one control step.

        Raises:
            ValueError: their shape is another one.
        """

    @property
    def scan(self) -> NDArray[np.float32]:
        """What the lidar says by REP-117 [m], shape (num_envs, num_beams), beam 0 at angle_min.

        It is made anew at each call: most steps need no more than ``SimState.nearest``.
        """
        return self._read(self.state.ranges)

    @property
    def measured_pose(self) -> FloatArray:
        """Where the robot believes to be by odometry, like ``SimState.pose``."""
        return self.state.pose if self.errors is None else self.errors.odometry_pose

    @property
    def measured_goal(self) -> FloatArray:
        """Distance and bearing of the goal by odometry [m, rad], shape (num_envs, 2)."""
        return self.state.goal_polar if self.errors is None else self.errors.measured_goal

    @property
    def measured_twist(self) -> FloatArray:
        """The robot's twist by odometry, like ``SimState.twist``."""
        return self.state.twist if self.errors is None else self.errors.measured_twist

    def true_scan(self) -> NDArray[np.float32]:
        """Return the scan of a lidar that has no errors but its description's noise, like ``scan``.

        It is cast anew where the robots are perturbed.
        """
        return self.scan

    def _read(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        lidar = self.robot.lidar
        scan = np.empty((self.num_envs, lidar.num_beams), dtype=np.float32)
        read_scans(ranges, scan, lidar.range_min, lidar.range_max)
        return scan

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return every array that makes up the state, by name; they are not copied."""
        arrays = self.state._asdict()
        if self.errors is None or self.drawn is None:
            return arrays
        return arrays | self.errors._asdict() | self.drawn._asdict()

    def limit_goal_distance(self, limits: tuple[float, float]) -> None:
        """Set the least and the greatest distance from a start to its goal [m] from now on."""
        self._goal_distance[:] = limits

    def draw_worlds(self, weights: FloatArray) -> None:
        """Draw worlds in proportion to ``weights`` (num_worlds,) from the next reset on.

        Raises:
            ValueError: a weight is negative or not finite, or none is positive.
        """
        self.pool.set_weights(weights)

    def seed(self, seeds: ArrayLike, indices: Any = slice(None)) -> None:
        """Begin random streams anew: those of the environments ``indices``, all by default.

        ``seeds`` (n,) has one for each.
        """
        self.state.rng_key[indices] = stream_keys(np.asarray(seeds))
        self.state.rng_count[indices] = 0

    def reset(
        self,
        indices: NDArray[np.int64 | np.bool_] | None = None,
        worlds: NDArray[np.int64] | None = None,
    ) -> None:
        """Start new episodes in some environments (all by default).

        ``indices`` may also be a mask of all. ``worlds`` fixes the world of each, shape like
        ``indices``; by default one is drawn.
        """
        if indices is None:
            indices = np.arange(self.num_envs)
        elif indices.dtype == np.bool_:
            indices = np.flatnonzero(indices)
        indices = np.ascontiguousarray(indices, dtype=np.int64)
        self.state.world[indices] = -1 if worlds is None else worlds
        if self._run_reset is None:
            self._run_reset = self._bind_reset(indices)
        self._run_reset(indices)

    def checked(self, command: ArrayLike) -> FloatArray:
        """Return commands as an array of the shape that they must have.

        Raises:
            ValueError: their shape is another one.
        """
        command = np.ascontiguousarray(command, dtype=np.float64)
        if command.shape != self.state.twist.shape:
            raise ValueError(f"command: shape {command.shape}, needs {self.state.twist.shape}")
        return command

    def _bind_reset(self, indices: NDArray[np.int64]) -> Callable[[NDArray[np.int64]], None]:
        """Return the function that resets robots of this batch, such as ``indices``."""
        own = (self.state, self.errors or ABSENT, self.drawn or ABSENT, self._ranges or ABSENT)
        rest = (*self._scene, self._trail, self._goal_distance, self._scratch, self._crowd)
        run = bound(kernels.reset_some, *own, indices, *rest)
        return lambda indices: run(*own, indices, *rest)

    def resume(self) -> None:  # noqa: B027 (a default, not a gap)
        """Go on from arrays that were written from outside: here they are all there is."""

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the environments only, as if there had never been others."""
        self.num_envs = len(indices)
        self.state = rows(self.state, indices)
        self._scratch = rows(self._scratch, indices)
        if self.errors is not None and self.drawn is not None:
            self.errors, self.drawn = rows(self.errors, indices), rows(self.drawn, indices)
        self._threads = self._threads.anew()
        self._run_step = self._run_reset = None  # They hold the former arrays.

    def move_obstacles(self) -> None:
        """Move what moves in the worlds for a control step, where an engine moves the robots."""
        if self._has_movers:
            base, _, arrays = self._scene
            move = self._threads.version(engine_kernels.move_obstacles)
            move(self.state, base, arrays, self._crowd)

    def perceive(self, indices: NDArray[np.int64], *, first: bool) -> None:
        """Measure what is owed at the poses and exact ranges that an engine wrote for ``indices``.

        ``first`` tells whether their episodes begin.
        """
        engine_kernels.perceive(self.state, indices, *self._scene, self._trail, first)

    def picture(self, i: int, eye_offset: FloatArray, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3) of robot ``i`` and its goal.

        The camera stands ``eye_offset`` (3,) [m] from the robot; ``size`` is width, height [px].

        Raises:
            InputError: there is nothing to draw with.
        """
        raise InputError("render: the planar simulator has nothing to render; add --backend mujoco")

    def movers(self, i: int) -> NDArray[np.float64]:
        """Return x, y and radius of the movers of environment i, shape (n, 3) [m]."""
        count = self.state.mover_count[i]
        position, radius = self.state.mover_position[i, :count], self.state.mover_radius[i, :count]
        return np.concatenate([position, radius[:, None]], axis=1)

    def place(self, indices: NDArray[np.int64], poses: ArrayLike, goals: ArrayLike) -> None:
        """Put robots at rest at ``poses`` (n, 3) with ``goals`` (n, 2) in their present worlds."""
        self._stand(indices, poses, goals)
        own = (self.state, self.errors or ABSENT, self.drawn or ABSENT)
        kernels.observe_some(*own, indices, *self._scene, self._trail, self._scratch)

    def _stand(self, indices: Any, poses: Any, goals: Any) -> None:
        """Write poses (n, 3) and goals (n, 2) of robots at rest."""
        state = self.state
        state.pose[indices] = poses
        yaw = state.pose[indices, 2]
        xp = array_namespace(yaw)
        state.heading[indices] = xp.stack([xp.cos(yaw), xp.sin(yaw)], axis=-1)
        state.goal[indices] = goals
        state.twist[indices] = 0.0
        state.contact[indices] = False


class PlanarSimulator(Simulator):
    """Robots that slide over the plane as their drives say, on the CPU."""

    def step(self, command: ArrayLike) -> None:
        """Apply velocity commands (num_envs, axes) [m/s, rad/s]; see ``Simulator``."""
        command = self.checked(command)
        if self._run_step is None:
            self._run_step = self._bind_step(command)
        self._threads(self._run_step, command)

    def _bind_step(self, command: FloatArray) -> Callable[[FloatArray], None]:
        """Return the function that steps this batch; ``command`` is one as it will be given."""
        own = (self.state, self.errors or ABSENT, self.drawn or ABSENT)
        rest = (*self._scene, self._time, self._trail, self._crowd)
        run = bound(self._threads.version(kernels.step_batch), *own, command, *rest)
        return lambda command: run(*own, command, *rest)

    def true_scan(self) -> NDArray[np.float32]:
        """Return the scan of a lidar without errors; see ``Simulator``."""
        if self.errors is None:
            return self.scan
        ranges = np.empty_like(self.state.ranges)
        cast = self._threads.version(kernels.true_ranges)
        cast(self.state, *self._scene, ranges)
        return self._read(ranges)
