# SPDX-License-Identifier: Apache-2.0
"""A learned policy as a lifecycle node: scan, odometry and goal in, safe commands out."""

from __future__ import annotations

import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from tf2_ros import Buffer, TransformListener
from visualization_msgs.msg import MarkerArray

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.controller import Controller, Status
from pm01_nav.deploy.messages import odometry_from_ros, scan_from_ros
from pm01_nav.deploy.safety import STOP, Command, Reason
from pm01_nav.deploy.watchdog import Turn, Watchdog
from pm01_nav.errors import InputError
from pm01_rl.action_servers import ACTIONS, Client, GoalServers
from pm01_rl.conversions import command_message
from pm01_rl.diagnostics import Timing, diagnostics
from pm01_rl.emergency_stop import EmergencyStop
from pm01_rl.goals import Errand, Frames, Outcome, is_place, outcome_of
from pm01_rl.lidar_mount import LidarMount
from pm01_rl.markers import markers
from pm01_rl.others import DISCOVERY_S, LEASE_S, Others
from pm01_rl.parameters import declare_parameters, read_safety
from pm01_rl.running import ros, spin

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
        declare_parameters(self)
        self.add_on_set_parameters_callback(self._on_parameters)
        self.controller: Controller | None = None
        self._active = False
        self._born = time.monotonic()
        self._errand: Errand | None = None
        self._status: Status | None = None
        self._frames = Frames("odom", str(self._value("global_frame")))
        self._watchdog: Watchdog | None = None
        self._commands: Publisher | None = None
        self._servers: GoalServers | None = None
        self._from_configure: list[object] = []
        self._from_activate: list[object] = []
        self._stop_button = EmergencyStop(self, self._on_emergency)

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
            self.controller = controller = load_controller(
                str(self._value("policy")),
                str(self._value("robot")) or None,
                goal_radius=float(self._value("goal_radius")) or None,
                safety=read_safety(self),
                same_clock=bool(self._value("use_sim_time")),
            )
        except InputError as error:
            self.get_logger().error(f"not configured: {error}")
            return FAILURE
        if self._value("use_sim_time"):
            controller.clock = self._now
        controller.patience_s = float(self._value("goal_patience_s"))
        controller.yaw_tolerance = float(self._value("yaw_goal_tolerance"))
        for source in self._stop_button.sources:
            controller.set_emergency(True, source)
        self._kind = TwistStamped if self._value("cmd_vel_stamped") else Twist
        self._commands = self.create_publisher(self._kind, "cmd_vel", NEWEST)
        self._markers = self.create_publisher(MarkerArray, "~/markers", NEWEST)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._listen_to_tf()
        self._from_configure = [
            self._commands,
            self._markers,
            self._diagnostics,
            # From here on, so that the lidar's place is known before the robot may move.
            self.create_subscription(LaserScan, "scan", self._on_scan, qos_profile_sensor_data),
        ]
        # From here to the clean-up, so that what is under way can still tell its client its end.
        self._servers = GoalServers(self, self._is_ready, self._begin, self._on_cancel)
        self.others = Others(self, ACTIONS, "cmd_vel", str(self._value("base_topic")))
        return SUCCESS

    def _listen_to_tf(self) -> None:
        """Collect transforms; those from before a clock went back would outlive all new ones."""
        self._buffer = Buffer()
        # A short queue: what waits in a long one is old by the time it is read.
        self._listener = TransformListener(self._buffer, self, qos=QoSProfile(depth=10))
        backward = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
        self._jumps = self.get_clock().create_jump_callback(
            backward, post_callback=lambda _: self._buffer.clear()
        )
        base_frame = str(self._value("base_frame"))
        self._mount = LidarMount(self.controller.robot.lidar, base_frame, self._buffer)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen and to drive, unless that would end badly."""
        assert self.controller is not None
        time.sleep(max(0.0, self._born + DISCOVERY_S - time.monotonic()))
        self.others.look()
        obstacles = [self._mount.difference, self.others.shared_actions]
        for obstacle in filter(None, obstacles):
            self.get_logger().error(f"not activated: {obstacle}")
        if any(obstacles):
            return FAILURE
        sim_time = bool(self._value("use_sim_time"))
        self._timing = Timing(self.controller.control_dt)
        self._turn = Turn(time.monotonic())
        # The wall's clock may be set, and a timer that follows it back would not fire for long.
        clock = self.get_clock() if sim_time else Clock(clock_type=ClockType.STEADY_TIME)
        subscribe = self.create_subscription
        self._from_activate = [
            subscribe(OdometryMessage, "odom", self._on_odometry, qos_profile_sensor_data),
            subscribe(PoseStamped, "goal_pose", self._on_goal_pose, NEWEST),
            self.create_timer(self.controller.control_dt, self._control, clock=clock),
            self.create_timer(1.0, self._diagnose, clock=clock),
        ]
        if not sim_time:
            # Simulated time may stand still or race; only a robot's is the wall's.
            self._watchdog = Watchdog(lambda: self._publish(STOP))
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
        self._destroy(self._from_activate)

    def _forget(self) -> None:
        """Release what ``on_configure`` made, however far it came."""
        if self._servers is not None:
            self._servers.destroy()
        if self._from_configure:
            self._jumps.unregister()
            self._listener.unregister()
        self._destroy(self._from_configure)
        self.controller = self._commands = self._servers = None

    def _destroy(self, entities: list[object]) -> None:
        kinds = (self.destroy_publisher, self.destroy_subscription, self.destroy_timer)
        for entity in entities:
            any(destroy(entity) for destroy in kinds)
        entities.clear()

    # Messages in

    def _on_scan(self, message: LaserScan) -> None:
        self._mount.look(message.header.frame_id)
        if self._active:
            self.controller.see_scan(scan_from_ros(message), self._now())

    def _on_odometry(self, message: OdometryMessage) -> None:
        self._frames = self._frames._replace(odometry=message.header.frame_id)
        self.controller.see_odometry(odometry_from_ros(message, self.controller.axes), self._now())

    def _on_goal_pose(self, pose: PoseStamped) -> None:
        if not is_place(pose):
            self.get_logger().error("goal_pose: it is not finite; the robot stands")
            self._end_errand("dropped")
            return
        self._begin([pose])

    def _on_emergency(self, pressed: bool, source: str) -> None:
        if self.controller is not None:
            self.controller.set_emergency(pressed, source)
        if self._stop_button.pressed:
            self.stop()
            self._end_errand("dropped")

    # Errands

    def _is_ready(self) -> bool:
        """Tell whether a goal would be driven to, and by nobody but us."""
        sound = self._mount.difference is None and not self.others.servers
        return self._active and not self._stop_button.pressed and sound

    def _begin(self, poses: list[PoseStamped], client: Client | None = None) -> None:
        """Head for other goals instead of the present ones."""
        self._end_errand("preempted")
        errand = Errand(poses, self._now(), client)
        if self._active and not self._stop_button.pressed:
            self._errand = errand
        else:
            errand.end(Outcome("dropped"))

    def _on_cancel(self, handle: ServerGoalHandle) -> None:
        errand = self._errand
        if errand is not None and errand.client is not None and errand.client.handle is handle:
            self._end_errand("canceled")

    def _end_errand(self, kind: str, status: Status | None = None) -> None:
        errand, self._errand = self._errand, None
        if self.controller is None:
            return
        self.controller.cancel()
        if errand is not None:
            outcome = outcome_of(kind, status, self.controller.failure)
            errand.end(outcome)
            self.get_logger().info(f"goal: {outcome}")

    # Control

    def _control(self) -> None:
        """Make one control step: this is the timer's callback."""
        began, now = time.perf_counter(), self._now()
        self._hold_for_others()
        transform_age = self._place_goals(now)
        driving = self._errand is not None
        self._status = status = self.controller.step(now, transform_age)
        self._tell(status.verdict.command, driving or self._stop_button.pressed)
        self._timing.note(now, time.perf_counter() - began)
        if Reason.CLOCK_JUMP in status.verdict.reasons:
            self._buffer.clear()
        self._follow_errand(status, now)
        self._report(now)

    def _hold_for_others(self) -> None:
        """Let the robot stand for what only this node sees."""
        hold, exclusive = self.controller.supervisor.hold, bool(self._value("exclusive"))
        if exclusive and self._errand is not None:
            self.others.look_for_publishers()
        hold(Reason.SECOND_PUBLISHER, exclusive and bool(self.others.publishers))
        hold(Reason.WRONG_MOUNT, self._mount.difference is not None)

    def _place_goals(self, now: float) -> float:
        """Keep the goals where their frame has them; return the transform's age [s]."""
        errand = self._errand
        if errand is None:
            return 0.0
        if not errand.locate(self._frames, self._buffer):
            return math.inf
        goals, stamp = errand.goals(self._frames, self._buffer)
        if goals is None:
            return math.inf
        if errand.begun:
            self.controller.move_goals(goals)
        else:
            self.controller.set_goals(goals)
            errand.begun = True
        return errand.transform_age(stamp, now, self.get_clock().now().nanoseconds * 1e-9)

    def _follow_errand(self, status: Status, now: float) -> None:
        """End the errand when it is done, or when nobody waits for it any more."""
        errand = self._errand
        if errand is None:
            return
        # The clock may have gone back.
        errand.elapsed = abs(now - errand.started)
        waited = errand.elapsed > float(self._value("goal_patience_s"))
        if errand.begun:
            errand.remaining = status.remaining
        if status.arrived and status.remaining == 0:
            self._end_errand("arrived")
        elif status.dropped or (waited and not errand.begun):
            self._end_errand("dropped", status)

    def _tell(self, command: Command, driving: bool) -> None:
        """Publish a command while it is our turn."""
        if self._turn.is_ours(driving, time.monotonic()):
            self._publish(command)
        if self._watchdog is not None:
            self._watchdog.feed(driving)

    def _publish(self, command: Command) -> None:
        stamp, frame = self.get_clock().now().to_msg(), str(self._value("base_frame"))
        self._commands.publish(command_message(self._kind, command, stamp, frame))

    def stop(self) -> None:
        """Tell the robot to stop, if there is anybody to tell it."""
        if self._commands is not None:
            self._publish(STOP)

    # Reports

    def _report(self, now: float) -> None:
        """Tell the action's client, and RViz."""
        status, controller, errand = self._status, self.controller, self._errand
        stamp = self.get_clock().now().to_msg()
        if errand is not None and errand.client is not None:
            pose, left = controller.supervisor.pose(now), controller.distance_left(now)
            errand.client.tell(errand, (stamp, self._frames.odometry), pose, left)
        if self._value("publish_markers") and self._markers.get_subscription_count() > 0:
            text = "; ".join(reason.value for reason in status.verdict.reasons) or "driving"
            frames = (self._frames.odometry, str(self._value("base_frame")))
            lines, goal = controller.beams(), controller.goal
            self._markers.publish(markers(stamp, frames, lines, goal, text))

    def _diagnose(self) -> None:
        self.others.look()
        notes = {
            "policy": str(self._value("policy")),
            "policy_failure": self.controller.failure or "",
            "advice": self.controller.supervisor.advice or "",
            "lidar_mount": self._mount.state,
            "second_publishers": " ".join(self.others.publishers) if self._errand else "",
            "other_servers": self.others.shared_actions or "",
        }
        if notes["advice"]:
            self.get_logger().warning(notes["advice"], throttle_duration_sec=10.0)
        stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostics(stamp, self._status, self._timing, notes))


def main() -> None:
    """Run the node until it is told to end; the robot then stands."""
    with ros():
        node = PolicyNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        try:
            if node.get_parameter("autostart").value and not autostarted(node, executor):
                raise SystemExit(1)
            spin(node, executor)
        finally:
            node.stop()
            # Without leave-taking others would go on seeing it for DDS's lease.
            node.destroy_node()


def autostarted(node: PolicyNode, executor: SingleThreadedExecutor) -> bool:
    """Configure and activate a node; tell whether that worked."""
    if node.trigger_configure() != SUCCESS:
        return False
    began = time.monotonic()
    # Time for others, tf and a first scan to be seen: what is wrong with them is said at once. A
    # node that is started anew waits until nothing is left of the one before.
    while time.monotonic() - began < (LEASE_S if node.others.sees_namesake() else DISCOVERY_S):
        executor.spin_once(timeout_sec=0.05)
    return node.trigger_activate() == SUCCESS
