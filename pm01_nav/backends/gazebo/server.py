# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""Gazebo's server in this process, paused between control steps.

It is started in a process of its own (``worker``): a crash of the server must not take the
training with it, and each server needs a partition of the transport for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gz.math7 import Pose3d  # noqa: F401 (before a callback handles poses, or the server aborts)
from gz.msgs10.boolean_pb2 import Boolean
from gz.msgs10.contacts_pb2 import Contacts
from gz.msgs10.entity_factory_pb2 import EntityFactory
from gz.msgs10.entity_pb2 import Entity
from gz.msgs10.image_pb2 import Image
from gz.msgs10.laserscan_pb2 import LaserScan
from gz.msgs10.odometry_pb2 import Odometry
from gz.msgs10.pose_v_pb2 import Pose_V
from gz.msgs10.twist_pb2 import Twist
from gz.sim8 import K_NULL_ENTITY, Link, Model, TestFixture, world_entity
from gz.sim8 import World as GazeboWorld
from gz.transport13 import Node
from numpy.typing import NDArray

from pm01_nav.backends.engine import Scenario, View
from pm01_nav.backends.gazebo import model as names
from pm01_nav.backends.gazebo.messages import (
    pixels_of,
    pose_of,
    pose_since,
    ranges_of,
    subscribe,
    twist_of,
)
from pm01_nav.backends.gazebo.worker import Reading, Setup
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, wrap_angle
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

REQUEST_MS = 2000
"""Limit for a service of our own server."""
SCAN_TIMEOUT_S = 20.0
"""The first scan takes seconds: the scene is built then."""
REST_STEPS = 20
"""Control steps after which a robot without a command must stand still."""
AT_REST = 2e-3
"""A robot slower than this stands still [m/s, rad/s]."""


class GazeboServer:
    """One server with one robot."""

    def __init__(self, world: Path, setup: Setup) -> None:
        """Start the server on an SDF world of ``model``.

        Raises:
            InputError: it cannot load the world, the robot is not in it, or its lidar is silent.
        """
        self._setup = setup
        self._folder = world.parent
        self._mesh = self._folder / "obstacles_0.obj"
        self._time_ns = 0
        self._left = 0
        self._poses: list[FloatArray] = []
        self._robot = K_NULL_ENTITY
        self._obstacles: list[str] = []
        self._movers: list[str] = []
        self._changes = 0
        self._mover_places = np.zeros((setup.ticks, 0, 2))
        self._goal: tuple[float, float] | None = None
        self._anchor: tuple[FloatArray, FloatArray] = (np.zeros(3), np.zeros(3))
        self._node = Node()
        self._scans = subscribe(self._node, names.SCAN, LaserScan)
        self._odometry = subscribe(self._node, names.ODOM, Odometry)
        self._touches = subscribe(self._node, names.TOUCH, Contacts)
        self._pictures = subscribe(self._node, names.PICTURE, Image)
        self._command = self._node.advertise(names.CMD_VEL, Twist)
        self._fixture = TestFixture(str(world))
        self._fixture.on_post_update(self._look)
        self._fixture.finalize()
        self._server = self._fixture.server()
        if not self._server.has_entity(names.ROBOT, 0):
            raise InputError("Gazebo started without the robot; see its log")
        # The first step makes the scene, before which no scan is of use.
        self._step(np.zeros((setup.ticks, 0, 2)))
        self._scans.wait(self._time_ns, SCAN_TIMEOUT_S)

    def reset(self, scenario: Scenario, world: World | None) -> Reading:
        """Put the robot at rest where its scenario says; see ``Server.reset``.

        Raises:
            InputError: Gazebo does not do as it is told, or the robot does not come to rest.
        """
        if world is not None:
            self._replace(world)
        self._publish(np.zeros(2))
        self._teleport(scenario)
        still = np.broadcast_to(scenario.movers, (self._setup.ticks, *scenario.movers.shape))
        for _ in range(REST_STEPS):
            self._step(still)
            if np.abs(self._twist()).max() < AT_REST:
                break
        else:
            raise InputError(f"the robot does not come to rest at {scenario.pose.round(3)}")
        self._teleport(scenario)
        self._step(still)
        self._anchor = (
            self._poses[-1],
            pose_of(self._odometry.wait(self._time_ns, SCAN_TIMEOUT_S)),
        )
        return self._read()

    def step(self, command: FloatArray, movers: FloatArray) -> Reading:
        """Drive for a control step by v and w (2,); see ``Engine.step``."""
        self._touches.clear()
        self._publish(command)
        self._step(movers)
        return self._read()

    def picture(self, view: View) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3) as of the last step; the first one takes a step.

        The camera is where the picture before wanted it.
        """
        if view.goal != self._goal:
            if self._goal:
                self._request("remove", Entity(name="goal", type=Entity.MODEL), Entity)
            self._request("create", EntityFactory(sdf=names.goal_model(view)), EntityFactory)
        if not self._goal:
            model = names.camera_model(view.size, 1.0 / self._setup.control_dt)
            self._request("create", EntityFactory(sdf=model), EntityFactory)
        first, self._goal = not self._goal, view.goal
        self._aim(view)
        if first:
            self._step(self._mover_places)
        return pixels_of(self._pictures.wait(self._time_ns, SCAN_TIMEOUT_S), names.PICTURE)

    def _aim(self, view: View) -> None:
        message = Pose_V()
        _add_pose(message, "camera", view.eye, names.towards(view))
        self._request("set_pose_vector", message, Pose_V)

    def _publish(self, command: FloatArray) -> None:
        """Give the drive a command: within a process it is delivered before this returns."""
        twist = Twist()
        twist.linear.x, twist.angular.z = float(command[0]), float(command[1])
        self._command.publish(twist)

    def _step(self, movers: FloatArray) -> None:
        """Run one control step; ``movers`` (ticks, at least n, 2) [m] is where they are."""
        setup, whole = self._setup, 1 if self._movers else self._setup.ticks
        self._mover_places = np.broadcast_to(movers[-1], movers.shape)
        for tick in range(0, setup.ticks, whole):
            self._place_movers(movers[tick])
            iterations = whole * setup.iterations
            self._left = iterations
            self._server.run(True, iterations, False)
        self._time_ns += round(setup.control_dt * 1e9)

    def _place_movers(self, places: FloatArray) -> None:
        if not self._movers:
            return
        message = Pose_V()
        for name, (x, y) in zip(self._movers, places.tolist(), strict=False):
            height = names.HEIGHT / 2.0 + names.MOVER_GAP
            _add_pose(message, name, (x, y, height))
        self._request("set_pose_vector", message, Pose_V)

    def _teleport(self, scenario: Scenario) -> None:
        message = Pose_V()
        x, y, yaw = scenario.pose.tolist()
        place = (x, y, self._setup.wheel_radius + scenario.height)
        _add_pose(message, names.ROBOT, place, (0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)))
        self._request("set_pose_vector", message, Pose_V)

    def _replace(self, world: World) -> None:
        """Take the present obstacles away and put others up; they stand there after a step."""
        for name in (*self._obstacles, *self._movers):
            self._request("remove", Entity(name=name, type=Entity.MODEL), Entity)
        self._changes += 1
        # New names: the old models leave in the same step in which these come.
        self._obstacles = [f"obstacles_{self._changes}"]
        self._movers = [f"mover_{self._changes}_{k}" for k in range(len(world.movers))]
        # A new file, too: Gazebo keeps the meshes that it has read.
        self._mesh.unlink(missing_ok=True)
        self._mesh = self._folder / f"obstacles_{self._changes}.obj"
        models = [names.obstacles_model(world, self._mesh)]
        models += [names.mover_model(mover.radius) for mover in world.movers]
        for name, model in zip((*self._obstacles, *self._movers), models, strict=True):
            self._request("create", EntityFactory(sdf=model, name=name), EntityFactory)

    def _request(self, service: str, message: Any, message_type: Any) -> None:
        address = f"/world/{names.WORLD}/{service}"
        done, answer = self._node.request(address, message, message_type, Boolean, REQUEST_MS)
        if not (done and answer.data):
            raise InputError(f"Gazebo's service {address} did not answer within {REQUEST_MS} ms")

    def _look(self, info: Any, ecm: Any) -> None:
        """Note where the robot is after the last two steps of the physics."""
        del info
        self._left -= 1
        if self._left > 1:
            return
        if self._robot == K_NULL_ENTITY:
            model = GazeboWorld(world_entity(ecm)).model_by_name(ecm, names.ROBOT)
            self._robot = Model(model).link_by_name(ecm, "base_link")
        pose = Link(self._robot).world_pose(ecm)
        here = np.array([pose.x(), pose.y(), pose.yaw()])
        self._poses = [*self._poses[-1:], here]

    def _twist(self) -> FloatArray:
        """Return v and w of the last step of the physics."""
        before, now = self._poses
        way = to_frame(now[:2], before)
        turn = float(wrap_angle(now[2] - before[2]))
        return np.array([way[0], turn]) / self._setup.physics_dt

    def _read(self) -> Reading:
        # With it all contacts but those of the very last step of the physics are there.
        odometry = self._odometry.wait(self._time_ns, SCAN_TIMEOUT_S)
        scan = self._scans.wait(self._time_ns, SCAN_TIMEOUT_S)
        begin = self._time_ns - round(self._setup.control_dt * 1e9)
        return Reading(
            pose=self._poses[-1],
            twist=self._twist(),
            odometry_pose=pose_since(*self._anchor, pose_of(odometry)),
            odometry_twist=twist_of(odometry),
            contact=self._touches.latest(begin + 1) is not None,
            ranges=ranges_of(scan, self._setup.num_beams, names.SCAN),
        )


def _add_pose(
    message: Pose_V,
    name: str,
    place: Sequence[float],
    turn: Sequence[float] | FloatArray = (0.0, 0.0, 0.0, 1.0),
) -> None:
    """Add where a model is to be; ``turn`` is a quaternion x, y, z, w."""
    pose = message.pose.add()
    pose.name = name
    at, rotation = pose.position, pose.orientation
    at.x, at.y, at.z = (float(value) for value in place)
    rotation.x, rotation.y, rotation.z, rotation.w = (float(value) for value in turn)
