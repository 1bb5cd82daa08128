# SPDX-License-Identifier: Apache-2.0
"""A Gazebo that others started, with the robot of ``pm01_description`` in the article's world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import GazeboConfig, make_simulator
from pm01_nav.backends.gazebo.config import what_is_missing
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.sdf import read_sdf

pytestmark = [
    pytest.mark.gazebo,
    pytest.mark.skipif(what_is_missing() is not None, reason=f"Gazebo: {what_is_missing()}"),
]


def robot_in(path: Path, **address: str):
    pool = build_pool([read_sdf(path).world], radius=0.3)
    simulator = make_simulator(
        "gazebo_transport", NUMPY, load_robot("pm01"), pool, 1, GazeboConfig(**address)
    )
    simulator.seed([0])
    simulator.reset()
    return simulator, pool


def test_stops_where_it_is_put_and_sees_what_the_plane_sees(running_world: Path) -> None:
    simulator, pool = robot_in(running_world)
    simulator.place(np.array([0]), [[0.5, -1.5, 0.3]], [[5.0, 0.0]])
    plane = make_simulator("planar", NUMPY, load_robot("pm01"), pool, 1)
    plane.seed([0])
    plane.reset()
    plane.place(np.array([0]), [[0.5, -1.5, 0.3]], [[5.0, 0.0]])
    both = np.isfinite(simulator.scan) & np.isfinite(plane.scan)
    assert both.mean() > 0.3
    assert np.median(np.abs(simulator.scan[both] - plane.scan[both])) < 0.01
    for _ in range(10):
        simulator.step([[0.4, 0.2]])
        plane.step([[0.4, 0.2]])
    # Odometry is an iteration of 20 ms old at most, and wheels slip.
    assert simulator.state.pose[0] == pytest.approx(plane.state.pose[0], abs=0.03)
    assert simulator.state.twist[0] == pytest.approx([0.4, 0.2], abs=0.01)


def test_a_collision_is_what_the_map_says(running_world: Path) -> None:
    simulator, _ = robot_in(running_world)
    # The first disc of the article's world is at (1.6, 0.9), 0.25 m around.
    simulator.place(np.array([0]), [[0.9, 0.9, 0.0]], [[5.0, 0.0]])
    touched = []
    for _ in range(12):
        simulator.step([[0.5, 0.0]])
        touched.append(bool(simulator.state.contact[0]))
    assert not touched[0]
    assert touched[-1]


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ({"world": "moon"}, r"gazebo\.world = 'moon': does not run; running: article"),
        ({"namespace": "robot7"}, r"/robot7/scan: nobody publishes.*there is /scan"),
        ({"model": "pm99"}, r"gazebo\.model = 'pm99': not in world article; its models: .*pm01"),
    ],
)
def test_other_names_are_explained(
    running_world: Path, address: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        robot_in(running_world, **address)


def test_nothing_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # No robot answers in a partition of nobody; transport reads it when its first node is made.
    import subprocess
    import sys

    code = (
        "from pm01_nav.backends.gazebo.config import GazeboConfig\n"
        "from pm01_nav.backends.gazebo.running import RunningEngine\n"
        "from pm01_nav.robot import load_robot\n"
        "RunningEngine(GazeboConfig(), load_robot('pm01'), [], 1, 0.1)"
    )
    monkeypatch.setenv("GZ_PARTITION", "pm01_nobody")
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "no Gazebo answers; start one with: ros2 launch pm01_gazebo" in answer.stderr
