# SPDX-License-Identifier: Apache-2.0
"""The policy node and the simulated robot, as a user has them."""

from __future__ import annotations

import os
import signal
import time

import pytest


@pytest.fixture
def watcher(rclpy):
    """A node that notes commands and can wait."""
    from geometry_msgs.msg import Twist

    node = rclpy.create_node("watcher")
    node.commands = []
    node.create_subscription(
        Twist, "/cmd_vel", lambda m: node.commands.append((time.monotonic(), m)), 10
    )

    def wait_for(condition, seconds=60.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.02)
            if condition():
                return True
        return False

    node.wait_for = wait_for
    yield node
    node.destroy_node()


def call(node, kind, name, request):
    client = node.create_client(kind, name)
    assert node.wait_for(client.service_is_ready)
    future = client.call_async(request)
    assert node.wait_for(future.done)
    return future.result()


def state_of(node) -> str:
    from lifecycle_msgs.srv import GetState

    answer = call(node, GetState, "/policy_node/get_state", GetState.Request())
    return answer.current_state.label


def moves(node) -> bool:
    return bool(node.commands) and abs(node.commands[-1][1].linear.x) > 0.05


def send_goal(rclpy, node, frame="odom", x=40.0, y=40.0):
    from geometry_msgs.msg import PoseStamped

    publisher = node.create_publisher(PoseStamped, "/goal_pose", 1)
    assert node.wait_for(lambda: publisher.get_subscription_count() > 0)
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y = x, y
    publisher.publish(pose)


def test_a_policy_that_does_not_fit_the_robot_is_not_activated(start, watcher, policy_file):
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    start("policy_node", policy=policy_file, robot="jackal")
    assert state_of(watcher) == "unconfigured"
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    answer = call(watcher, ChangeState, "/policy_node/change_state", request)
    assert not answer.success
    assert state_of(watcher) == "unconfigured"


def test_drives_stops_for_the_emergency_stop_and_for_a_dead_sensor(
    start, watcher, policy_file, rclpy
):
    from std_srvs.srv import SetBool

    sim = start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", publish_markers="true")
    assert watcher.wait_for(lambda: bool(watcher.commands))
    assert not moves(watcher)
    send_goal(rclpy, watcher)
    assert watcher.wait_for(lambda: moves(watcher))
    name = "/policy_node/emergency_stop"
    assert call(watcher, SetBool, name, SetBool.Request(data=True)).success
    assert watcher.wait_for(lambda: not moves(watcher), 2.0)
    call(watcher, SetBool, name, SetBool.Request(data=False))
    assert not watcher.wait_for(lambda: moves(watcher), 1.0)
    send_goal(rclpy, watcher)
    assert watcher.wait_for(lambda: moves(watcher))
    os.killpg(sim.pid, signal.SIGKILL)
    killed = time.monotonic()
    assert watcher.wait_for(lambda: not moves(watcher), 5.0)
    # Odometry may be 0.3 s old, a control step is 0.1 s; the rest is a busy machine's.
    assert watcher.commands[-1][0] - killed < 0.8


def test_the_watchdog_stops_a_base_whose_driver_is_killed(start, watcher):
    from geometry_msgs.msg import Twist

    start("watchdog_node")
    publisher = watcher.create_publisher(Twist, "/cmd_vel_in", 1)
    assert watcher.wait_for(lambda: publisher.get_subscription_count() > 0)
    command = Twist()
    command.linear.x = 0.5

    def told() -> bool:
        publisher.publish(command)
        return moves(watcher)

    assert watcher.wait_for(told)
    silent = time.monotonic()
    assert watcher.wait_for(lambda: not moves(watcher), 5.0)
    # 200 ms are promised; the machine that runs tests may be busy.
    assert watcher.commands[-1][0] - silent < 0.6


def test_an_action_is_preempted_and_canceled(start, watcher, policy_file, rclpy):
    from action_msgs.msg import GoalStatus
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionClient

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    client = ActionClient(watcher, NavigateToPose, "/navigate_to_pose")
    assert watcher.wait_for(client.server_is_ready)
    goal = NavigateToPose.Goal()
    goal.pose.header.frame_id = "map"
    goal.pose.pose.position.x = goal.pose.pose.position.y = 40.0
    feedback = []

    def send():
        future = client.send_goal_async(goal, feedback_callback=feedback.append)
        assert watcher.wait_for(future.done)
        assert future.result().accepted
        return future.result()

    first = send()
    assert watcher.wait_for(lambda: any(f.feedback.distance_remaining > 10.0 for f in feedback))
    second = send()
    result = first.get_result_async()
    assert watcher.wait_for(result.done)
    assert result.result().status == GoalStatus.STATUS_ABORTED
    assert watcher.wait_for(second.cancel_goal_async().done)
    result = second.get_result_async()
    assert watcher.wait_for(result.done)
    assert result.result().status == GoalStatus.STATUS_CANCELED
