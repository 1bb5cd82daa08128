# SPDX-License-Identifier: Apache-2.0
"""``pm01 record``."""

from __future__ import annotations

import click


@click.command("record", short_help="Record a simulated drive as MCAP.")
@click.argument("policy", metavar="POLICY.onnx|excite")
@click.option("-o", "--output", required=True, metavar="FOLDER", help="A new rosbag2 folder.")
@click.option("--world", default="static", show_default=True, metavar="SUITE|FILE")
@click.option("--robot", metavar="NAME|FILE", help="[default: the policy's own, or pm01]")
@click.option("--seconds", default=120.0, show_default=True, metavar="S")
@click.option("--seed", default=0, show_default=True)
@click.option(
    "--randomization",
    default="off",
    show_default=True,
    metavar="off|on|FILE",
    help="What is wrong with the robot.",
)
def command(
    policy: str,
    output: str,
    world: str,
    robot: str | None,
    seconds: float,
    seed: int,
    randomization: str,
) -> None:
    """Drive in the simulator, from goal to goal or as ``excite`` does, and record it.

    \b
      pm01 record policy.onnx -o drive --seconds 60
      ros2 bag info drive          # or open drive/*.mcap in Foxglove
      pm01 record excite -o excited --randomization on
      pm01 identify excited -o identified.yaml
    """
    from pm01_nav.deploy.assembly import load_controller
    from pm01_nav.deploy.recording import Recorder
    from pm01_nav.deploy.simulated_robot import drive_simulated, simulated_robot

    if policy == "excite" and robot is None:
        robot = "pm01"
    controller = load_controller(policy, robot, same_clock=True)
    sim = simulated_robot(world, controller.robot, seed=seed, dt=0.02, randomization=randomization)
    recorder = Recorder(output, controller.axes)
    try:
        arrived = drive_simulated(controller, sim, seconds, recorder)
    finally:
        recorder.close()
    click.echo(f"wrote {output}: {seconds:g} s, {arrived} goals, {sim.collisions} collisions")
