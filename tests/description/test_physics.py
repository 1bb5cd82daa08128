# SPDX-License-Identifier: Apache-2.0
"""MuJoCo and PyBullet load the description, and it stands on a floor."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

MASS = 4.165
"""3.0 + 0.65 + 2 * 0.15 + 2 * 0.04 + 0.125 + 0.01 [kg]."""
FEET = {"wheel_left_link", "wheel_right_link", "caster_front_link", "caster_rear_link"}


def test_stands_in_mujoco(expand: Callable[..., str]) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo (extra physics)")
    spec = mujoco.MjSpec.from_string(expand(base_footprint="false"))
    # Without this all links without joints melt into the world.
    spec.compiler.fusestatic = False
    spec.body("base_link").add_freejoint()
    spec.body("base_link").pos = [0, 0, 0.05]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    model = spec.compile()
    assert model.body_mass.sum() == pytest.approx(MASS, abs=1e-9)
    # The free joint and two wheels.
    assert (model.njnt, model.nv) == (3, 8)
    data = mujoco.MjData(model)
    for _ in range(int(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    geoms = {int(g) for contact in data.contact for g in contact.geom}
    touching = {model.body(model.geom_bodyid[g]).name for g in geoms} - {"world"}
    assert touching == FEET
    # The floor carries its weight: 4.165 kg * 9.81 m/s^2.
    weight = 0.0
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        weight += force[0]
    assert weight == pytest.approx(MASS * 9.81, rel=0.01)
    # It stays where it was put, but for the softness of the contacts.
    assert data.body("base_link").xpos == pytest.approx([0, 0, 0.05], abs=1e-3)
    assert abs(data.body("base_link").xquat[0]) > 0.99999


def test_wheels_roll_forward_in_mujoco(expand: Callable[..., str]) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo (extra physics)")
    model = mujoco.MjModel.from_xml_string(expand())
    data = mujoco.MjData(model)
    data.joint("wheel_left_joint").qvel = 1.0
    mujoco.mj_forward(model, data)
    velocity = np.zeros(6)
    body = model.body("wheel_left_link").id
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
    # About +y the lowest point runs backwards under the robot: w x r = (0, 1, 0) x (0, 0, -r).
    bottom = np.cross(velocity[:3], [0, 0, -0.05])
    assert bottom == pytest.approx([-0.05, 0, 0], abs=1e-9)


def test_drives_straight_and_turns_in_mujoco(expand: Callable[..., str]) -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo (extra physics)")
    spec = mujoco.MjSpec.from_string(expand(base_footprint="false"))
    spec.compiler.fusestatic = False
    spec.body("base_link").add_freejoint()
    spec.body("base_link").pos = [0, 0, 0.05]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 0.1])
    for end in ("front", "rear"):
        for geom in spec.body(f"caster_{end}_link").geoms:
            # A contact takes the larger friction of both, unless one has priority.
            geom.friction, geom.priority = [0.01, 0.005, 0.0001], 1
    for side in ("left", "right"):
        motor = spec.add_actuator(name=side, target=f"wheel_{side}_joint")
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_velocity(kv=1.0)
        # The limit of the joint's effort [N m].
        motor.forcelimited, motor.forcerange = True, [-1.0, 1.0]
    model = spec.compile()
    data = mujoco.MjData(model)

    def drive(left: float, right: float, seconds: float) -> None:
        data.ctrl[:] = [left, right]
        for _ in range(round(seconds / model.opt.timestep)):
            mujoco.mj_step(model, data)

    drive(6.0, 6.0, 0.5)
    before = data.qpos[:2].copy()
    drive(6.0, 6.0, 1.0)
    # 6 rad/s * 0.05 m = 0.3 m in a second; contacts slip a little.
    assert data.qpos[:2] - before == pytest.approx([0.3, 0.0], abs=0.015)
    drive(-2.8, 2.8, 0.5)
    # 2 * 2.8 * 0.05 / 0.28 = 1 rad/s.
    assert data.qvel[5] == pytest.approx(1.0, abs=0.05)


def test_stands_in_pybullet(expand: Callable[..., str], tmp_path: Path) -> None:
    bullet = pytest.importorskip("pybullet", reason="needs PyBullet")
    path = tmp_path / "pm01.urdf"
    path.write_text(expand(base_footprint="false"))
    client = bullet.connect(bullet.DIRECT)
    try:
        bullet.setGravity(0, 0, -9.81, physicsClientId=client)
        shape = bullet.createCollisionShape(
            bullet.GEOM_PLANE, planeNormal=[0, 0, 1], physicsClientId=client
        )
        floor = bullet.createMultiBody(0, shape, physicsClientId=client)
        robot = bullet.loadURDF(
            str(path),
            [0, 0, 0.05],
            flags=bullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        names = {-1: "base_link"}
        for joint in range(bullet.getNumJoints(robot, physicsClientId=client)):
            names[joint] = bullet.getJointInfo(robot, joint, physicsClientId=client)[12].decode()
        masses = [bullet.getDynamicsInfo(robot, i, physicsClientId=client)[0] for i in names]
        assert sum(masses) == pytest.approx(MASS)
        for _ in range(240):
            bullet.stepSimulation(physicsClientId=client)
        # Bullet keeps a margin of 1 mm around cylinders, so that the balls may hang by as much,
        # and the robot leans on one of them.
        near = bullet.getClosestPoints(robot, floor, 2.5e-3, physicsClientId=client)
        assert {names[point[3]] for point in near} == FEET
        touching = bullet.getContactPoints(robot, floor, physicsClientId=client)
        assert {"wheel_left_link", "wheel_right_link"} <= {names[point[3]] for point in touching}
        position, turn = bullet.getBasePositionAndOrientation(robot, physicsClientId=client)
        assert position[:2] == pytest.approx([0, 0], abs=2e-3)
        # Level within 2 mm on 0.26 m; the base's frame is its centre of mass, 0.0575 m high.
        assert turn[:2] == pytest.approx([0, 0], abs=8e-3)
        assert position[2] == pytest.approx(0.0575, abs=2e-3)
    finally:
        bullet.disconnect(client)
