# SPDX-License-Identifier: Apache-2.0
"""A learned policy as a lifecycle node: scan, odometry and goal in, safe commands out."""

from __future__ import annotations

import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from tf2_ros import Buffer, TransformListener
from visualization_msgs.msg import MarkerArray

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.beams import seen_ends
from pm01_nav.deploy.controller import Controller, Status
from pm01_nav.deploy.ros_messages import odometry_from_ros, scan_from_ros
from pm01_nav.deploy.safety import STOP, Command
from pm01_nav.deploy.watchdog import Watchdog
from pm01_nav.errors import InputError
from pm01_rl.conversions import stamped_twist, twist_message
from pm01_rl.diagnostics import Timing, diagnostics
from pm01_rl.goals import Errand, feedback, goal_in_odometry
from pm01_rl.markers import markers
from pm01_rl.parameters import bounded, declare_safety, described, read_safety
from pm01_rl.running import ros

NEWEST = QoSProfile(depth=1)
CONFIGURED, FAILED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class PolicyNode(LifecycleNode):
    """Convert messages, call the controller, publish."""

    def __init__(self, **options: object) -> None:
        """Declare parameters; everything else waits for ``configure``."""
        super().__init__("policy_node", **options)
        declare, fixed = self.declare_parameter, {"read_only": True}
        declare("policy", "", described("The policy's file, policy.onnx."))
        declare("robot", "", described("A robot's name or YAML; empty: the policy's own."))
        declare("goal_radius", 0.0, bounded("Near enough to a goal [m]; 0: the policy's.", 0, 10))
        declare("cmd_vel_stamped", False, described("Publish TwistStamped, not Twist.", **fixed))
        declare("base_frame", "base_link", described("The robot's frame.", **fixed))
        declare("publish_markers", True, described("Whether RViz gets something to show."))
        declare("autostart", False, described("Configure and activate at once.", **fixed))
        declare_safety(self)
        self.controller: Controller | None = None
        self._errand: Errand | None = None
        self._status: Status | None = None
        self._odometry_frame = "odom"
        self._scan: LaserScan | None = None
        self._watchdog: Watchdog | None = None
        self._things: list[object] = []

    def _value(self, name: str) -> object:
        return self.get_parameter(name).value

    def _now(self) -> float:
        """Return the time that ages are measured by [s]: no wall clock, which somebody may set."""
        if self._value("use_sim_time"):
            return self.get_clock().now().nanoseconds * 1e-9
        return time.monotonic()

    # Lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the policy; it must fit the robot."""
        try:
            self.controller = load_controller(
                str(self._value("policy")),
                str(self._value("robot")) or None,
                goal_radius=float(self._value("goal_radius")) or None,
                safety=read_safety(self),
                same_clock=bool(self._value("use_sim_time")),
            )
        except InputError as error:
            self.get_logger().error(f"not configured: {error}")
            return FAILED
        kind = TwistStamped if self._value("cmd_vel_stamped") else Twist
        self._commands = self.create_publisher(kind, "cmd_vel", NEWEST)
        self._markers = self.create_publisher(MarkerArray, "~/markers", NEWEST)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        return CONFIGURED

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen and to drive."""
        assert self.controller is not None
        self._timing = Timing(self.controller.control_dt)
        self._buffer = Buffer()
        # A short queue: what waits in a long one is old by the time it is read.
        self._listener = TransformListener(self._buffer, self, qos=QoSProfile(depth=10))
        subscribe, destroy = self.create_subscription, self._things.append
        destroy(subscribe(LaserScan, "scan", self._on_scan, qos_profile_sensor_data))
        destroy(subscribe(OdometryMessage, "odom", self._on_odometry, qos_profile_sensor_data))
        destroy(subscribe(PoseStamped, "goal_pose", self._on_goal_pose, NEWEST))
        destroy(subscribe(Bool, "emergency_stop", self._on_emergency, 10))
        destroy(self.create_service(SetBool, "~/emergency_stop", self._on_emergency_service))
        destroy(self.create_timer(self.controller.control_dt, self._control))
        destroy(self.create_timer(1.0, self._diagnose))
        self._action = ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            self._on_errand,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._watchdog = None
        if not self._value("use_sim_time"):
            # Simulated time may stand still or race; only a robot's is the wall's.
            self._watchdog = Watchdog(lambda: self._tell(STOP))
            self._watchdog.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot and listen no longer."""
        if self._watchdog is not None:
            self._watchdog.end()
        self._end_errand("stopped")
        self._tell(STOP)
        self._action.destroy()
        self._listener.unregister()
        destroyers = (
            self.destroy_subscription,
            self.destroy_service,
            self.destroy_timer,
        )
        for thing in self._things:
            any(destroy(thing) for destroy in destroyers)
        self._things.clear()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the policy."""
        for publisher in (self._commands, self._markers, self._diagnostics):
            self.destroy_publisher(publisher)
        self.controller = None
        return CONFIGURED

    # Messages in

    def _on_scan(self, message: LaserScan) -> None:
        self._scan = message
        self.controller.see_scan(scan_from_ros(message), self._now())

    def _on_odometry(self, message: OdometryMessage) -> None:
        self._odometry_frame = message.header.frame_id
        self.controller.see_odometry(odometry_from_ros(message), self._now())

    def _on_goal_pose(self, pose: PoseStamped) -> None:
        self._begin(Errand(pose, self._now()))

    async def _on_errand(self, handle: ServerGoalHandle) -> NavigateToPose.Result:
        errand = Errand(handle.request.pose, self._now(), handle)
        self._begin(errand)
        outcome = await errand.ended
        if outcome == "arrived":
            handle.succeed()
        elif outcome == "canceled":
            handle.canceled()
        else:
            handle.abort()
        return NavigateToPose.Result()

    def _on_emergency(self, message: Bool) -> None:
        self.controller.set_emergency(message.data)
        self._tell(STOP)
        self._end_errand("dropped")

    def _on_emergency_service(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        self._on_emergency(Bool(data=request.data))
        response.success = True
        response.message = "pressed" if request.data else "released; send a new goal to go on"
        return response

    def _begin(self, errand: Errand) -> None:
        """Head for another goal instead of the present one."""
        self._end_errand("preempted")
        self._errand = errand
        self._begun = False

    def _end_errand(self, outcome: str) -> None:
        errand, self._errand = self._errand, None
        if self.controller is not None:
            self.controller.cancel()
        if errand is not None:
            errand.end(outcome)
            self.get_logger().info(f"goal: {outcome}")

    # Control

    def _control(self) -> None:
        """Make one control step: this is the timer's callback."""
        began, now = time.perf_counter(), self._now()
        transform_age = self._place_goal()
        status = self.controller.step(now, transform_age)
        self._tell(status.verdict.command)
        self._status = status
        self._timing.note(now, time.perf_counter() - began)
        if status.arrived:
            self._end_errand("arrived")
        elif status.dropped:
            self._end_errand("dropped")
        self._report(now)

    def _place_goal(self) -> float:
        """Keep the controller's goal where its frame has it; return the transform's age [s]."""
        errand = self._errand
        if errand is None:
            return 0.0
        if errand.handle is not None and errand.handle.is_cancel_requested:
            self._end_errand("canceled")
            return 0.0
        clock = self.get_clock().now().nanoseconds * 1e-9
        goal, age = goal_in_odometry(errand.pose, self._odometry_frame, self._buffer, clock)
        if goal is None:
            return age
        if self._begun:
            self.controller.move_goal(goal)
        else:
            self.controller.set_goal(goal)
            self._begun = True
        return age

    def _tell(self, command: Command) -> None:
        """Publish a command."""
        if self._value("cmd_vel_stamped"):
            stamp = self.get_clock().now().to_msg()
            frame = str(self._value("base_frame"))
            self._commands.publish(stamped_twist(command, stamp, frame))
        else:
            self._commands.publish(twist_message(command))
        if self._watchdog is not None:
            self._watchdog.feed()

    def stop(self) -> None:
        """Tell the robot to stop, if there is anybody to tell it."""
        if self.controller is not None:
            self._tell(STOP)

    # Reports

    def _report(self, now: float) -> None:
        """Tell the action's client, and RViz."""
        status, controller, errand = self._status, self.controller, self._errand
        if errand is not None and errand.handle is not None:
            pose = controller.supervisor.pose(now)
            errand.handle.publish_feedback(feedback(errand, pose, status.goal_distance, now))
        watched = self._markers.get_subscription_count() > 0
        if not (watched and self._value("publish_markers") and self._scan is not None):
            return
        lidar = controller.robot.lidar
        mount = np.array([lidar.x, lidar.y, lidar.yaw])
        ends = seen_ends(controller.policy.layout, controller.fitted(), mount)
        text = "; ".join(reason.value for reason in status.verdict.reasons) or "driving"
        frames = (self._odometry_frame, str(self._value("base_frame")))
        stamp = self.get_clock().now().to_msg()
        self._markers.publish(markers(stamp, frames, mount[:2], ends, controller.goal, text))

    def _diagnose(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(
            diagnostics(
                stamp,
                str(self._value("policy")),
                self._status,
                self._timing,
                self.controller.failure,
            )
        )


def main() -> None:
    """Run the node until it is told to end; the robot then stands."""
    with ros():
        node = PolicyNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        if node.get_parameter("autostart").value:
            if node.trigger_configure() != CONFIGURED:
                raise SystemExit(1)
            node.trigger_activate()
        try:
            executor.spin()
        finally:
            node.stop()
