# SPDX-License-Identifier: Apache-2.0
"""Robots whose servers are other processes, which may die; no Gazebo is needed for that."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.backends.gazebo.config import GazeboConfig
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

OTHER = World("other", (-10.0, -10.0, 10.0, 10.0), discs=np.array([[-8.0, 8.0, 0.3]]))
WALKER = Mover("bounce", 0.3, np.array([[2.0, 0.0]]), speed=0.5)
WALK = World("walk", (-9.0, -9.0, 9.0, 9.0), movers=(WALKER,))


def worker_of(simulator, i=0):
    return simulator._engine._robots[i]._worker


def test_the_robot_believes_its_wheels(played) -> None:
    simulator = played("steady")
    simulator.place(np.array([0]), [[1.0, 2.0, np.pi / 2.0]], [[1.0, 5.0]])
    for _ in range(10):
        simulator.step([[0.5, 0.0]])
    # A second at 0.5 m/s to the left: half a metre by the wheels, a tenth less in truth.
    assert simulator.state.pose[0] == pytest.approx([1.0, 2.45, np.pi / 2.0])
    assert simulator.measured_pose[0] == pytest.approx([1.0, 2.5, np.pi / 2.0])
    assert simulator.measured_twist[0] == pytest.approx([0.5, 0.0])
    assert simulator.measured_goal[0] == pytest.approx([2.5, 0.0], abs=1e-12)
    assert simulator.state.goal_polar[0, 0] == pytest.approx(2.55)
    # At the next reset it knows where it is.
    simulator.reset()
    assert simulator.measured_pose[0] == pytest.approx(simulator.state.pose[0])


def test_a_robot_may_know_its_true_place_but_its_speed_by_its_wheels(played) -> None:
    simulator = played("steady", localized=True)
    simulator.place(np.array([0]), [[1.0, 2.0, np.pi / 2.0]], [[1.0, 5.0]])
    for _ in range(10):
        simulator.step([[0.5, 0.0]])
    assert simulator.measured_pose[0] == pytest.approx([1.0, 2.45, np.pi / 2.0])
    assert simulator.measured_goal[0] == pytest.approx([2.55, 0.0], abs=1e-12)
    assert simulator.measured_twist[0] == pytest.approx([0.5, 0.0])


def test_obstacles_are_replaced_only_where_the_world_changes(played, hall) -> None:
    simulator = played("steady", worlds=(hall, OTHER))
    changes = []
    for world in (0, 0, 1, 1, 0):
        simulator.reset(np.array([0]), np.array([world]))
        changes.append(float(simulator.state.ranges[0, 0]))
    first = changes[0]
    assert np.diff([first, *changes]) == pytest.approx([0.0, 0.0, 1.0, 0.0, 1.0])


def test_a_server_that_dies_costs_its_episode_and_is_started_again(played) -> None:
    simulator = played("dying", num_envs=2)
    for _ in range(2):
        simulator.step([[0.1, 0.0]] * 2)
    os.kill(worker_of(simulator, 0).process_id, signal.SIGKILL)
    before = simulator.state.pose.copy()
    simulator.step([[0.1, 0.0]] * 2)
    # One was killed, the other died of itself in its third step; both say so.
    assert set(simulator.faults) == {0, 1}
    assert "died in the middle of the episode (exit code -9)" in simulator.faults[0]
    assert "(exit code 7); Gazebo says: [Err] ogre: out of memory" in simulator.faults[1]
    assert simulator.state.pose == pytest.approx(before)
    simulator.reset(np.array([0, 1]))
    assert not simulator.faults
    simulator.step([[0.1, 0.0]] * 2)
    assert not simulator.faults


def test_a_server_that_dies_again_ends_the_run(played) -> None:
    simulator = played("dying")
    for _ in range(3):
        simulator.step([[0.1, 0.0]])
    simulator.reset()
    for _ in range(3):
        simulator.step([[0.1, 0.0]])
    with pytest.raises(InputError, match=r"died again.*out of memory.*Next: .*pm01 doctor"):
        simulator.reset()


def test_a_silent_sensor_is_named(played) -> None:
    simulator = played("silent")
    with pytest.raises(InputError, match=r"/scan: no message of 0\.200 s"):
        simulator.step([[0.1, 0.0]])


def test_a_robot_that_is_not_there_is_named(played) -> None:
    with pytest.raises(InputError, match="without the robot"):
        played("without_robot")


def test_servers_are_kept_for_the_next_robots(played) -> None:
    simulator = played("steady")
    process = worker_of(simulator).process_id
    del simulator
    assert worker_of(played("steady")).process_id == process


def test_a_server_that_grew_is_not_kept(played, monkeypatch: pytest.MonkeyPatch) -> None:
    simulator = played("steady")
    process = worker_of(simulator).process_id
    # Python and numpy alone take more than a megabyte.
    assert worker_of(simulator).memory_mb > 1.0
    monkeypatch.setattr("pm01_nav.backends.gazebo.engine.MOST_MEMORY_MB", 1.0)
    del simulator
    assert worker_of(played("steady")).process_id != process


def test_robots_that_go_give_their_servers_back(played) -> None:
    simulator = played("steady", num_envs=2)
    first, second = (worker_of(simulator, i).process_id for i in (0, 1))
    simulator.keep(np.array([1]))
    assert worker_of(simulator).process_id == second
    simulator.step([[0.2, 0.0]])
    assert worker_of(played("steady")).process_id == first


@pytest.mark.parametrize(
    ("localization", "worlds", "num_envs", "complaint"),
    [
        ("ground_truth", [OTHER], 1, "knows its place by odometry only"),
        ("odometry", [OTHER, OTHER], 1, "drives one robot in the one world that runs"),
        ("odometry", [OTHER], 2, "drives one robot in the one world that runs"),
        ("odometry", [WALK], 1, "cannot know where movers are"),
    ],
)
def test_a_gazebo_that_runs_already_has_one_robot_without_eyes(
    monkeypatch: pytest.MonkeyPatch, localization, worlds, num_envs, complaint
) -> None:
    monkeypatch.setattr("pm01_nav.backends.require_gazebo", lambda backend: None)
    pool, config = build_pool(worlds, radius=0.3), GazeboConfig(localization=localization)
    with pytest.raises(InputError, match=complaint):
        make_simulator("gazebo_transport", NUMPY, load_robot("pm01"), pool, num_envs, config)
