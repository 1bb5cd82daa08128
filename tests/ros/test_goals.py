# SPDX-License-Identifier: Apache-2.0
"""Goals as people give them: in any frame, with a heading, several in a row."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest


@pytest.fixture
def action(watcher):
    """Return a function that sends a goal of an action and returns its handle and feedback."""
    from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
    from rclpy.action import ActionClient

    kinds = {"navigate_to_pose": NavigateToPose, "navigate_through_poses": NavigateThroughPoses}

    def send(*poses, name="navigate_to_pose"):
        kind, feedback = kinds[name], []
        client = ActionClient(watcher, kind, f"/{name}")
        assert watcher.wait_for(client.server_is_ready)
        goal = kind.Goal()
        if name == "navigate_to_pose":
            (goal.pose,) = poses
        else:
            goal.poses = list(poses)
        # The server is seen before it is ready to be told.
        accepted = False
        end = time.monotonic() + 30.0
        while not accepted and time.monotonic() < end:
            future = client.send_goal_async(goal, feedback_callback=lambda f: feedback.append(f))
            assert watcher.wait_for(future.done)
            accepted = future.result().accepted
        assert accepted
        return future.result(), feedback

    return send


@pytest.fixture
def odometry(watcher):
    """Return the places at which the robot was by its odometry, (x, y, yaw) in order."""
    from nav_msgs.msg import Odometry

    from pm01_nav.deploy.messages import odometry_from_ros

    places = []
    watcher.create_subscription(
        Odometry, "/odom", lambda m: places.append(odometry_from_ros(m).pose), 50
    )
    return places


def pose(frame: str, x: float, y: float, yaw: float | None = None):
    from geometry_msgs.msg import PoseStamped

    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.w = 0.0 if yaw is None else math.cos(0.5 * yaw)
    message.pose.orientation.z = 0.0 if yaw is None else math.sin(0.5 * yaw)
    return message


def ahead(place, distance: float) -> tuple[float, float]:
    return place[0] + distance * math.cos(place[2]), place[1] + distance * math.sin(place[2])


def status_of(node, handle, seconds: float = 60.0) -> int:
    future = handle.get_result_async()
    assert node.wait_for(future.done, seconds)
    return future.result().status


ABORTED, SUCCEEDED = 6, 4


def test_a_goal_in_a_frame_that_nobody_knows_ends(start, watcher, policy_file, action):
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", goal_patience_s="2.0")
    handle, _ = action(pose("nowhere", 5.0, 0.0))
    sent = time.monotonic()
    assert status_of(watcher, handle, 10.0) == ABORTED
    # Two seconds, and a control step.
    assert 1.5 < time.monotonic() - sent < 4.0
    # Nobody waits for the frame any more when it appears.
    publisher = watcher.create_publisher(TFMessage, "/tf", 10)
    transform = TransformStamped(child_frame_id="nowhere")
    transform.header.frame_id = "odom"

    def publish() -> None:
        transform.header.stamp = watcher.get_clock().now().to_msg()
        publisher.publish(TFMessage(transforms=[transform]))

    watcher.create_timer(0.05, publish)
    assert not watcher.wait_for(lambda: watcher.moves(), 1.5)


def test_a_goal_ahead_of_the_robot_stays_where_it_was(
    start, watcher, policy_file, action, odometry
):
    start("sim_node", world="empty")
    start(
        "policy_node",
        policy=policy_file,
        autostart="true",
        goal_radius="0.1",
        use_sim_time="true",
    )
    assert watcher.wait_for(lambda: bool(odometry))
    began = odometry[-1]
    handle, _ = action(pose("base_link", 1.0, 0.0))
    assert status_of(watcher, handle) == SUCCEEDED
    # 1 m ahead of where it was; carried along it would never have been reached.
    assert np.hypot(*(odometry[-1][:2] - ahead(began, 1.0))) < 0.15


def test_a_heading_is_turned_to(start, watcher, policy_file, action, odometry):
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", yaw_goal_tolerance="0.1")
    assert watcher.wait_for(lambda: bool(odometry))
    began = odometry[-1]
    x, y = ahead(began, 0.2)
    # Within the goal's radius of 0.3 m: it only has to turn, by 2 rad.
    handle, _ = action(pose("odom", x, y, began[2] + 2.0))
    assert status_of(watcher, handle) == SUCCEEDED
    watcher.wait_for(lambda: False, 1.0)
    assert abs(math.remainder(odometry[-1][2] - began[2] - 2.0, 2.0 * math.pi)) < 0.15
    assert np.hypot(*(odometry[-1][:2] - began[:2])) < 0.1


def test_poses_are_passed_in_order(start, watcher, policy_file, action, odometry):
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    assert watcher.wait_for(lambda: bool(odometry))
    began = odometry[-1]
    # Straight ahead; at the second of them no heading is turned to, since it is not the last.
    places = [ahead(began, distance) for distance in (0.8, 1.6, 2.4)]
    poses = [pose("odom", *place, began[2] + 2.0 * (k == 1)) for k, place in enumerate(places)]
    handle, feedback = action(*poses, name="navigate_through_poses")
    assert status_of(watcher, handle) == SUCCEEDED
    told = [f.feedback.number_of_poses_remaining for f in feedback]
    assert told == sorted(told, reverse=True)
    assert set(told) == {3, 2, 1}
    # The straight way past all three: 2.4 m at first, the robot's radius of 0.3 m at the end.
    left = [f.feedback.distance_remaining for f in feedback if f.feedback.distance_remaining > 0]
    assert left[0] == pytest.approx(2.4, abs=0.15)
    assert left[-1] < 0.5
    headings = [abs(math.remainder(place[2] - began[2], 2.0 * math.pi)) for place in odometry]
    assert max(headings) < 0.5


def test_an_empty_list_of_poses_is_refused(start, watcher, policy_file):
    from nav2_msgs.action import NavigateThroughPoses
    from rclpy.action import ActionClient

    start("policy_node", policy=policy_file, autostart="true")
    client = ActionClient(watcher, NavigateThroughPoses, "/navigate_through_poses")
    assert watcher.wait_for(client.server_is_ready)
    assert watcher.wait_for(lambda: bool(watcher.commands))
    future = client.send_goal_async(NavigateThroughPoses.Goal())
    assert watcher.wait_for(future.done)
    assert not future.result().accepted


def test_what_tf_knew_before_the_clock_went_back_is_forgotten(start, watcher, policy_file, body):
    from visualization_msgs.msg import MarkerArray

    shown = []
    watcher.create_subscription(MarkerArray, "/policy_node/markers", shown.append, 1)
    body.clock, body.map_to_odom = 500.0, (5.0, 0.0)
    body.live()
    start("policy_node", policy=policy_file, autostart="true", use_sim_time="true")
    assert watcher.wait_for(lambda: bool(shown))

    def goal_in_odometry():
        goals = [m for m in shown[-1].markers if m.ns == "goal" and m.action == m.ADD]
        return (goals[0].pose.position.x, goals[0].pose.position.y) if goals else None

    watcher.send_goal("map", 40.0, 0.0)
    # odom lies at x = 5 of map.
    assert watcher.wait_for(lambda: goal_in_odometry() == pytest.approx((35.0, 0.0)), 5.0)
    # Localisation corrects it; the goal in map stays.
    body.map_to_odom = (6.0, 1.0)
    assert watcher.wait_for(lambda: goal_in_odometry() == pytest.approx((34.0, -1.0)), 5.0)
    # The simulation begins anew.
    body.clock, body.map_to_odom = 3.0, (0.0, 2.0)
    assert watcher.wait_for(lambda: goal_in_odometry() is None, 5.0)
    watcher.wait_for(lambda: False, 0.5)
    watcher.send_goal("map", 40.0, 0.0)
    assert watcher.wait_for(lambda: goal_in_odometry() is not None, 5.0)
    assert goal_in_odometry() == pytest.approx((40.0, -2.0))
