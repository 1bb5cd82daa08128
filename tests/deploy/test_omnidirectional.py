# SPDX-License-Identifier: Apache-2.0
"""A robot that goes sideways, around which nothing may be safe only ahead and behind."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.identification import identify
from pm01_nav.deploy.messages import Odometry, Scan, odometry_from_ros, ros_twist
from pm01_nav.deploy.motion_check import Outline, time_to_contact
from pm01_nav.deploy.recording import Recording
from pm01_nav.deploy.safety import Reason, SafetyConfig, SafetySupervisor
from pm01_nav.deploy.simulated_robot import simulated_robot
from pm01_nav.drives import DifferentialDrive
from pm01_nav.errors import InputError
from pm01_nav.geometry import wrap_angle
from pm01_nav.robot import changed_robot, load_robot
from pm01_nav.task.scans import scan_geometry

DT = 0.1
OMNI = load_robot("omni_disc")
"""A disc of 0.17 m, 0.5 m/s in every direction, 1.5 rad/s, 2 m/s^2, 8 rad/s^2, lag 0.05 s."""
THREE_QUARTERS = {"num_beams": 271, "angle_min": -0.75 * math.pi, "angle_max": 0.75 * math.pi}


class Side:
    """A policy that goes straight to the goal, wherever the robot looks."""

    def reset(self) -> None:
        """Forget nothing."""

    def keep(self, robots: np.ndarray) -> None:
        """Drive one robot only."""

    def act(self, scan: np.ndarray, goal: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        assert velocity.shape == (3,)
        return np.array([*(0.4 * goal / max(np.hypot(*goal), 0.4)), 0.0])


def scan_of(robot, stamp: float, **ranges: float) -> Scan:
    """Return a free scan, but for beams named by their direction in degrees: ``at_90=0.4``."""
    lidar = robot.lidar
    values = np.full(lidar.num_beams, np.inf, dtype=np.float32)
    for name, value in ranges.items():
        direction = math.radians(float(name.removeprefix("at_").replace("minus_", "-")))
        values[round((direction - lidar.angle_min) / lidar.angle_increment)] = value
    limits = (lidar.angle_min, lidar.angle_increment, lidar.range_min, lidar.range_max)
    return Scan(stamp, *limits, values)


def fresh(robot=OMNI, twist=(0.0, 0.0, 0.0), **ranges: float) -> SafetySupervisor:
    """Return a supervisor that has just been told so at 10 s."""
    supervisor = SafetySupervisor(robot, DT, SafetyConfig())
    supervisor.see_odometry(Odometry(10.0, np.zeros(3), np.array(twist)), 10.0)
    supervisor.see_scan(scan_of(robot, 10.0, **ranges), 10.0)
    return supervisor


@pytest.mark.parametrize(
    ("twist", "place", "seconds"),
    [
        # The gap of 1 - 0.17 m at 0.5 m/s.
        ((0.0, 0.5, 0.0), (0.0, 1.0), 1.66),
        ((0.0, -0.5, 0.0), (0.0, -1.0), 1.66),
        ((0.0, 0.5, 0.0), (0.0, -1.0), math.inf),
        # 0.3 and 0.4 m/s are 0.5 m/s towards (0.6, 0.8).
        ((0.3, 0.4, 0.0), (0.6, 0.8), 1.66),
        # 0.2 m beside the way.
        ((0.0, 0.5, 0.0), (0.2, 1.0), math.inf),
        # To the left on a circle around (-0.5, 0): at half a turn the centre is at (-1, 0). Contact
        # is where the chord is 0.17 m: 2 asin(0.17) earlier than pi s.
        ((0.0, 0.5, 1.0), (-1.0, 0.0), math.pi - 2.0 * math.asin(0.17)),
    ],
)
def test_time_to_contact_of_a_disc_that_goes_sideways(twist, place, seconds):
    found = time_to_contact(Outline(OMNI.footprint), np.array([place]), twist, horizon=4.0)
    # Early by two looks at most: 2 x (4 s / 64).
    assert found == seconds if math.isinf(seconds) else seconds - 0.13 <= found <= seconds


def test_what_a_twist_means_to_a_drive():
    wheels = DifferentialDrive(-0.2, 0.5, 1.5, acceleration=(2.0, 8.0))
    assert wheels.courses == (0.0, math.pi)
    assert [wheels.course(twist) for twist in ((0.1, 1.0), (-0.1, 1.0), (0.0, 1.0))] == [
        0.0,
        math.pi,
        None,
    ]
    assert wheels.pace([-0.2, -1.0]).tolist() == [0.2, 1.0]
    omni = OMNI.base
    assert omni.course((0.3, 0.3, 0.0)) == pytest.approx(0.25 * math.pi)
    assert omni.course((-0.5, -0.0, 0.0)) == math.pi
    assert omni.course((0.0, -0.5, 1.0)) == -0.5 * math.pi
    assert omni.pace([0.3, -0.4, -1.0]) == pytest.approx([0.5, 1.0])


def test_speed_is_limited_slantwise_and_in_its_changes():
    # 2 m/s^2 and 8 rad/s^2 in 0.1 s.
    supervisor = fresh()
    assert supervisor.supervise((0.0, -9.0, 9.0), 10.0).command == pytest.approx((0, -0.2, 0.8))
    # 9 and 9 m/s become 0.5 and 0.5, of which a circle of 0.5 m/s leaves 0.354 each, once reached.
    told = [np.zeros(3)]
    supervisor = fresh()
    for step in range(4):
        now = 10.0 + DT * step
        supervisor.see_odometry(Odometry(now + 0.001, np.zeros(3), told[-1]), now)
        supervisor.see_scan(scan_of(OMNI, now + 0.001), now)
        told.append(np.array(supervisor.supervise((9.0, 9.0, 0.0), now).command))
    assert told[1] == pytest.approx((0.2, 0.2, 0.0))
    assert told[-1] == pytest.approx((0.5 / math.sqrt(2), 0.5 / math.sqrt(2), 0.0))


@pytest.mark.parametrize("proposed", [(0.1, 0.0), (0.0, math.nan, 0.0), (0.1, 0.0, 0.0, 0.0)])
def test_what_is_no_command_of_three_numbers_is_a_failure(proposed):
    verdict = fresh().supervise(proposed, 10.0)
    assert verdict.command == (0.0, 0.0, 0.0)
    assert verdict.reasons == (Reason.POLICY_FAILED,)


@pytest.mark.parametrize(
    ("twist", "plausible"),
    [
        # Three times 0.5 m/s is 1.5 m/s.
        ((0.0, 1.4, 0.0), True),
        ((0.0, 1.6, 0.0), False),
        ((0.0, 0.0), False),
    ],
)
def test_odometry_that_cannot_be(twist, plausible):
    assert (Reason.INVALID_ODOMETRY not in fresh(twist=twist).faults(10.0)) == plausible


def test_a_leap_to_the_side_is_a_jump_and_a_way_is_not():
    def after(way: float) -> set[Reason]:
        supervisor = fresh(twist=(0.0, 0.5, 0.0))
        pose = np.array([0.0, way, 0.0])
        supervisor.see_odometry(Odometry(10.1, pose, np.array([0.0, 0.5, 0.0])), 10.1)
        return set(supervisor.faults(10.1))

    # 0.1 s at twice 0.5 m/s and 0.3 m of slack.
    assert Reason.ODOMETRY_JUMP not in after(0.39)
    assert Reason.ODOMETRY_JUMP in after(0.41)


def test_a_wall_to_the_left_stops_what_goes_there_and_nothing_else():
    # 3 cm from the outline, of which 2 cm are padding.
    wall = {f"at_{angle}": 0.2 / math.sin(math.radians(angle)) for angle in range(60, 121)}
    into = fresh(**wall).supervise((0.0, 0.2, 0.3), 10.0)
    assert into.command == (0.0, 0.0, 0.3)
    assert into.reasons == (Reason.OBSTACLE,)
    for free in ((0.2, 0.0, 0.0), (0.0, -0.2, 0.0), (-0.1, -0.1, 0.2)):
        assert fresh(**wall).supervise(free, 10.0).command == free


def test_what_moves_sideways_towards_a_wall_is_slowed_in_time():
    # There are 0.28 - 0.17 - 0.02 m, 0.45 s at 0.2 m/s; 0.6 s are kept, at 0.15 m/s. It may be
    # taken for earlier by two looks, 2 x 0.05 s.
    wall = {f"at_minus_{angle}": 0.28 / math.sin(math.radians(angle)) for angle in range(45, 136)}
    verdict = fresh(twist=(0.0, -0.2, 0.0), **wall).supervise((0.0, -0.2, 0.0), 10.0)
    assert verdict.reasons == (Reason.SLOWED,)
    assert -0.15 <= verdict.command[1] <= -0.2 * 0.35 / 0.6
    # At 0.5 m/s it goes on for 0.15 + 0.1 + 0.05 s and brakes for 0.25 s, 0.2125 m: too far. What
    # it is told is slower than the share of its speed from which it still stops.
    late = fresh(twist=(0.0, -0.5, 0.0), **wall).supervise((0.0, -0.2, 0.0), 10.0)
    assert -0.15 <= late.command[1] <= 0.0
    # To the other side it is free.
    away = fresh(twist=(0.0, 0.2, 0.0), **wall).supervise((0.0, 0.2, 0.0), 10.0)
    assert away.command == (0.0, 0.2, 0.0)


@pytest.mark.parametrize(
    ("course", "seen"),
    # The lidar sees 135 deg to either side; a slanting course needs 22.5 deg more than its own.
    [(0, True), (90, True), (-90, True), (112, True), (114, False), (135, False), (180, False)],
)
def test_a_lidar_that_sees_three_quarters_allows_no_motion_into_the_fourth(course, seen):
    robot = changed_robot(OMNI, {"lidar": THREE_QUARTERS})
    angle = math.radians(course)
    asked = (0.15 * math.cos(angle), 0.15 * math.sin(angle), 0.2)
    verdict = fresh(robot).supervise(asked, 10.0)
    assert verdict.reasons == (() if seen else (Reason.UNSEEN,))
    assert verdict.command == (asked if seen else (0.0, 0.0, 0.2))


def test_a_side_that_is_not_seen_is_none_to_go_to():
    # What 40 beams to the left say, of which most lie within 45 deg of it, is not valid.
    lost = {f"at_{angle}": math.nan for angle in range(80, 120)}
    assert fresh(**lost).supervise((0.0, 0.2, 0.0), 10.0).reasons == (Reason.UNSEEN,)
    assert fresh(**lost).supervise((0.0, -0.2, 0.0), 10.0).reasons == ()
    assert fresh(**lost).supervise((0.2, 0.0, 0.0), 10.0).reasons == ()


def test_messages_have_a_number_for_each_axis():
    assert ros_twist((0.1, 0.2)) == (0.1, 0.0, 0.2)
    assert ros_twist(np.array([0.1, 0.3, 0.2])) == (0.1, 0.3, 0.2)
    named = SimpleNamespace
    turn = named(x=0.0, y=0.0, z=0.0, w=1.0)
    twist = named(linear=named(x=0.1, y=0.3, z=9.0), angular=named(x=9.0, y=9.0, z=0.2))
    message = named(
        header=named(stamp=named(sec=3, nanosec=0), frame_id="odom"),
        pose=named(pose=named(position=named(x=1.0, y=2.0), orientation=turn)),
        twist=named(twist=twist),
    )
    assert odometry_from_ros(message, OMNI.base.axes).twist.tolist() == [0.1, 0.3, 0.2]
    assert odometry_from_ros(message).twist.tolist() == [0.1, 0.2]


def test_drives_sideways_to_a_goal_and_turns_there():
    robot = simulated_robot("empty", "omni_disc", seed=0, dt=0.02)
    geometry = scan_geometry(OMNI.lidar)
    controller = Controller(
        Side(), OMNI, geometry, control_dt=DT, goal_radius=0.1, safety=SafetyConfig(),
        same_clock=True,
    )  # fmt: skip
    way = robot.goal - robot.pose[:2]
    north = math.atan2(way[1], way[0])
    robot.place(np.array([*robot.pose[:2], north - math.pi / 2]), robot.goal)
    controller.set_goal(Goal(*robot.goal, north))
    courses, arrived = [], False
    for step in range(1500):
        if robot.step():
            controller.see_scan(robot.scan(), robot.time)
        controller.see_odometry(robot.odometry(), robot.time)
        if step % 5 == 4:
            status = controller.step(robot.time)
            robot.command(*status.verdict.command)
            far = status.goal_distance > 0.3
            courses += [status.verdict.command[:2]] if far else []
            arrived |= status.arrived
        if arrived:
            break
    assert arrived
    # The goal was to the left until it turned there, to within 0.25 rad of the goal's heading.
    assert min(left - 10.0 * abs(ahead) for ahead, left in courses) > 0.0
    assert abs(wrap_angle(robot.pose[2] - north)) <= 0.25
    assert robot.collisions == 0


def test_only_a_drive_that_has_a_model_is_identified():
    only = "robot omni_disc: the drive omnidirectional cannot be identified; can be: differential$"
    with pytest.raises(InputError, match=only):
        load_controller("excite", "omni_disc")
    with pytest.raises(InputError, match=only):
        identify(Recording(np.zeros((0, 3)), np.zeros((0, 6)), []), OMNI)


@pytest.mark.parametrize("backend", ["mujoco", "pybullet", "gazebo", "gazebo_transport"])
def test_an_engine_that_turns_wheels_refuses_a_robot_without(backend):
    what = f"backend = '{backend}': cannot move robot omni_disc, whose drive is omnidirectional"
    with pytest.raises(InputError, match=what):
        make_simulator(backend, NUMPY, OMNI, None, 1)


def test_the_judge_sees_nothing_unsafe_and_would_see_it(safety_fuzz, monkeypatch):
    robot = safety_fuzz.robot_with("omni_disc", 360)

    def violations(seeds: int) -> set[str]:
        sequences = [safety_fuzz.Sequence(k, robot, safety_fuzz.HONEST) for k in range(seeds)]
        for sequence in sequences:
            sequence.controller.clock = lambda: 0.0
            sequence.run()
        return {name for sequence in sequences for name in sequence.violations}

    assert violations(8) == set()
    monkeypatch.setattr(SafetySupervisor, "_share", lambda *_, **__: (1.0, math.inf))
    assert violations(12) == {"drives into a disc"}
