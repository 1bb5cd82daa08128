# SPDX-License-Identifier: Apache-2.0
"""Robots in PyBullet: all of them on one floor, too far apart to meet or to see each other."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from pm01_nav.backends.body import WHEEL_FRICTION, BodyModel, body_model
from pm01_nav.backends.drive import WheelController
from pm01_nav.backends.engine import PHYSICS_DT, Motion, Scenario, View, ticks_in
from pm01_nav.backends.pybullet_picture import draw
from pm01_nav.backends.pybullet_shapes import (
    OBSTACLE_COLOUR,
    UPRIGHT,
    Shape,
    cylinder,
    other_polygons,
    prism,
    robot_shapes,
    static_shapes,
)
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.mjcf import HEIGHT
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

RAYS, FLOOR, FEET, HULL, OBSTACLES = 1, 2, 4, 8, 16
"""Collision groups: wheels and casters meet the floor, the hull meets obstacles; PyBullet itself
puts rays into the first."""
GRAVITY = 9.81
"""[m/s^2], as MuJoCo has it."""
MOST_SHAPES = 16
"""Shapes that PyBullet makes one body of."""
GAP = 5.0
"""Between what one robot may reach or see and the next one's world [m]."""
MOST_RAYS = 16_000
"""Rays that PyBullet casts at a time."""
WHEELS, CASTERS = (0, 1), (2, 3)
"""Links of the robot, left and front first; its base is the hull."""
GRIP = 10.0
"""Greatest torque of a wheel, by what its grip could ever need."""


class PybulletEngine:
    """One client of PyBullet for all robots; see ``Engine``."""

    odometry = None

    def __init__(
        self, robot: RobotSpec, worlds: Sequence[World], num_envs: int, control_dt: float
    ) -> None:
        """Prepare ``num_envs`` robots; each stands alone in a square of the floor."""
        self._body, self._worlds = body_model(robot), worlds
        ticks = ticks_in(control_dt)
        tick = control_dt / ticks
        self._wheels = WheelController(robot, num_envs, control_dt, ticks)
        self._substeps = max(1, round(tick / PHYSICS_DT))
        self._client = bullet.connect(bullet.DIRECT)
        weakref.finalize(self, bullet.disconnect, self._client)
        self._call(bullet.setGravity, 0, 0, -GRAVITY)
        self._call(bullet.setTimeStep, tick / self._substeps)
        # With its defaults robots at rest creep by a millimetre in ten seconds.
        self._call(
            bullet.setPhysicsEngineParameter,
            numSolverIterations=100,
            solverResidualThreshold=1e-9,
        )
        self._range_max = robot.lidar.range_max
        plane = self._call(bullet.createCollisionShape, bullet.GEOM_PLANE, planeNormal=[0, 0, 1])
        floor = self._call(bullet.createMultiBody, 0, plane)
        self._call(bullet.changeDynamics, floor, -1, lateralFriction=1.0)
        self._call(bullet.setCollisionFilterGroupMask, floor, -1, FLOOR, FEET | RAYS)
        self._origins = self._lay_out(num_envs)
        self._shapes = robot_shapes(self._client, self._body)
        self._robots = [self._make_robot(origin) for origin in self._origins]
        self._worlds_in = [-1] * num_envs
        self._obstacles: list[list[int]] = [[] for _ in range(num_envs)]
        self._movers: list[list[int]] = [[] for _ in range(num_envs)]

    def reset(self, i: int, scenario: Scenario) -> None:
        """Put robot ``i`` at rest where its scenario says; see ``Engine``."""
        if self._worlds_in[i] != scenario.world:
            self._clear(i)
            self._build(i, scenario.world)
        self._move(i, scenario.movers)
        x, y, yaw = scenario.pose
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        # PyBullet places the centre of mass.
        centre = self._body.hull_centre
        height = self._body.wheel_radius + centre[2] + scenario.height
        place = self._origins[i] + [x, y, height]
        place[:2] += turn @ centre[:2]
        robot, heading = self._robots[i], (0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0))
        self._call(bullet.resetBasePositionAndOrientation, robot, place.tolist(), heading)
        self._call(bullet.resetBaseVelocity, robot, (0, 0, 0), (0, 0, 0))
        for wheel in WHEELS:
            self._call(bullet.resetJointState, robot, wheel, 0.0, 0.0)
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
        motion.contact[:] = False
        torque = 2 * [GRIP * self._body.mass * GRAVITY * self._body.wheel_radius]
        for speeds, places in zip(wheel_speeds, movers, strict=True):
            for i, robot in enumerate(self._robots):
                self._call(
                    bullet.setJointMotorControlArray,
                    robot,
                    WHEELS,
                    bullet.VELOCITY_CONTROL,
                    targetVelocities=speeds[i].tolist(),
                    forces=torque,
                )
                self._move(i, places[i])
            for _ in range(self._substeps):
                self._call(bullet.stepSimulation)
            for i, robot in enumerate(self._robots):
                touching = self._call(bullet.getContactPoints, bodyA=robot, linkIndexA=-1)
                motion.contact[i] |= any(point[8] <= 0.0 for point in touching)
        for i in range(len(self._robots)):
            motion.pose[i], motion.twist[i] = self._read(i)
        self.cast(np.flatnonzero(np.isfinite(motion.pose[:, 0])), ranges)

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the exact ranges of some robots' lidars [m]; see ``Engine``."""
        for i in indices.tolist():
            self._cast(i, ranges[i])

    def _cast(self, i: int, ranges: NDArray[np.float32]) -> None:
        place, turn = self._base(i)
        origin = place + turn @ self._body.lidar
        tips = origin + self._range_max * (self._body.beams @ turn.T)
        for begin in range(0, len(tips), MOST_RAYS):
            some = tips[begin : begin + MOST_RAYS]
            hits = self._call(
                bullet.rayTestBatch,
                np.broadcast_to(origin, some.shape).tolist(),
                some.tolist(),
                collisionFilterMask=OBSTACLES | FLOOR,
            )
            share = np.array([hit[2] if hit[0] >= 0 else np.inf for hit in hits])
            ranges[begin : begin + len(some)] = self._range_max * share

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Return a picture of robot ``i``'s world, (height, width, 3); see ``Engine``."""
        return draw(self._client, self._origins[i], view)

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the robots only."""
        for i in sorted(set(range(len(self._robots))) - set(indices.tolist())):
            self._clear(i)
            self._call(bullet.removeBody, self._robots[i])
        self._origins = self._origins[indices]
        self._robots = [self._robots[i] for i in indices]
        self._worlds_in = [self._worlds_in[i] for i in indices]
        self._obstacles = [self._obstacles[i] for i in indices]
        self._movers = [self._movers[i] for i in indices]
        self._wheels.twist = self._wheels.twist[indices]

    def _call(self, function: Any, *arguments: Any, **named: Any) -> Any:
        return function(*arguments, physicsClientId=self._client, **named)

    def _lay_out(self, num_envs: int) -> FloatArray:
        """Return where the origin of each robot's world lies on the floor, (num_envs, 3) [m]."""
        farthest = max(np.abs(world.bounds).max() for world in self._worlds)
        side = 2.0 * farthest + self._range_max + GAP
        index, row = np.arange(num_envs), math.isqrt(num_envs)
        # Around the middle of the floor, where numbers are smallest.
        columns = np.stack([index % row, index // row, np.full(num_envs, 0)], axis=-1)
        return side * (columns - [row // 2, row // 2, 0]).astype(np.float64)

    def _make_robot(self, origin: FloatArray) -> int:
        """Return a robot at rest at ``origin``."""
        body = self._body
        half, (front, rear) = body.wheel_separation / 2.0, body.casters.tolist()
        low, light, shapes = body.caster_height, 1e-3 * body.mass, self._shapes
        robot = self._call(
            bullet.createMultiBody,
            body.hull_mass,
            shapes.hull,
            shapes.hull_look,
            basePosition=np.add(origin, [0, 0, body.wheel_radius]).tolist(),
            baseInertialFramePosition=body.hull_centre.tolist(),
            linkMasses=[body.wheel_mass, body.wheel_mass, light, light],
            linkCollisionShapeIndices=[shapes.wheel] * 2 + [shapes.caster] * 2,
            linkVisualShapeIndices=[shapes.wheel_look] * 2 + [shapes.caster_look] * 2,
            linkPositions=[(0, half, 0), (0, -half, 0), (front, 0, low), (rear, 0, low)],
            linkOrientations=[UPRIGHT] * 4,
            linkInertialFramePositions=[(0, 0, 0)] * 4,
            linkInertialFrameOrientations=[UPRIGHT] * 4,
            linkParentIndices=[0] * 4,
            linkJointTypes=[bullet.JOINT_REVOLUTE] * 2 + [bullet.JOINT_FIXED] * 2,
            linkJointAxis=[(0, 1, 0)] * 4,
        )
        self._set_dynamics(robot, body)
        return robot

    def _set_dynamics(self, robot: int, body: BodyModel) -> None:
        """Set inertia, friction and what the robot's parts may meet."""
        inertia = body.hull_inertia.tolist()
        free = {"linearDamping": 0.0, "angularDamping": 0.0, "jointDamping": 0.0}
        self._call(bullet.changeDynamics, robot, -1, localInertiaDiagonal=inertia, **free)
        self._call(bullet.setCollisionFilterGroupMask, robot, -1, HULL, OBSTACLES)
        for link in (*WHEELS, *CASTERS):
            friction = WHEEL_FRICTION if link in WHEELS else 0.0
            self._call(bullet.changeDynamics, robot, link, lateralFriction=friction, **free)
            self._call(bullet.setCollisionFilterGroupMask, robot, link, FEET, FLOOR)

    def _build(self, i: int, world: int) -> None:
        """Put up the obstacles of a world around robot ``i``."""
        place = self._origins[i].tolist()
        shapes = static_shapes(self._worlds[world])
        for begin in range(0, len(shapes), MOST_SHAPES):
            shape = self._compound(shapes[begin : begin + MOST_SHAPES])
            self._obstacles[i].append(self._call(bullet.createMultiBody, 0, shape, -1, place))
        for outline in other_polygons(self._worlds[world]):
            shape, look = prism(self._client, outline, 0.0, HEIGHT, OBSTACLE_COLOUR)
            self._obstacles[i].append(self._call(bullet.createMultiBody, 0, shape, look, place))
        for mover in self._worlds[world].movers:
            shape = self._compound([cylinder(0.0, 0.0, mover.radius)])
            self._movers[i].append(self._call(bullet.createMultiBody, 0, shape, -1, place))
        for obstacle in self._obstacles[i] + self._movers[i]:
            self._call(bullet.setCollisionFilterGroupMask, obstacle, -1, OBSTACLES, HULL | RAYS)
        self._worlds_in[i] = world

    def _compound(self, shapes: Sequence[Shape]) -> int:
        return self._call(
            bullet.createCollisionShapeArray,
            shapeTypes=[shape.kind for shape in shapes],
            radii=[shape.radius for shape in shapes],
            lengths=[HEIGHT] * len(shapes),
            halfExtents=[shape.half for shape in shapes],
            collisionFramePositions=[shape.place for shape in shapes],
            collisionFrameOrientations=[shape.turn for shape in shapes],
        )

    def _clear(self, i: int) -> None:
        """Take the obstacles around robot ``i`` away."""
        for obstacle in self._obstacles[i] + self._movers[i]:
            self._call(bullet.removeBody, obstacle)
        self._obstacles[i], self._movers[i] = [], []

    def _move(self, i: int, places: FloatArray) -> None:
        """Put the movers around robot ``i`` where they are now."""
        for mover, place in zip(self._movers[i], places.tolist(), strict=False):
            there = (self._origins[i] + [*place, 0.0]).tolist()
            self._call(bullet.resetBasePositionAndOrientation, mover, there, UPRIGHT)

    def _base(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Return where ``base_link`` is on the floor (3,) and its rotation (3, 3)."""
        centre, quaternion = self._call(bullet.getBasePositionAndOrientation, self._robots[i])
        turn = np.array(bullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        return np.array(centre) - turn @ self._body.hull_centre, turn

    def _read(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Return x, y, yaw and v, w of robot ``i`` in its own world."""
        place, turn = self._base(i)
        linear, angular = self._call(bullet.getBaseVelocity, self._robots[i])
        # Of the axle's middle, not of the centre of mass.
        velocity = np.array(linear) - np.cross(angular, turn @ self._body.hull_centre)
        x, y, _ = place - self._origins[i]
        yaw = math.atan2(turn[1, 0], turn[0, 0])
        v = velocity[0] * math.cos(yaw) + velocity[1] * math.sin(yaw)
        return np.array([x, y, yaw]), np.array([v, angular[2]])
