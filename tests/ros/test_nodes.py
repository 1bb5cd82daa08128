# SPDX-License-Identifier: Apache-2.0
"""The policy node and the simulated robot, as a user has them."""

from __future__ import annotations

import os
import signal
import time


def test_a_policy_that_does_not_fit_the_robot_is_not_activated(
    start, policy_file, state, change_state
):
    start("policy_node", policy=policy_file, robot="jackal")
    assert state() == "unconfigured"
    assert not change_state("configure")
    assert state() == "unconfigured"


def test_drives_stops_for_the_emergency_stop_and_for_a_dead_sensor(
    start, watcher, policy_file, call
):
    from std_srvs.srv import SetBool

    sim = start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", publish_markers="true")
    assert watcher.wait_for(lambda: bool(watcher.commands))
    assert not watcher.moves()
    watcher.set_off()
    name = "/policy_node/emergency_stop"
    assert call(SetBool, name, SetBool.Request(data=True)).success
    assert watcher.wait_for(lambda: not watcher.moves(), 2.0)
    call(SetBool, name, SetBool.Request(data=False))
    assert not watcher.wait_for(lambda: watcher.moves(), 1.0)
    watcher.set_off()
    os.killpg(sim.pid, signal.SIGKILL)
    killed = time.monotonic()
    assert watcher.wait_for(lambda: not watcher.moves(), 5.0)
    # Odometry may be 0.3 s old, a control step is 0.1 s; the rest is a busy machine's.
    assert watcher.commands[-1][0] - killed < 0.8


def test_a_simulated_lidar_that_hangs_upside_down_is_one_that_does(
    start, watcher, policy_file, tmp_path
):
    import yaml

    from pm01_nav.robot import load_robot

    robot = load_robot("pm01").model_dump(mode="json")
    robot["lidar"]["upside_down"] = True
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(robot))
    start("sim_node", world="empty", robot=file)
    start("policy_node", policy=policy_file, robot=file, autostart="true")
    # It goes active only where tf and the description agree.
    watcher.set_off()


def test_the_watchdog_stops_a_base_whose_driver_is_killed(start, watcher):
    from geometry_msgs.msg import Twist

    start("watchdog_node")
    publisher = watcher.create_publisher(Twist, "/cmd_vel_in", 1)
    assert watcher.wait_for(lambda: publisher.get_subscription_count() > 0)
    command = Twist()
    command.linear.x = 0.5

    def told() -> bool:
        publisher.publish(command)
        return watcher.moves()

    assert watcher.wait_for(told)
    silent = time.monotonic()
    assert watcher.wait_for(lambda: not watcher.moves(), 5.0)
    # 200 ms are promised; the machine that runs tests may be busy.
    assert watcher.commands[-1][0] - silent < 0.6


def test_an_action_is_preempted_and_canceled(start, watcher, policy_file, send_action):
    from action_msgs.msg import GoalStatus
    from nav2_msgs.action import NavigateToPose

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    goal = NavigateToPose.Goal()
    goal.pose.header.frame_id = "odom"
    goal.pose.pose.position.x = goal.pose.pose.position.y = 40.0
    feedback = []

    def send():
        return send_action(NavigateToPose, "/navigate_to_pose", goal, feedback.append)

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


def test_whatever_ends_the_active_state_stops_the_robot(
    start, watcher, policy_file, state, change_state
):
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    assert watcher.wait_for(lambda: state() == "active")
    for transition in ("deactivate", "active_shutdown"):
        if state() == "inactive":
            assert change_state("activate")
        watcher.set_off()
        assert change_state(transition)
        assert watcher.wait_for(lambda: not watcher.moves(), 2.0)
        # And it is not told anything else afterwards.
        assert not watcher.wait_for(lambda: watcher.moves(), 1.0)


def test_the_emergency_stop_holds_whoever_repeats_that_it_is_released(
    start, watcher, policy_file, change_state, call
):
    from std_msgs.msg import Bool
    from std_srvs.srv import SetBool

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    button = watcher.create_publisher(Bool, "/emergency_stop", 1)
    assert watcher.wait_for(lambda: button.get_subscription_count() > 0)
    watcher.set_off()
    # A button that says ten times a second that nobody presses it does not end the goal...
    watcher.create_timer(0.1, lambda: button.publish(Bool(data=False)))
    assert not watcher.wait_for(lambda: not watcher.moves(), 1.5)
    # ... and does not release what the service presses, nor does a change of state.
    name = "/policy_node/emergency_stop"
    assert call(SetBool, name, SetBool.Request(data=True)).success
    assert watcher.wait_for(lambda: not watcher.moves(), 2.0)
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        assert change_state(transition)
    watcher.send_goal()
    assert not watcher.wait_for(lambda: watcher.moves(), 1.5)
    assert call(SetBool, name, SetBool.Request(data=False)).success
    watcher.set_off()


def test_an_emergency_stop_that_was_latched_before_the_start_is_heard(start, watcher, policy_file):
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Bool

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    watcher.create_publisher(Bool, "/emergency_stop", latched).publish(Bool(data=True))
    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    assert watcher.wait_for(lambda: bool(watcher.commands))
    watcher.send_goal()
    assert not watcher.wait_for(lambda: watcher.moves(), 1.5)


def test_a_change_that_would_have_no_effect_is_refused(
    start, watcher, policy_file, change_state, call
):
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rcl_interfaces.srv import SetParameters

    start("policy_node", policy=policy_file)

    def set_padding() -> bool:
        value = ParameterValue(type=3, double_value=0.3)
        request = SetParameters.Request(parameters=[Parameter(name="safety.padding", value=value)])
        answer = call(SetParameters, "/policy_node/set_parameters", request)
        return answer.results[0].successful

    assert set_padding()
    assert change_state("configure")
    assert not set_padding()


def test_no_action_is_accepted_that_cannot_be_driven(
    start, watcher, policy_file, state, change_state
):
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionClient

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true")
    client = ActionClient(watcher, NavigateToPose, "/navigate_to_pose")
    assert watcher.wait_for(client.server_is_ready)

    def accepted(x: float) -> bool:
        goal = NavigateToPose.Goal()
        goal.pose.header.frame_id = "odom"
        goal.pose.pose.position.x = x
        future = client.send_goal_async(goal)
        assert watcher.wait_for(future.done)
        return future.result().accepted

    assert watcher.wait_for(lambda: state() == "active")
    assert not accepted(float("nan"))
    assert accepted(40.0)
    assert change_state("deactivate")
    assert not accepted(40.0)


def test_a_stamped_command_passes_the_watchdog(start, watcher):
    from geometry_msgs.msg import TwistStamped

    start("watchdog_node", cmd_vel_stamped="true")
    heard = []
    watcher.destroy_subscription(next(iter(watcher.subscriptions)))
    watcher.create_subscription(TwistStamped, "/cmd_vel", heard.append, 10)
    publisher = watcher.create_publisher(TwistStamped, "/cmd_vel_in", 1)
    assert watcher.wait_for(lambda: publisher.get_subscription_count() > 0)
    command = TwistStamped()
    command.twist.linear.x = 0.5

    def told() -> bool:
        publisher.publish(command)
        return bool(heard) and heard[-1].twist.linear.x == 0.5

    assert watcher.wait_for(told)
    assert watcher.wait_for(lambda: heard[-1].twist.linear.x == 0.0, 5.0)


def test_a_transform_that_is_published_no_longer_stops_the_robot(start, watcher, policy_file):
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    start("sim_node", world="empty")
    start("policy_node", policy=policy_file, autostart="true", global_frame="elsewhere")
    publisher = watcher.create_publisher(TFMessage, "/tf", 10)
    last = []

    def publish() -> None:
        # Dated 2 s ahead, as localisation does so that nobody has to wait for it.
        stamp = time.time() + 2.0
        transform = TransformStamped(child_frame_id="elsewhere")
        transform.header.frame_id = "odom"
        transform.header.stamp.sec = int(stamp)
        transform.header.stamp.nanosec = int(1e9 * (stamp % 1.0))
        publisher.publish(TFMessage(transforms=[transform]))
        last.append(time.monotonic())

    timer = watcher.create_timer(0.05, publish)
    watcher.set_off(frame="elsewhere")
    assert not watcher.wait_for(lambda: not watcher.moves(), 1.5)
    timer.cancel()
    assert watcher.wait_for(lambda: not watcher.moves(), 5.0)
    # It may be 1 s old from its arrival on, whatever its date; a step is 0.1 s.
    assert watcher.commands[-1][0] - last[-1] < 2.0
    # It goes on when the transform comes again.
    timer.reset()
    assert watcher.wait_for(lambda: watcher.moves())


def test_rviz_is_shown_what_the_policy_sees(start, watcher, policy_file):
    from visualization_msgs.msg import MarkerArray

    shown = []
    watcher.create_subscription(MarkerArray, "/policy_node/markers", shown.append, 1)
    start("policy_node", policy=policy_file, autostart="true")
    # Without a scan there are no beams to draw.
    assert watcher.wait_for(lambda: bool(shown))
    assert list(shown[-1].markers[0].points) == []
    start("sim_node", world="static")
    watcher.send_goal()
    assert watcher.wait_for(lambda: len(shown[-1].markers[0].points) > 0)
    beams, goal, state = shown[-1].markers
    # Each of PM01's 36 sectors of 10 beams is a line from the lidar to the nearest return.
    assert len(beams.points) == 2 * 36
    assert (goal.ns, state.ns) == ("goal", "state")


def test_a_transition_that_there_is_not_ends_nothing(start, watcher, policy_file, state):
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    start("policy_node", policy=policy_file, autostart="true")
    assert watcher.wait_for(lambda: state() == "active")
    client = watcher.create_client(ChangeState, "/policy_node/change_state")
    assert watcher.wait_for(client.service_is_ready)
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE))
    # Humble's rclpy does not answer it.
    watcher.wait_for(client.call_async(request).done, 3.0)
    assert state() == "active"
