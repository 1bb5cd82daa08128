# SPDX-License-Identifier: Apache-2.0
"""Robots in MuJoCo: its contacts, its rays, the whole batch in its own threads."""

from __future__ import annotations

import os
from collections import OrderedDict, defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco as mujoco_package
import numpy as np
from mujoco.rollout import Rollout
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pm01_nav.backends.body import body_model
from pm01_nav.backends.drive import WheelController
from pm01_nav.backends.engine import PHYSICS_DT, Motion, Scenario, View, ticks_in
from pm01_nav.backends.mujoco_model import ROBOT_GROUP, robot_in_world
from pm01_nav.backends.mujoco_picture import draw
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

mujoco: Any = mujoco_package
"""Type checkers see nothing of what is compiled."""

MOST_MODELS = 2048
"""Compiled worlds that are kept for the next episode in them."""
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS)
PLACE, SPEED = slice(1, 8), slice(10, 16)
"""Where the base's x, y, z, quaternion and its velocity stand in a state."""
SIZES = ("nbody", "ngeom", "nmocap", "nbvh", "nbvhstatic", "nbvhdynamic", "narena")


class Compiled(NamedTuple):
    """A world's model, and what fits any model of its size."""

    model: Any
    size: tuple[int, ...]


class MujocoEngine:
    """One row of ``MjData``'s state a robot, one ``MjModel`` a world; see ``Engine``."""

    odometry = None

    def __init__(
        self, robot: RobotSpec, worlds: Sequence[World], num_envs: int, control_dt: float
    ) -> None:
        """Prepare ``num_envs`` robots; worlds are compiled when they are first needed."""
        self._worlds = worlds
        self._body = body_model(robot)
        ticks = ticks_in(control_dt)
        tick = control_dt / ticks
        self._wheels = WheelController(robot, num_envs, control_dt, ticks)
        self._substeps = max(1, round(tick / PHYSICS_DT))
        self._dt = tick / self._substeps
        self._range_max = robot.lidar.range_max
        self._seen = np.ones(6, dtype=np.uint8)
        self._seen[ROBOT_GROUP] = 0
        self._models: OrderedDict[int, Compiled] = OrderedDict()
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        self._threads = 1 if num_envs == 1 else cores
        # One robot is stepped by the caller: a forked process would be without the threads.
        self._rollout = Rollout(nthread=0 if num_envs == 1 else cores)
        # MuJoCo's own timers, which nobody reads here, take a tenth of a step.
        mujoco.set_mjcb_time(None)
        # Its warnings would become a file in the working folder; who diverged is told otherwise.
        mujoco.set_mju_user_warning(_say_nothing)
        self._data: dict[tuple[int, ...], list[Any]] = {}
        self._robots: list[Compiled | None] = [None] * num_envs
        self._groups: dict[tuple[int, ...], NDArray[np.int64]] = {}
        self._state: FloatArray = np.zeros((num_envs, 18))
        self._movers: list[FloatArray] = [np.zeros((0, 2))] * num_envs

    def reset(self, i: int, scenario: Scenario) -> None:
        """Put robot ``i`` at rest where its scenario says; see ``Engine``."""
        compiled = self._compiled(scenario.world)
        if self._robots[i] is not compiled:
            self._robots[i] = compiled
            self._groups = {}
        x, y, yaw = scenario.pose
        self._state[i] = 0.0
        turn = np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)
        self._state[i, PLACE] = x, y, self._body.wheel_radius + scenario.height, *turn
        self._movers[i] = scenario.movers.copy()
        self._wheels.twist[i] = 0.0

    def step(
        self,
        command: FloatArray,
        movers: FloatArray,
        motion: Motion,
        ranges: NDArray[np.float32],
    ) -> None:
        """Drive every robot for a control step; see ``Engine``."""
        wheel_speeds = self._wheels.wheel_speeds(command)
        for size, some in (self._groups or self._group()).items():
            self._drive(size, some, wheel_speeds[:, some], movers[:, some], motion)
        for i in range(len(self._robots)):
            self._movers[i] = movers[-1, i]
        self._read(motion)
        self.cast(np.flatnonzero(np.isfinite(motion.pose[:, 0])), ranges)

    def _group(self) -> dict[tuple[int, ...], NDArray[np.int64]]:
        """Return which robots can be stepped together, by the size of their models."""
        groups = defaultdict(list)
        for i, robot in enumerate(self._robots):
            assert robot is not None
            groups[robot.size].append(i)
        self._groups = {size: np.array(some) for size, some in groups.items()}
        return self._groups

    def _drive(
        self,
        size: tuple[int, ...],
        some: NDArray[np.int64],
        wheel_speeds: FloatArray,
        movers: FloatArray,
        motion: Motion,
    ) -> None:
        """Step robots of one size through a control step."""
        robots = [self._robots[i] for i in some]
        models = [robot.model for robot in robots if robot is not None]
        count = models[0].nmocap
        places = np.zeros((*movers.shape[:2], count, 3))
        places[..., :2] = movers[:, :, :count]
        controls = np.concatenate([wheel_speeds, places.reshape(*movers.shape[:2], -1)], axis=-1)
        controls = np.repeat(controls, self._substeps, axis=0).transpose(1, 0, 2)
        steps = controls.shape[1]
        state = np.empty((len(some), steps, self._state.shape[1]))
        touch = np.empty((len(some), steps, 1))
        self._rollout.rollout(
            models,
            self._data[size],
            self._state[some],
            np.ascontiguousarray(controls),
            control_spec=CONTROLS,
            skip_checks=True,
            nstep=steps,
            state=state,
            sensordata=touch,
            chunk_size=max(1, len(some) // (4 * self._threads)),
        )
        self._state[some] = state[:, -1]
        motion.contact[some] = (touch > 0.0).any(axis=(1, 2))

    def _read(self, motion: Motion) -> None:
        """Write the robots' places and speeds in the plane."""
        x, y, _, qw, qx, qy, qz = self._state[:, PLACE].T
        yaw = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        motion.pose[:] = np.stack([x, y, yaw], axis=-1)
        vx, vy, _, _, _, w = self._state[:, SPEED].T
        motion.twist[:] = np.stack([vx * np.cos(yaw) + vy * np.sin(yaw), w], axis=-1)

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the exact ranges of some robots' lidars [m]; see ``Engine``."""
        count, reach = len(self._body.beams), self._range_max
        place = self._state[indices, PLACE]
        # MuJoCo's quaternions begin with the scalar, SciPy's end with it.
        turn = Rotation.from_quat(place[:, [4, 5, 6, 3]]).as_matrix()
        origins = place[:, :3] + turn @ self._body.lidar
        along = (self._body.beams @ turn.transpose(0, 2, 1)).reshape(len(indices), -1)
        distance = np.empty((len(indices), count))
        geoms = np.empty(count, dtype=np.int32)
        for i, origin, beams, row in zip(indices.tolist(), origins, along, distance, strict=True):
            model, data = self._show(i)
            mujoco.mj_multiRay(
                model, data, origin, beams, self._seen, True, -1, geoms, row, None, count, reach
            )
        missed = (distance < 0.0) | (distance > reach)
        ranges[indices, :count] = np.where(missed, np.inf, distance)

    def _show(self, i: int) -> tuple[Any, Any]:
        """Return the model of robot ``i``, and data in which everything is where it is now."""
        robot = self._robots[i]
        assert robot is not None
        model, data = robot.model, self._data[robot.size][0]
        mujoco.mj_setState(model, data, self._state[i], STATE)
        if model.nmocap:
            data.mocap_pos[:, :2] = self._movers[i][: model.nmocap]
        mujoco.mj_kinematics(model, data)
        return model, data

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Return a picture of robot ``i``'s world, (height, width, 3); see ``Engine``."""
        return draw(*self._show(i), view)

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the robots only."""
        self._robots = [self._robots[i] for i in indices]
        self._movers = [self._movers[i] for i in indices]
        self._state, self._groups = self._state[indices], {}
        self._wheels.twist = self._wheels.twist[indices]

    def _compiled(self, world: int) -> Compiled:
        """Return the model of a world; the most recent ones are kept."""
        if world in self._models:
            self._models.move_to_end(world)
            return self._models[world]
        text = robot_in_world(self._body, self._worlds[world], self._dt)
        model = mujoco.MjModel.from_xml_string(text)
        compiled = Compiled(model, tuple(int(getattr(model, name)) for name in SIZES))
        if compiled.size not in self._data:
            self._data[compiled.size] = [mujoco.MjData(model) for _ in range(self._threads)]
        self._models[world] = compiled
        if len(self._models) > MOST_MODELS:
            self._models.popitem(last=False)
        return compiled


def _say_nothing(warning: str) -> None:
    """Take a warning of MuJoCo."""
