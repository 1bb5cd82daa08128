# SPDX-License-Identifier: Apache-2.0
"""Nodes that would drive the same robot, and a lidar that is mounted otherwise than described."""

from __future__ import annotations

import math
import time

import pytest


@pytest.fixture
def said(watcher):
    """Return what nodes log."""
    from rcl_interfaces.msg import Log

    lines = []
    watcher.create_subscription(Log, "/rosout", lambda m: lines.append(m.msg), 100)
    return lines


@pytest.fixture
def serve(watcher):
    """Return a function that serves ``navigate_to_pose``, as Nav2's bt_navigator does."""
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionServer

    servers = []

    def run() -> None:
        servers.append(
            ActionServer(watcher, NavigateToPose, "/navigate_to_pose", lambda handle: None)
        )

    run.servers = servers
    yield run
    for server in servers:
        server.destroy()


def test_a_goal_that_would_start_two_is_not_served(
    start, watcher, policy_file, said, change_state, serve
):
    serve()
    start("policy_node", policy=policy_file)
    assert change_state("configure")
    assert not change_state("activate")
    assert watcher.wait_for(lambda: any("/watcher also serves" in line for line in said), 5.0)
    # It says what to do, and does it no longer when the other has gone.
    assert any("navigate_to_pose:=" in line for line in said)
    serve.servers.pop().destroy()
    watcher.wait_for(lambda: False, 1.0)
    assert change_state("activate")


def test_a_server_that_comes_later_ends_that_goals_are_taken(start, watcher, policy_file, serve):
    from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
    from rclpy.action import ActionClient

    start("policy_node", policy=policy_file, autostart="true")
    client = ActionClient(watcher, NavigateThroughPoses, "/navigate_through_poses")
    assert watcher.wait_for(client.server_is_ready)
    goal = NavigateThroughPoses.Goal()
    goal.poses.append(NavigateToPose.Goal().pose)
    goal.poses[0].header.frame_id = "odom"

    def accepted() -> bool:
        future = client.send_goal_async(goal)
        assert watcher.wait_for(future.done)
        return future.result().accepted

    assert watcher.wait_for(accepted)
    serve()
    assert watcher.wait_for(lambda: not accepted(), 10.0)


def test_the_launch_file_gives_the_actions_other_names(watcher, policy_file, launch, serve):
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionClient

    serve()
    names = ("navigate_to_pose", "navigate_through_poses", "goal_pose")
    launch(f"policy:={policy_file}", *(f"{name}:=ours/{name}" for name in names))
    client = ActionClient(watcher, NavigateToPose, "/ours/navigate_to_pose")
    assert watcher.wait_for(client.server_is_ready)
    goal = NavigateToPose.Goal()
    goal.pose.header.frame_id = "odom"

    def accepted() -> bool:
        future = client.send_goal_async(goal)
        return watcher.wait_for(future.done, 5.0) and future.result().accepted

    assert watcher.wait_for(accepted, 20.0)


def test_without_a_goal_others_drive_undisturbed(start, watcher, policy_file):
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    watcher.set_off()
    # A goal without a place ends the present one.
    watcher.send_goal("odom", float("nan"), 0.0)
    assert watcher.wait_for(lambda: not watcher.moves())
    stopped, before = time.monotonic(), len(watcher.commands)
    watcher.wait_for(lambda: False, 3.0)
    said = watcher.commands[before:]
    # For a second it says stop; then another may drive for two.
    assert len(said) > 5
    assert said[-1][0] - stopped < 1.5
    assert all(command.linear.x == command.angular.z == 0.0 for _, command in said)


def test_the_watchdog_is_silent_for_whoever_drives_beside_it(start, watcher):
    from geometry_msgs.msg import Twist

    start("watchdog_node")
    publisher = watcher.create_publisher(Twist, "/cmd_vel_in", 1)
    assert watcher.wait_for(lambda: publisher.get_subscription_count() > 0)
    # What it never forwarded it does not guard.
    assert not watcher.wait_for(lambda: bool(watcher.commands), 1.0)
    command = Twist()
    command.linear.x = 0.5
    publisher.publish(command)
    watcher.wait_for(lambda: False, 3.0)
    forwarded, *stops = watcher.commands
    assert forwarded[1].linear.x == 0.5
    # After 0.15 s of silence it says stop for a second.
    assert stops[0][0] - forwarded[0] < 0.6
    assert stops[-1][0] - forwarded[0] < 1.8
    assert all(command.linear.x == 0.0 for _, command in stops)


@pytest.mark.parametrize("exclusive", ["false", "true"])
def test_a_second_publisher_is_named_and_with_exclusive_a_stop(
    start, watcher, policy_file, exclusive
):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from geometry_msgs.msg import Twist

    reports = []
    watcher.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: reports.append(m.status[0]), 10
    )
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", exclusive=exclusive)
    watcher.set_off()
    assert not any("watcher" in report.message for report in reports)
    watcher.create_publisher(Twist, "/cmd_vel", 1)
    assert watcher.wait_for(lambda: any("/watcher" in report.message for report in reports), 5.0)
    assert reports[-1].level == DiagnosticStatus.WARN
    assert watcher.moves() == (exclusive == "false")


@pytest.mark.parametrize(
    ("place", "goes"),
    [
        ((0.0, 0.0, 0.0), True),
        ((0.01, -0.01, math.radians(1.0)), True),
        ((0.0, 0.0, math.pi), False),
        ((0.03, 0.0, 0.0), False),
        ((0.0, 0.0, math.radians(3.0)), False),
    ],
)
def test_a_lidar_that_tf_has_elsewhere_is_refused(
    start, watcher, policy_file, body, said, change_state, place, goes
):
    from pm01_nav.robot import load_robot

    lidar = load_robot("pm01").lidar
    described = (lidar.x, lidar.y, lidar.yaw)
    body.lidar = tuple(a + b for a, b in zip(described, place, strict=True))
    body.live()
    start("policy_node", policy=policy_file)
    assert change_state("configure")
    watcher.wait_for(lambda: False, 1.5)
    assert change_state("activate") == goes
    if not goes:
        # It says both numbers.
        x, yaw = body.lidar[0], math.degrees(body.lidar[2])
        found = f"x {x:.3f} m, y {body.lidar[1]:.3f} m, yaw {yaw:.1f}°"
        assert watcher.wait_for(lambda: any(found in line for line in said), 5.0)
        ours = f"x {lidar.x:.3f} m, y {lidar.y:.3f} m, yaw {math.degrees(lidar.yaw):.1f}°"
        assert any(found in line and ours in line for line in said)


def test_a_lidar_whose_place_becomes_known_late_stops_the_robot(start, watcher, policy_file, body):
    body.lidar = None
    body.live()
    start("policy_node", policy=policy_file, autostart="true")
    watcher.set_off()
    body.lidar = (0.0, 0.0, math.pi)
    assert watcher.wait_for(lambda: not watcher.moves(), 5.0)


@pytest.mark.parametrize(("described", "fits"), [(True, True), (False, False)])
def test_a_lidar_that_hangs_head_down_must_be_described_so(described, fits):
    from geometry_msgs.msg import TransformStamped
    from pm01_rl.conversions import quaternion
    from pm01_rl.lidar_mount import LidarMount
    from tf2_ros import Buffer

    from pm01_nav.robot import load_robot

    changes = {"upside_down": described, "yaw": 0.5}
    lidar = load_robot("pm01").lidar.model_copy(update=changes)
    buffer = Buffer()
    transform = TransformStamped(child_frame_id="laser")
    transform.header.frame_id = "base_link"
    transform.transform.translation.x, transform.transform.translation.y = lidar.x, lidar.y
    # Half a turn about x, z points down, then 0.5 rad about the robot's z.
    turn = transform.transform.rotation = quaternion(0.5, upside_down=True)
    assert (turn.x, turn.y) == pytest.approx((0.9689124, 0.2474040))
    assert (turn.z, turn.w) == (0.0, 0.0)
    buffer.set_transform_static(transform, "test")
    mount = LidarMount(lidar, "base_link", buffer)
    mount.look("laser")
    assert mount.known
    assert (mount.difference is None) == fits
