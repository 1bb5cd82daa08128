# SPDX-License-Identifier: Apache-2.0
"""``pm01 drive``."""

from __future__ import annotations

import signal
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from pm01_nav.deploy.controller import Status
    from pm01_nav.deploy.driver import Driver
    from pm01_nav.deploy.link import Link, Topics


@click.command("drive", short_help="Drive a robot by a policy, with or without ROS beside it.")
@click.argument("policy", metavar="POLICY.onnx")
@click.option("--dds", is_flag=True, help="Speak ROS 2's DDS directly.")
@click.option("--rosbridge", metavar="URL", help="Go through rosbridge, e.g. ws://127.0.0.1:9090.")
@click.option("--robot", metavar="NAME|FILE", help="[default: the one the policy was trained for]")
@click.option(
    "--goal",
    "goals",
    nargs=2,
    type=float,
    multiple=True,
    metavar="X Y",
    help="In the odometry frame [m]; repeat it for one after the other. Without it goals come from "
    "the topic goal_pose.",
)
@click.option("--yaw", type=float, metavar="RADIANS", help="Heading to turn to at the last --goal.")
@click.option("--goal-radius", type=click.FloatRange(0.0, min_open=True), metavar="METRES")
@click.option("--sim-time", is_flag=True, help="Time is what the topic clock says.")
@click.option("--stamped", is_flag=True, help="The base takes TwistStamped, not Twist.")
@click.option("--scan", "scan_topic", default="scan", show_default=True, metavar="TOPIC")
@click.option("--odom", "odometry_topic", default="odom", show_default=True, metavar="TOPIC")
@click.option("--cmd-vel", "command_topic", default="cmd_vel", show_default=True, metavar="TOPIC")
@click.option("--dds-domain", type=click.IntRange(0, 232), help="[default: ROS_DOMAIN_ID, or 0]")
@click.option(
    "--dds-address",
    default="127.0.0.1",
    show_default=True,
    metavar="IP",
    help="This machine's address on the robot's network.",
)
@click.option("--dds-peer", "peers", multiple=True, metavar="IP", help="The robot's address.")
@click.option("--record", "record_to", metavar="FOLDER", help="Write the drive as MCAP.")
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change the supervisor, e.g. --set padding=0.05 (repeatable).",
)
def command(policy: str, **options: Any) -> None:
    """Drive a robot by POLICY.onnx under the safety supervisor, until Ctrl-C; then it stands.

    A --goal that is given up (emergency stop, jump, ten seconds without data) ends it with code 1.

    \b
      pm01 drive policy.onnx --dds --goal 3 0
      pm01 drive policy.onnx --rosbridge ws://127.0.0.1:9090

    Without another address both stay on this machine.
    """
    from pm01_nav.deploy.assembly import load_controller
    from pm01_nav.deploy.driver import Driver
    from pm01_nav.deploy.goals import Goal
    from pm01_nav.errors import InputError

    controller = load_controller(
        policy,
        options["robot"],
        goal_radius=options["goal_radius"],
        safety=_safety(options["changes"]),
        same_clock=options["sim_time"],
    )
    goals = [Goal(x, y) for x, y in options["goals"]]
    if options["yaw"] is not None:
        if not goals:
            raise InputError("--yaw: is for the last --goal, and there is none")
        goals[-1] = replace(goals[-1], yaw=options["yaw"])
    link = _link(options)
    recorder = None
    if options["record_to"]:
        from pm01_nav.deploy.recording import Recorder

        recorder = Recorder(options["record_to"], controller.axes)
    driver = Driver(controller, link, sim_time=options["sim_time"], record=recorder)
    # Both let the loop end by itself, so that the last thing the robot hears is a stop.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: driver.end())
    show = _Printer(driver)
    try:
        driver.run(goals or None, show)
    finally:
        if recorder is not None:
            recorder.close()
    click.echo(f"{show.arrived} goals reached, {driver.steps} steps, {driver.late_steps} late")
    if show.arrived < len(goals):
        raise SystemExit(1)


def _safety(changes: tuple[str, ...]) -> Any:
    from pm01_nav.cli.options import parse_changes
    from pm01_nav.deploy.safety import SafetyConfig
    from pm01_nav.errors import InputError

    values = parse_changes(changes)
    for name, value in values.items():
        if name not in SafetyConfig.names():
            allowed = ", ".join(SafetyConfig.names())
            raise InputError(f"--set {name}: unknown key; allowed here: {allowed}")
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise InputError(f"--set {name} = {value!r}: must be a number")
    return SafetyConfig(**values)


def _link(options: dict[str, Any]) -> Link:
    from pm01_nav.deploy.link import Topics
    from pm01_nav.errors import InputError

    if options["dds"] == bool(options["rosbridge"]):
        raise InputError("drive: give one of --dds and --rosbridge URL")
    topics = Topics(
        scan=options["scan_topic"].strip("/"),
        odometry=options["odometry_topic"].strip("/"),
        command=options["command_topic"].strip("/"),
        stamped=options["stamped"],
    )
    return _dds(options, topics) if options["dds"] else _rosbridge(options["rosbridge"], topics)


def _dds(options: dict[str, Any], topics: Topics) -> Link:
    from pm01_nav.deploy.dds import DdsLink

    domain, address = options["dds_domain"], options["dds_address"]
    return DdsLink(topics, domain=domain, address=address, peers=options["peers"])


def _rosbridge(url: str, topics: Topics) -> Link:
    from pm01_nav.deploy.rosbridge import RosbridgeLink

    return RosbridgeLink(url, topics)


class _Printer:
    """Print what changes."""

    def __init__(self, driver: Driver) -> None:
        self.arrived = 0
        self._driver = driver
        self._last: tuple[str, ...] | None = None

    def __call__(self, status: Status) -> None:
        reasons = tuple(reason.value for reason in status.verdict.reasons)
        advice = self._driver.controller.supervisor.advice
        if advice is not None:
            reasons += (advice,)
        if self._driver.refused is not None:
            reasons += (f"refused: {self._driver.refused}",)
        if status.arrived:
            self.arrived += 1
            click.echo("arrived")
        elif status.dropped:
            failure = self._driver.controller.failure
            why = reasons + ((failure,) if failure else ())
            click.echo(f"goal given up: {'; '.join(why)}")
        elif reasons != self._last:
            what = "; ".join(reasons) or "driving"
            click.echo(f"{what} ({status.goal_distance:.2f} m to the goal)")
        self._last = reasons
