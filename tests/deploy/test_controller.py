# SPDX-License-Identifier: Apache-2.0
"""The controller: goals, what it asks the policy, and a drive in the simulator."""

from __future__ import annotations

import math
import subprocess
import sys
import time

import numpy as np
import pytest

from pm01_nav.deploy.controller import Controller
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.safety import Reason, SafetyConfig
from pm01_nav.deploy.simulated_robot import SimulatedRobot
from pm01_nav.errors import InputError
from pm01_nav.planners import make_planner
from pm01_nav.task.observation import ObservationLayout, UsualParts
from pm01_nav.task.randomization import RandomizationConfig
from pm01_nav.task.scans import scan_geometry
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool


class Recorder:
    """A policy that notes what it is asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[np.ndarray, ...]] = []
        self.resets = 0
        self.answer = (0.1, 0.0)

    def reset(self) -> None:
        self.resets += 1

    def keep(self, robots) -> None: ...

    def act(self, scan, goal, velocity):
        self.asked.append((scan, np.array(goal), np.array(velocity)))
        return self.answer


class TimedRecorder(Recorder):
    """One that is told what went on since it was asked last."""

    def act(self, scan, goal, velocity, *, now=None, applied=None, pose=None):
        self.told = (now, applied, tuple(pose))
        return super().act(scan, goal, velocity)


@pytest.fixture
def policy():
    return Recorder()


@pytest.fixture
def make_controller(robot, make_scan, make_odometry):
    def make(policy, control_dt: float = 0.1) -> Controller:
        """Return a controller of a robot at (1, 2) that looks along y and sees free space."""
        controller = Controller(
            policy,
            robot,
            scan_geometry(robot.lidar),
            control_dt=control_dt,
            goal_radius=0.3,
            safety=SafetyConfig(),
        )
        controller.see_odometry(make_odometry(5.0, 0.2, 0.1, (1.0, 2.0, math.pi / 2)), 5.0)
        controller.see_scan(make_scan(5.0), 5.0)
        return controller

    return make


@pytest.fixture
def controller(make_controller, policy):
    return make_controller(policy)


def test_the_policy_sees_the_goal_from_where_the_robot_is(controller, policy):
    controller.set_goal(Goal(0.0, 5.0))
    status = controller.step(5.0)
    # The robot at (1, 2) looks along y: the goal is 3 m ahead and 1 m to the left.
    _, goal, velocity = policy.asked[0]
    assert goal == pytest.approx([3.0, 1.0])
    assert velocity == pytest.approx([0.2, 0.1])
    assert status.goal_distance == pytest.approx(math.sqrt(10.0))
    assert status.verdict.command == (0.1, 0.0)


def test_without_a_goal_the_robot_stands_and_the_policy_is_not_asked(controller, policy):
    status = controller.step(5.0)
    assert status.verdict.command == (0.0, 0.0)
    assert status.verdict.reasons == (Reason.NO_GOAL,)
    assert policy.asked == []


def test_a_goal_within_its_radius_is_reached_once(controller):
    controller.set_goal(Goal(1.0, 2.29))
    first, second = controller.step(5.0), controller.step(5.1)
    assert first.arrived
    assert first.verdict.command == (0.0, 0.0)
    assert not second.arrived
    assert controller.goal is None


def test_the_emergency_stop_ends_the_goal(controller, policy):
    controller.set_goal(Goal(0.0, 5.0))
    controller.set_emergency(True)
    assert controller.step(5.0).verdict.command == (0.0, 0.0)
    controller.set_emergency(False)
    # Releasing it does not start the robot: that takes a new goal.
    assert controller.step(5.05).verdict.reasons == (Reason.NO_GOAL,)
    controller.set_goal(Goal(0.0, 5.0))
    assert controller.step(5.1).verdict.command == pytest.approx((0.1, 0.0))


def test_a_button_that_repeats_that_it_is_released_ends_nothing(controller):
    controller.set_goal(Goal(0.0, 5.0))
    controller.set_emergency(False)
    assert controller.step(5.0).verdict.command == pytest.approx((0.1, 0.0))


def test_a_goal_sent_under_the_emergency_stop_is_not_taken(controller):
    controller.set_emergency(True)
    controller.set_goal(Goal(0.0, 5.0))
    controller.set_emergency(False)
    assert controller.step(5.0).verdict.reasons == (Reason.NO_GOAL,)


def test_a_policy_that_takes_too_long_is_not_obeyed(controller, policy):
    controller.set_goal(Goal(0.0, 5.0))
    # Longer than a control step of 0.1 s: by now a watchdog says stop, and must not be overruled.
    policy.act = lambda *_: time.sleep(0.12) or (0.1, 0.0)
    status = controller.step(5.0)
    assert status.verdict.reasons == (Reason.POLICY_FAILED,)
    assert "longer than a control step" in controller.failure


def test_a_policy_is_timed_by_the_clock_that_the_robot_runs_by(controller, policy):
    times = iter([7.0, 7.0, 8.0, 8.11])
    controller.clock = lambda: next(times)
    controller.set_goal(Goal(0.0, 5.0))
    # In a simulation that waits no time goes by, however long it takes on the wall...
    policy.act = lambda *_: time.sleep(0.12) or (0.1, 0.0)
    assert controller.step(5.0).verdict.reasons == ()
    # ... and in one that races a moment may be longer than a control step of 0.1 s.
    policy.act = lambda *_: (0.1, 0.0)
    assert controller.step(5.1).verdict.reasons == (Reason.POLICY_FAILED,)


def test_a_policy_is_told_what_the_robot_was_told_and_how_far_it_came(
    make_controller, make_scan, make_odometry
):
    policy, north = TimedRecorder(), math.pi / 2
    controller = make_controller(policy)
    controller.set_goal(Goal(0.0, 9.0))
    policy.answer = (0.5, 0.0)
    # From standing 2 m/s^2 reach 0.2 m/s in a step, and that is what it was given.
    assert controller.step(5.0).verdict.command == pytest.approx((0.2, 0.0))
    assert policy.told == (5.0, (0.0, 0.0), (1.0, 2.0, north))
    controller.see_odometry(make_odometry(5.1, 0.0, 0.0, (1.0, 2.01, north)), 5.1)
    controller.step(5.1)
    assert policy.told == (5.1, pytest.approx((0.2, 0.0)), (1.0, 2.01, north))
    # Odometry falls silent: for a second it stands, and nobody asks.
    for k in range(6, 11):
        assert Reason.STALE_ODOMETRY in controller.step(5.0 + 0.1 * k).verdict.reasons
    assert len(policy.asked) == 2
    controller.see_odometry(make_odometry(6.1, 0.0, 0.0, (1.0, 2.05, north)), 6.1)
    controller.see_scan(make_scan(6.1), 6.1)
    controller.step(6.1)
    assert policy.told == (6.1, (0.0, 0.0), (1.0, 2.05, north))
    # The loop hung for 0.25 s, so that a watchdog has stopped the robot.
    controller.see_odometry(make_odometry(6.35, 0.0, 0.0, (1.0, 2.06, north)), 6.35)
    controller.step(6.35)
    assert policy.told == (6.35, (0.0, 0.0), (1.0, 2.06, north))


@pytest.mark.parametrize(
    ("policy_dt", "step"), [(0.05, 0.05), (0.1, 0.1), (0.12, 0.06), (0.25, 1 / 12), (1.0, 0.1)]
)
def test_commands_come_often_enough_for_watchdogs_however_slow_the_policy(
    make_controller, policy, policy_dt, step
):
    controller = make_controller(policy, policy_dt)
    assert controller.control_dt == pytest.approx(step)
    assert controller.supervisor.control_dt == pytest.approx(step)


def test_a_slow_policy_is_supervised_between_its_steps(
    make_controller, policy, make_scan, make_odometry
):
    controller = make_controller(policy, 0.3)
    controller.set_goal(Goal(0.0, 9.0))
    asked, commands = [], []
    # From 5.5 s on there is a wall all around, 1 cm from the outline of 0.17 m; at 6.4 s no scan.
    for now in (5.0, 5.1, 5.2, 5.3, 5.4, 5.5, 5.6, 5.7, 6.4, 6.5):
        controller.see_odometry(make_odometry(now, pose=(1.0, 2.0, math.pi / 2)), now)
        if now != 6.4:
            controller.see_scan(make_scan(now, np.inf if now < 5.5 else 0.18), now)
        commands.append(controller.step(now).verdict.command[0])
        asked.append(len(policy.asked))
    # After a fault it is asked at once.
    assert asked == [1, 1, 1, 2, 2, 2, 3, 3, 3, 4]
    # 0.1 m/s is what it asks for; between its steps at 5.3 and 5.6 s it is stopped all the same.
    assert commands[:5] == pytest.approx([0.1] * 5)
    assert commands[5:] == [0.0] * 5


def test_the_scan_of_a_lidar_upside_down_is_mirrored(robot, policy, make_scan, make_odometry):
    hanging = robot.model_copy(
        update={"lidar": robot.lidar.model_copy(update={"upside_down": True})}
    )
    controller = Controller(
        policy,
        hanging,
        scan_geometry(hanging.lidar),
        control_dt=0.1,
        goal_radius=0.3,
        safety=SafetyConfig(),
    )
    controller.see_odometry(make_odometry(5.0), 5.0)
    # Its driver means -180 + 270 = 90 degrees, to the left of a lidar that stands.
    controller.see_scan(make_scan(5.0, 3.0, beam_270=1.5), 5.0)
    controller.set_goal(Goal(2.0, 0.0))
    controller.step(5.0)
    (seen, _, _) = policy.asked[-1]
    # The obstacle stands to the right, at -90 degrees.
    assert seen[90] == 1.5
    assert seen[270] == 3.0


def test_a_slow_policy_is_asked_at_once_about_the_next_goal(
    make_controller, policy, make_scan, make_odometry
):
    controller = make_controller(policy, 0.3)
    controller.set_goals([Goal(1.0, 2.35), Goal(1.0, 9.0)])
    controller.step(5.0)
    # 0.35 m, then 0.25 m to the first goal, whose radius is 0.3 m.
    controller.see_odometry(make_odometry(5.1, pose=(1.0, 2.1, math.pi / 2)), 5.1)
    controller.see_scan(make_scan(5.1), 5.1)
    assert controller.step(5.1).arrived
    assert [goal[0] for _, goal, _ in policy.asked] == pytest.approx([0.35, 6.9])


def test_what_a_policy_sees_can_be_drawn(robot, make_scan):
    geometry = scan_geometry(robot.lidar)
    policy = Recorder()
    controller = Controller(
        policy, robot, geometry, control_dt=0.1, goal_radius=0.3, safety=SafetyConfig()
    )
    assert controller.beams().shape == (0, 2, 2)
    parts = UsualParts(sectors=4).made(geometry, robot.base)
    policy.layout = ObservationLayout(geometry, robot.base, parts)
    controller.see_scan(make_scan(5.0, 2.0), 5.0)
    lines = controller.beams()
    # Four sectors of 90 beams, one a degree, from behind on: their middles look 44.5 deg further.
    angle = -math.pi + math.radians(44.5)
    assert lines[0, 0] == pytest.approx([0.0, 0.0])
    assert lines[0, 1] == pytest.approx([2.0 * math.cos(angle), 2.0 * math.sin(angle)], abs=1e-3)


def test_a_clock_that_jumps_drops_the_goal(controller, make_scan):
    controller.set_goal(Goal(0.0, 5.0))
    controller.see_scan(make_scan(2.0), 5.1)
    status = controller.step(5.1)
    assert status.dropped
    assert controller.goal is None


def test_a_robot_that_had_to_stand_for_long_does_not_start_by_itself(
    controller, make_scan, make_odometry
):
    controller.set_goal(Goal(0.0, 5.0))
    controller.step(5.0)
    # 9 s of silence are waited for; what comes then lets it go on. 10 s more are too long.
    assert not controller.step(14.0).dropped
    controller.see_odometry(make_odometry(14.1, pose=(1.0, 2.0, math.pi / 2)), 14.1)
    controller.see_scan(make_scan(14.1), 14.1)
    assert controller.step(14.1).verdict.command[0] > 0.0
    assert not controller.step(24.0).dropped
    assert controller.step(24.2).dropped
    assert controller.goal is None


def test_a_policy_that_raises_stops_the_robot_and_says_why(controller, policy):
    policy.answer = None
    controller.set_goal(Goal(0.0, 5.0))
    policy.act = lambda *_: 1 / 0
    status = controller.step(5.0)
    assert status.verdict.reasons == (Reason.POLICY_FAILED,)
    assert controller.failure == "division by zero"
    assert controller.goal is not None


def test_a_new_goal_lets_the_policy_forget_and_a_moved_one_does_not(controller, policy):
    controller.set_goal(Goal(0.0, 5.0))
    controller.move_goals([Goal(0.0, 5.1)])
    assert policy.resets == 1
    assert controller.goal == Goal(0.0, 5.1)


def test_goals_are_reached_in_order_without_a_stop_between(controller, make_odometry, make_scan):
    # The robot at (1, 2) is within 0.3 m of the first two goals, and of the last, but that is last.
    controller.set_goals([Goal(1.0, 2.1), Goal(1.2, 2.0), Goal(0.0, 5.0), Goal(1.0, 2.0)])
    status = controller.step(5.0)
    assert (status.arrived, status.remaining) == (True, 2)
    assert status.verdict.command == pytest.approx((0.1, 0.0))
    assert controller.goal == Goal(0.0, 5.0)
    # Nothing that was passed is headed for again; 1.0 s of 3 m/s would be a jump, so it takes 5 s.
    controller.see_odometry(make_odometry(10.0, pose=(0.1, 5.1, math.pi / 2)), 10.0)
    controller.see_scan(make_scan(10.0), 10.0)
    status = controller.step(10.0)
    assert (status.arrived, status.remaining) == (True, 1)
    assert controller.goal == Goal(1.0, 2.0)


def turn_to(controller, make_odometry, make_scan, yaw: float, *, stuck: bool = False):
    """Let a base that does as it is told turn at its goal; return the statuses."""
    now, heading, statuses = 5.0, math.pi / 2, []
    controller.set_goal(Goal(1.0, 2.1, yaw))
    while not statuses or not (statuses[-1].arrived or statuses[-1].dropped):
        rate = 0.0 if stuck or not statuses else statuses[-1].verdict.command[1]
        heading += 0.1 * rate
        now += 0.1
        controller.see_odometry(make_odometry(now, 0.0, rate, (1.0, 2.0, heading)), now)
        controller.see_scan(make_scan(now), now)
        statuses.append(controller.step(now))
        assert len(statuses) < 400
    return statuses, heading


@pytest.mark.parametrize("yaw", [-math.pi / 2, math.pi, 0.0, 1.4])
def test_the_heading_at_a_goal_is_turned_to_on_the_spot(
    controller, policy, make_odometry, make_scan, yaw
):
    statuses, heading = turn_to(controller, make_odometry, make_scan, yaw)
    assert statuses[-1].arrived
    # Within 0.25 rad of the heading asked for, the short way round, and never past it.
    assert abs(math.remainder(heading - yaw, 2.0 * math.pi)) <= 0.25
    assert abs(heading - math.pi / 2) <= math.pi + 0.01
    assert all(status.verdict.command[0] == 0.0 for status in statuses)
    assert policy.asked == []
    rates = [status.verdict.command[1] for status in statuses]
    assert all(rate * rates[0] >= 0.0 for rate in rates)


def test_a_heading_that_cannot_be_reached_ends_the_goal_and_says_so(
    controller, make_odometry, make_scan
):
    statuses, _ = turn_to(controller, make_odometry, make_scan, 0.0, stuck=True)
    assert statuses[-1].dropped
    # PM01 turns round in 2 pi / 1.5 rad/s = 4.2 s; with ten seconds of patience that is 14.2 s.
    assert 140 <= len(statuses) <= 145
    assert "heading" in controller.failure


def test_how_long_is_waited_can_be_set(controller):
    controller.patience_s = 2.0
    controller.set_goal(Goal(0.0, 5.0))
    controller.step(5.0)
    # Scan and odometry are of 5.0 s: older than 0.5 s from 5.5 s on.
    assert not controller.step(6.9).dropped
    assert controller.step(7.1).dropped


def test_a_goal_must_be_a_place():
    with pytest.raises(InputError, match="goal"):
        Goal(math.nan, 0.0)


def test_the_controller_needs_neither_simulator_nor_torch():
    code = (
        "import sys; import pm01_nav.deploy.controller, pm01_nav.policy;"
        "heavy = {'numba', 'torch', 'gymnasium', 'scipy', 'pydantic', 'yaml', 'click', 'rclpy'};"
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_planner_drives_the_simulated_robot_to_its_goal():
    task = task_config("static")
    robot = task.robot_spec()
    planner = make_planner("dwa", robot, 0.1)
    sim = SimulatedRobot(robot, world_pool(task, "held_out", 4, 1), seed=1)
    controller = Controller(
        planner,
        robot,
        scan_geometry(robot.lidar),
        control_dt=0.1,
        goal_radius=0.3,
        safety=SafetyConfig(),
    )
    controller.set_goal(Goal(*sim.goal))
    for _ in range(3000):
        new_scan = sim.step()
        controller.see_odometry(sim.odometry(), sim.time)
        if new_scan:
            controller.see_scan(sim.scan(), sim.time)
            status = controller.step(sim.time)
            sim.command(*status.verdict.command)
            if status.arrived:
                break
    assert status.arrived
    assert sim.collisions == 0
    # By the true pose, which odometry is without errors.
    assert np.hypot(*(sim.pose[:2] - sim.goal)) <= 0.3 + 0.05


def test_the_simulated_robot_is_late_by_seconds_whatever_its_step():
    task = task_config("empty")
    late = RandomizationConfig(command_delay_s=(0.2, 0.2))
    pool = world_pool(task, "held_out", 1, 1)
    sim = SimulatedRobot(task.robot_spec(), pool, seed=1, dt=0.02, randomization=late)
    moving = []
    for _ in range(15):
        sim.command(0.3, 0.0)
        sim.step()
        moving.append(sim.odometry().twist[0] > 0.0)
    # 0.2 s are ten steps of 0.02 s.
    assert moving == [False] * 10 + [True] * 5


def test_the_simulated_robot_stops_without_commands():
    task = task_config("empty")
    sim = SimulatedRobot(task.robot_spec(), world_pool(task, "held_out", 1, 1), seed=1)
    sim.command(0.3, 0.0)
    for _ in range(10):
        sim.step()
    assert sim.odometry().twist[0] == pytest.approx(0.3, abs=0.02)
    # The motors stop after 0.2 s without a command; the base then needs 0.15 s and its lag.
    for _ in range(25):
        sim.step()
    assert sim.odometry().twist[0] == pytest.approx(0.0, abs=0.01)
