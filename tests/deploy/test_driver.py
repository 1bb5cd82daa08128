# SPDX-License-Identifier: Apache-2.0
"""The loop between a controller and a link, by a link that is no connection."""

from __future__ import annotations

import math
import threading
import time
from types import SimpleNamespace

import pytest

from pm01_nav.cli.drive import _Printer
from pm01_nav.deploy.controller import Controller
from pm01_nav.deploy.driver import Driver
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.safety import Reason, SafetyConfig
from pm01_nav.planners import make_planner
from pm01_nav.task.scans import scan_geometry

NS = SimpleNamespace


def header(seconds: float, frame: str = "odom") -> NS:
    whole = int(seconds)
    return NS(stamp=NS(sec=whole, nanosec=round(1e9 * (seconds - whole))), frame_id=frame)


class Robot:
    """A link to a robot that moves as it is told and sees nothing but free space."""

    def __init__(self) -> None:
        self.commands: list[tuple[float, float]] = []
        self.inbox = None
        self.x = 0.0
        self.range = float("inf")
        self.link_age = 0.0
        self.ended = threading.Event()

    def open(self, inbox) -> None:
        self.inbox = inbox
        threading.Thread(target=self._live, daemon=True).start()

    def _live(self) -> None:
        while not self.ended.wait(0.02):
            self.speak(time.time())

    def speak(self, now: float) -> None:
        v = self.commands[-1][0] if self.commands else 0.0
        self.x += 0.02 * v
        place = NS(position=NS(x=self.x, y=0.0), orientation=NS(x=0.0, y=0.0, z=0.0, w=1.0))
        twist = NS(linear=NS(x=v), angular=NS(z=0.0))
        odometry = NS(header=header(now), pose=NS(pose=place), twist=NS(twist=twist))
        self.inbox.put("odometry", odometry)
        scan = NS(
            header=header(now),
            angle_min=-3.14159265,
            angle_increment=0.01745329,
            range_min=0.12,
            range_max=3.5,
            ranges=[self.range] * 360,
        )
        self.inbox.put("scan", scan)

    def tell(self, command) -> None:
        self.commands.append(command)

    def age(self) -> float:
        return self.link_age

    def close(self) -> None:
        self.ended.set()


@pytest.fixture
def link():
    return Robot()


@pytest.fixture
def drive(robot, link):
    """Return a function that drives, and ends if nothing else does."""

    def run(goals=None, listener=None, *, sim_time=False) -> Driver:
        controller = Controller(
            make_planner("goal_seeking", robot, 0.1),
            robot,
            scan_geometry(robot.lidar),
            control_dt=0.1,
            goal_radius=0.3,
            safety=SafetyConfig(),
            same_clock=sim_time,
        )
        driver = Driver(controller, link, sim_time=sim_time)
        timer = threading.Timer(20.0, driver.end)
        timer.start()
        driver.run(goals, listener and (lambda status: listener(driver, status)))
        timer.cancel()
        return driver

    return run


def test_one_goal_after_the_other(drive, link):
    arrived = []
    drive(iter([Goal(0.5, 0.0), Goal(0.9, 0.0)]), lambda _, s: arrived.append(s.arrived))
    assert sum(arrived) == 2
    # It arrives where the second goal is 0.3 m away, at up to 0.5 m/s: 0.1 m are 0.2 s of a busy
    # machine, in which odometry's last word is carried on, or the stop comes late.
    assert 0.5 <= link.x <= 0.7
    assert link.commands[-1] == (0.0, 0.0)


def test_a_goal_that_is_given_up_ends_the_drive(drive, link):
    def listen(driver, status):
        if status.verdict.command[0] > 0.1:
            link.inbox.put("emergency_stop", NS(data=True))

    # A second goal would be driven to in a frame that may have moved, or beside whoever pressed.
    driver = drive(iter([Goal(5.0, 0.0), Goal(-5.0, 0.0)]), listen)
    assert driver.steps < 50
    assert link.commands[-1] == (0.0, 0.0)


@pytest.mark.parametrize(("frame", "goes"), [("odom", True), ("", True), ("map", False)])
def test_a_goal_in_another_frame_is_another_place(drive, link, frame, goes):
    pose = NS(position=NS(x=5.0, y=0.0))

    def listen(driver, status):
        if driver.steps == 5:
            link.inbox.put("goal", NS(header=header(0.0, frame), pose=pose))
        if driver.steps >= 15 and (link.x > 0.05 or not goes):
            driver.end()

    driver = drive(None, listen)
    assert (link.x > 0.05) == goes
    assert (driver.refused is None) == goes


def test_a_simulated_clock_that_goes_back_stops_the_robot(drive, link):
    link._live = lambda: None
    statuses = []

    def tick(now: float) -> None:
        whole = int(now)
        link.inbox.put("clock", NS(clock=NS(sec=whole, nanosec=round(1e9 * (now - whole)))))
        link.speak(now)

    def live() -> None:
        for step in range(40):
            tick(100.0 + 0.05 * step)
            time.sleep(0.01)
        tick(3.0)

    def listen(driver, status):
        statuses.append(status)
        if status.dropped:
            driver.end()

    threading.Thread(target=lambda: (time.sleep(0.2), live()), daemon=True).start()
    drive(iter([Goal(50.0, 0.0)]), listen, sim_time=True)
    # Without a step at 3 s the next would come at 102 s, and the base would go on until then.
    assert statuses[-1].dropped
    assert link.commands[-1] == (0.0, 0.0)


def test_a_backlog_is_not_driven_through(drive, link):
    """A driver that woke up late must not repeat the past while the robot goes on."""
    link._live = lambda: None
    distances = []

    def open_(inbox) -> None:
        link.inbox = inbox
        # One second of the robot's time, all there at once: clock, odometry and scan.
        for step in range(21):
            now = 100.0 + 0.05 * step
            whole = int(now)
            stamp = NS(sec=whole, nanosec=round(1e9 * (now - whole)))
            inbox.put("clock", NS(clock=stamp))
            link.x = 0.02 * step
            link.speak(now)

    def listen(driver, status):
        distances.append(status.goal_distance)
        driver.end()

    link.open = open_
    drive(iter([Goal(2.0, 0.0)]), listen, sim_time=True)
    # The first step sees where the robot is by the end of it: 0.4 m on.
    assert distances[0] == pytest.approx(1.6, abs=0.02)


def test_a_policy_is_timed_by_the_simulated_clock(robot, link):
    """In a simulation that races a policy may answer at once and be late all the same."""
    link._live = lambda: None
    controller = Controller(
        make_planner("goal_seeking", robot, 0.1),
        robot,
        scan_geometry(robot.lidar),
        control_dt=0.1,
        goal_radius=0.3,
        safety=SafetyConfig(),
        same_clock=True,
    )
    failures = []

    def open_(inbox) -> None:
        link.inbox = inbox
        inbox.put("clock", NS(clock=header(100.0).stamp))
        link.speak(100.0)

    def act(scan, goal, velocity):
        # 0.2 s of the robot's time, two control steps, while it thinks.
        link.inbox.put("clock", NS(clock=header(100.2).stamp))
        return (0.1, 0.0)

    def listen(status):
        failures.append(controller.failure)
        driver.end()

    link.open, controller.policy.act = open_, act
    driver = Driver(controller, link, sim_time=True)
    driver.run(iter([Goal(2.0, 0.0)]), listen)
    assert failures == ["took 0.20 s, longer than a control step"]


def test_a_silence_stops_the_robot_and_after_it_the_robot_goes_on(drive, link):
    silent, commands = [], []

    def listen(driver, status):
        if status.verdict.command[0] > 0.1 and not silent:
            silent.append(time.monotonic())
            link.speak, link.spoken = (lambda now: None), link.speak
        elif silent and time.monotonic() - silent[0] < 1.5:
            commands.append(status.verdict.command)
        elif silent:
            link.speak = link.spoken

    drive(iter([Goal(0.8, 0.0)]), listen)
    # Within 0.5 s and a step of the last scan it stands, and it arrives afterwards.
    assert commands[-1] == (0.0, 0.0)
    assert link.x > 0.45


def test_behind_a_link_that_falls_behind_the_robot_stands(drive, link):
    statuses = []

    def listen(driver, status):
        statuses.append(status)
        if status.verdict.command[0] > 0.1:
            link.link_age = 0.5
        if Reason.SLOW_LINK in status.verdict.reasons:
            driver.end()

    drive(iter([Goal(5.0, 0.0)]), listen)
    assert statuses[-1].verdict.command == (0.0, 0.0)
    # It goes on when the link does: the goal is kept.
    assert not statuses[-1].dropped


def test_without_a_goal_others_may_drive(drive, link):
    """After a goal it says stop for a second and then nothing, until there is another."""
    told = []
    tell = link.tell
    link.tell = lambda command: (told.append(time.monotonic()), tell(command))
    arrived = []

    def listen(driver, status):
        if driver.steps == 5:
            pose = NS(position=NS(x=0.5, y=0.0), orientation=NS(x=0.0, y=0.0, z=0.0, w=0.0))
            link.inbox.put("goal", NS(header=header(0.0), pose=pose))
        if status.arrived:
            arrived.append(time.monotonic())
        if arrived and time.monotonic() - arrived[0] > 2.5:
            driver.end()

    drive(None, listen)
    after = [moment - arrived[0] for moment in told if moment > arrived[0]]
    # Ten a second for one second, and the last word when the drive ends.
    assert after[-1] > 2.4
    assert after[-2] < 1.2
    assert 8 <= len(after) <= 13
    assert link.commands[-1] == (0.0, 0.0)


def test_a_goal_from_the_topic_has_a_heading(drive, link):
    turned = []

    def listen(driver, status):
        if driver.steps == 5:
            half = 0.5 * 2.0
            turn = NS(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
            pose = NS(position=NS(x=0.1, y=0.0), orientation=turn)
            link.inbox.put("goal", NS(header=header(0.0), pose=pose))
        if status.verdict.command[1] > 0.1:
            turned.append(status.verdict.command)
            driver.end()

    drive(None, listen)
    assert turned[0][0] == 0.0


def test_a_lidar_that_sends_zeros_keeps_the_robot_where_it_is_and_is_named(drive, link, capsys):
    link.range = 0.0
    printers = []

    def listen(driver, status):
        printers.append(_Printer(driver)) if not printers else None
        printers[0](status)
        if driver.steps == 20:
            driver.end()

    drive(iter([Goal(5.0, 0.0)]), listen)
    assert link.x == 0.0
    assert "unusable; the scan is mostly zeros: set lidar.zero_means" in capsys.readouterr().out
