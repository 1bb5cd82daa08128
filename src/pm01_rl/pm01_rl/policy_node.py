# SPDX-License-Identifier: Apache-2.0
"""A learned policy as a lifecycle node: scan, odometry and goal in, safe commands out."""

from __future__ import annotations

import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav2_msgs.action import NavigateToPose
from nav_msgs.msg import Odometry as OdometryMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from tf2_ros import Buffer, TransformListener
from visualization_msgs.msg import MarkerArray

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.controller import Controller, Status
from pm01_nav.deploy.messages import odometry_from_ros, scan_from_ros
from pm01_nav.deploy.safety import STOP, Command
from pm01_nav.deploy.watchdog import Watchdog
from pm01_nav.errors import InputError
from pm01_rl.conversions import command_message
from pm01_rl.diagnostics import Timing, diagnostics
from pm01_rl.goals import Errand, feedback, goal_in_odometry, is_place, result
from pm01_rl.markers import markers
from pm01_rl.parameters import bounded, declare_safety, described, read_safety
from pm01_rl.running import LATCHED, NO_EVENTS, ros

NEWEST = QoSProfile(depth=1)
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
LIVE = frozenset(("publish_markers",))
"""Parameters that may change while a policy is loaded; the others would have no effect."""


class PolicyNode(LifecycleNode):
    """Convert messages, call the controller, publish.

    One executor's thread runs all callbacks; the watchdog's only publishes.
    """

    def __init__(self, **options: object) -> None:
        """Declare parameters and listen to the emergency stop; the rest waits for ``configure``."""
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
        self.add_on_set_parameters_callback(self._on_parameters)
        self.controller: Controller | None = None
        self._active = False
        self._pressed: set[str] = set()
        """Who presses the emergency stop; no change of state releases it."""
        self._errand: Errand | None = None
        self._status: Status | None = None
        self._odometry_frame = "odom"
        self._watchdog: Watchdog | None = None
        self._commands: Publisher | None = None
        self._action: ActionServer | None = None
        self._from_configure: list[object] = []
        self._from_activate: list[object] = []
        # A button that latches its state is asked for it; one that does not would not answer that.
        for qos in (QoSProfile(depth=10), LATCHED):
            self.create_subscription(
                Bool, "emergency_stop", self._on_emergency, qos, event_callbacks=NO_EVENTS
            )
        self.create_service(SetBool, "~/emergency_stop", self._on_emergency_service)

    def _value(self, name: str) -> object:
        return self.get_parameter(name).value

    def _now(self) -> float:
        """Return the time that ages are measured by [s]: no wall clock, which somebody may set."""
        if self._value("use_sim_time"):
            return self.get_clock().now().nanoseconds * 1e-9
        return time.monotonic()

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a change that would seem to be made and have no effect."""
        late = [change.name for change in changes if change.name not in LIVE]
        if self.controller is None or not late:
            return SetParametersResult(successful=True)
        why = f"{late[0]} is read when the node is configured: deactivate it and clean it up first"
        return SetParametersResult(successful=False, reason=why)

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
            return FAILURE
        for source in self._pressed:
            self.controller.set_emergency(True, source)
        self._kind = TwistStamped if self._value("cmd_vel_stamped") else Twist
        self._commands = self.create_publisher(self._kind, "cmd_vel", NEWEST)
        self._markers = self.create_publisher(MarkerArray, "~/markers", NEWEST)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._from_configure = [self._commands, self._markers, self._diagnostics]
        # From here to the clean-up, so that what is under way can still tell its client its end.
        self._action = ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            self._on_errand,
            goal_callback=self._on_goal_request,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen and to drive."""
        assert self.controller is not None
        sim_time = bool(self._value("use_sim_time"))
        self._timing = Timing(self.controller.control_dt)
        self._buffer = Buffer()
        # A short queue: what waits in a long one is old by the time it is read.
        self._listener = TransformListener(self._buffer, self, qos=QoSProfile(depth=10))
        # The wall's clock may be set, and a timer that follows it back would not fire for long.
        clock = self.get_clock() if sim_time else Clock(clock_type=ClockType.STEADY_TIME)
        subscribe = self.create_subscription
        self._from_activate = [
            subscribe(LaserScan, "scan", self._on_scan, qos_profile_sensor_data),
            subscribe(OdometryMessage, "odom", self._on_odometry, qos_profile_sensor_data),
            subscribe(PoseStamped, "goal_pose", self._on_goal_pose, NEWEST),
            self.create_timer(self.controller.control_dt, self._control, clock=clock),
            self.create_timer(1.0, self._diagnose, clock=clock),
        ]
        if not sim_time:
            # Simulated time may stand still or race; only a robot's is the wall's.
            self._watchdog = Watchdog(lambda: self._tell(STOP))
            self._watchdog.start()
        self._active = True
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot and listen no longer."""
        self._rest()
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the policy."""
        self._forget()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot for good, whatever the state."""
        self._rest()
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot; it may be configured again."""
        self._rest()
        self._forget()
        return SUCCESS

    def _rest(self) -> None:
        """End what ``on_activate`` began, however far it came."""
        self._active = False
        if self._watchdog is not None:
            self._watchdog.end()
            self._watchdog = None
        self._end_errand("stopped")
        self.stop()
        if self._from_activate:
            self._listener.unregister()
        self._destroy(self._from_activate)

    def _forget(self) -> None:
        """Release what ``on_configure`` made, however far it came."""
        if self._action is not None:
            self._action.destroy()
        self._destroy(self._from_configure)
        self.controller = self._commands = self._action = None

    def _destroy(self, entities: list[object]) -> None:
        kinds = (self.destroy_publisher, self.destroy_subscription, self.destroy_timer)
        for entity in entities:
            any(destroy(entity) for destroy in kinds)
        entities.clear()

    # Messages in

    def _on_scan(self, message: LaserScan) -> None:
        self.controller.see_scan(scan_from_ros(message), self._now())

    def _on_odometry(self, message: OdometryMessage) -> None:
        self._odometry_frame = message.header.frame_id
        self.controller.see_odometry(odometry_from_ros(message), self._now())

    def _on_goal_pose(self, pose: PoseStamped) -> None:
        if not is_place(pose):
            self.get_logger().error("goal_pose: its position is not finite; the robot stands")
            self._end_errand("dropped")
            return
        self._begin(Errand(pose, self._now()))

    def _on_goal_request(self, goal: NavigateToPose.Goal) -> GoalResponse:
        ready = self._active and not self._pressed and is_place(goal.pose)
        return GoalResponse.ACCEPT if ready else GoalResponse.REJECT

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
        return result(outcome, self._status)

    def _on_emergency(self, message: Bool) -> None:
        self._press(message.data, "topic")

    def _on_emergency_service(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        self._press(request.data, "service")
        response.success = request.data or not self._pressed
        response.message = "released; send a new goal to go on"
        if self._pressed:
            response.message = f"pressed by {' and '.join(sorted(self._pressed))}"
        return response

    def _press(self, pressed: bool, source: str) -> None:
        """Press or release the emergency stop of one source."""
        (self._pressed.add if pressed else self._pressed.discard)(source)
        if self.controller is not None:
            self.controller.set_emergency(pressed, source)
        if self._pressed:
            self.stop()
            self._end_errand("dropped")

    def _begin(self, errand: Errand) -> None:
        """Head for another goal instead of the present one."""
        self._end_errand("preempted")
        if not self._active or self._pressed:
            errand.end("dropped")
            return
        self._errand = errand

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
        transform_age = self._place_goal(now)
        status = self.controller.step(now, transform_age)
        self._tell(status.verdict.command)
        self._status = status
        self._timing.note(now, time.perf_counter() - began)
        if status.arrived:
            self._end_errand("arrived")
        elif status.dropped:
            self._end_errand("dropped")
        self._report(now)

    def _place_goal(self, now: float) -> float:
        """Keep the controller's goal where its frame has it; return the transform's age [s]."""
        errand = self._errand
        if errand is None:
            return 0.0
        if errand.handle is not None and errand.handle.is_cancel_requested:
            self._end_errand("canceled")
            return 0.0
        goal, stamp = goal_in_odometry(errand.pose, self._odometry_frame, self._buffer)
        if goal is None:
            return math.inf
        if errand.placed:
            self.controller.move_goal(goal)
        else:
            self.controller.set_goal(goal)
            errand.placed = True
        return errand.transform_age(stamp, now, self.get_clock().now().nanoseconds * 1e-9)

    def _tell(self, command: Command) -> None:
        """Publish a command."""
        stamp, frame = self.get_clock().now().to_msg(), str(self._value("base_frame"))
        self._commands.publish(command_message(self._kind, command, stamp, frame))
        if self._watchdog is not None:
            self._watchdog.feed()

    def stop(self) -> None:
        """Tell the robot to stop, if there is anybody to tell it."""
        if self._commands is not None:
            self._tell(STOP)

    # Reports

    def _report(self, now: float) -> None:
        """Tell the action's client, and RViz."""
        status, controller, errand = self._status, self.controller, self._errand
        stamp = self.get_clock().now().to_msg()
        if errand is not None and errand.handle is not None:
            pose, distance = controller.supervisor.pose(now), status.goal_distance
            message = feedback(pose, stamp, self._odometry_frame, distance, now - errand.started)
            errand.handle.publish_feedback(message)
        if self._value("publish_markers") and self._markers.get_subscription_count() > 0:
            text = "; ".join(reason.value for reason in status.verdict.reasons) or "driving"
            frames = (self._odometry_frame, str(self._value("base_frame")))
            lines, goal = controller.beams(), controller.goal
            self._markers.publish(markers(stamp, frames, lines, goal, text))

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
        autostart = node.get_parameter("autostart").value
        if autostart and not node.trigger_configure() == SUCCESS == node.trigger_activate():
            raise SystemExit(1)
        try:
            executor.spin()
        finally:
            node.stop()
