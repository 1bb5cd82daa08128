# SPDX-License-Identifier: Apache-2.0
"""Driving over DDS against a real peer: a simulated robot in another process, on loopback."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.driver import Driver
from pm01_nav.deploy.link import Inbox, Topics
from pm01_nav.deploy.safety import Reason, SafetyConfig
from pm01_nav.errors import InputError
from pm01_nav.planners import make_planner
from pm01_nav.robot import load_robot
from pm01_nav.task.scans import scan_geometry

pytest.importorskip("cyclonedds")


from pm01_nav.deploy.dds import DdsLink, dds_config

PEER = Path(__file__).parent / "dds_robot.py"


@pytest.fixture
def domain() -> int:
    # One of its own, so that neither other tests nor robots on this machine are heard.
    return random.SystemRandom().randint(100, 200)


@pytest.fixture
def robot_process(domain):
    process = subprocess.Popen([sys.executable, str(PEER), str(domain)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    yield process
    process.kill()
    process.wait()


class Sideways:
    """A policy that goes straight to the goal without a turn."""

    def reset(self):
        """Forget nothing."""

    def keep(self, robots):
        """Drive one robot only."""

    def act(self, scan, goal, velocity):
        return np.array([*(0.4 * goal / np.hypot(*goal)), 0.0])


@pytest.fixture
def driver(robot, domain):
    controller = Controller(
        make_planner("goal_seeking", robot, 0.1),
        robot,
        scan_geometry(robot.lidar),
        control_dt=0.1,
        goal_radius=0.3,
        safety=SafetyConfig(),
    )
    return Driver(controller, DdsLink(Topics(), domain=domain))


def test_drives_a_robot_in_another_process_to_a_goal(robot_process, driver):
    arrived = []
    threading.Timer(60.0, driver.end).start()
    driver.run(iter([Goal(1.0, 0.3)]), lambda status: arrived.append(status.arrived))
    assert arrived[-1]


def test_a_robot_that_goes_sideways_is_told_so_and_tells_it(robot_process, domain):
    omni = load_robot("omni_disc")
    twists, arrived = [], []

    def listen(status):
        arrived.append(status.arrived)
        if controller.supervisor.odometry is not None:
            twists.append(controller.supervisor.odometry.twist)

    # On a busy machine messages may come so late that the goal is given up.
    for _ in range(5):
        controller = Controller(
            Sideways(),
            omni,
            scan_geometry(omni.lidar),
            control_dt=0.1,
            goal_radius=0.1,
            safety=SafetyConfig(),
        )
        driver = Driver(controller, DdsLink(Topics(), domain=domain))
        threading.Timer(60.0, driver.end).start()
        driver.run(iter([Goal(0.0, -0.8)]), listen)
        if arrived[-1]:
            break
    assert arrived[-1]
    fastest = np.abs(twists).max(axis=0)
    # It went at 0.4 m/s to the right, and did not turn.
    assert min(twist[1] for twist in twists) == pytest.approx(-0.4, abs=0.01)
    assert fastest[0] < 0.05
    assert fastest[2] == 0.0


def test_a_robot_that_is_killed_is_told_to_stop_and_found_again(robot_process, driver, domain):
    statuses = []
    killed, back = [], []

    def listen(status):
        statuses.append(status)
        driving = status.verdict.command[0] > 0.2
        if driving and not killed:
            os.kill(robot_process.pid, signal.SIGKILL)
            killed.append(time.monotonic())
        if killed and not back and Reason.STALE_ODOMETRY in status.verdict.reasons:
            # The last odometry came when it was killed; it may be 0.3 s old, and a step is 0.1 s.
            back.append(time.monotonic() - killed[0])
            driver.end()

    threading.Timer(60.0, driver.end).start()
    driver.run(iter([Goal(20.0, 0.0)]), listen)
    assert back
    assert back[0] < 0.3 + 0.1 + 0.3
    assert statuses[-1].verdict.command == (0.0, 0.0)


def test_loopback_is_the_default_and_peers_beyond_it_need_an_address():
    config = dds_config("127.0.0.1", ())
    assert '<NetworkInterface address="127.0.0.1"/>' in config
    assert "<AllowMulticast>false</AllowMulticast>" in config
    with pytest.raises(InputError, match="cannot be reached from 127"):
        dds_config("127.0.0.1", ("192.0.2.7",))
    with pytest.raises(InputError, match="must be an IP address"):
        dds_config("robot.local", ())
    assert '<Peer address="192.0.2.7"/>' in dds_config("192.0.2.1", ("192.0.2.7",))


@pytest.mark.parametrize("latched", [True, False])
def test_an_emergency_stop_is_heard_whether_it_was_latched_before_or_said_now(domain, latched):
    command = [sys.executable, str(PEER.with_name("dds_button.py")), str(domain), str(latched)]
    button = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert button.stdout is not None
    assert button.stdout.readline() == b"pressed\n"
    link, inbox = DdsLink(Topics(), domain=domain), Inbox()
    link.open(inbox)
    events = inbox.take(20.0)
    link.close()
    button.kill()
    button.wait()
    assert events[0].kind == "emergency_stop"
    assert events[0].message.data
