# SPDX-License-Identifier: Apache-2.0
"""navigate.launch.py, launched for real."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest


def test_navigation_as_launched(rclpy, policy_file):
    pytest.importorskip("launch_testing", reason="needs launch_testing")
    launch_test = Path(__file__).parent / "navigate_launch.py"
    done = subprocess.run(
        ["launch_test", str(launch_test)],
        env=os.environ | {"PM01_TEST_POLICY": str(policy_file)},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


@pytest.fixture
def launched(launch, policy_file):
    """navigate.launch.py with a simulated robot at four times real time."""
    given = ("simulate:=true", "use_sim_time:=true", "world:=empty", "real_time_factor:=4.0")
    return launch(f"policy:={policy_file}", *given)


def process_of(launch: subprocess.Popen, executable: str) -> int:
    """Return the id of the process in which a launch runs one of pm01_rl's executables."""
    children = Path(f"/proc/{launch.pid}/task/{launch.pid}/children").read_text().split()
    for process in children:
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
        if any(word.endswith(f"/pm01_rl/{executable}".encode()) for word in words):
            return int(process)
    raise AssertionError(f"{executable} does not run")


def test_a_killed_policy_stops_the_robot(launched, watcher):
    from nav_msgs.msg import Odometry

    speed = []
    watcher.create_subscription(Odometry, "/odom", lambda m: speed.append(m.twist.twist), 10)
    watcher.set_off()
    assert watcher.wait_for(lambda: bool(speed) and speed[-1].linear.x > 0.1)
    os.kill(process_of(launched, "policy_node"), signal.SIGKILL)
    killed = time.monotonic()
    assert watcher.wait_for(lambda: watcher.commands[-1][1].linear.x == 0.0, 5.0)
    # The watchdog's 0.15 s of simulated time, at 4 times real time; the rest is a busy machine's.
    assert watcher.commands[-1][0] - killed < 0.6
    assert watcher.wait_for(lambda: abs(speed[-1].linear.x) < 0.01, 5.0)
