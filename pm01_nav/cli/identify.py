# SPDX-License-Identifier: Apache-2.0
"""``pm01 identify``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pm01_nav.deploy.identification import Identification


@click.command("identify", short_help="Measure a robot from a recorded drive.")
@click.argument("bag", metavar="BAG")
@click.option("-o", "--output", required=True, metavar="FILE", help="The robot's .yaml to write.")
@click.option("--robot", default="pm01", show_default=True, metavar="NAME|FILE")
@click.option("--scan", default="/scan", show_default=True, metavar="TOPIC")
@click.option("--odom", default="/odom", show_default=True, metavar="TOPIC")
@click.option("--cmd-vel", default="/cmd_vel", show_default=True, metavar="TOPIC")
@click.option("--plot", metavar="FILE", help="A .png of measured and predicted speeds.")
def command(
    bag: str,
    output: str,
    robot: str,
    scan: str,
    odom: str,
    cmd_vel: str,
    plot: str | None,
) -> None:
    """Fit lag, delay, accelerations, wheels and the lidar's errors to a drive, with 95 % intervals.

    BAG is a rosbag2 folder, SQLite or MCAP, with /cmd_vel, /odom and /scan of a drive with many
    steps of speed, turns to both sides and rests:

    \b
      pm01 drive excite --robot my_robot.yaml --dds --goal 100 0 --record drive
      pm01 identify drive --robot my_robot.yaml -o my_robot_identified.yaml
      pm01 train --task static --robot my_robot_identified.yaml \\
          --randomization my_robot_identified_ranges.yaml

    It writes the robot, and beside it FILE_ranges.yaml for --randomization.
    """
    from pathlib import Path

    from rich.console import Console

    from pm01_nav.config import check_output, to_yaml, write_atomically
    from pm01_nav.deploy.identification import identified_ranges, identified_robot, identify
    from pm01_nav.deploy.recording import read_recording
    from pm01_nav.errors import InputError
    from pm01_nav.robot import load_robot

    path = Path(output)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{output}: must end in .yaml")
    ranges = path.with_name(f"{path.stem}_ranges.yaml")
    check_output(path)
    check_output(ranges)
    if plot is not None:
        _check_plot(plot)
    spec = load_robot(robot)
    found = identify(read_recording(bag, scan=scan, odometry=odom, command=cmd_vel), spec)
    _print(found, Console())
    origin = f"# Identified from {Path(bag).name} by pm01 identify.\n"
    write_atomically(path, origin + to_yaml(identified_robot(spec, found.estimates)))
    text = to_yaml(identified_ranges(spec, found.estimates))
    write_atomically(ranges, origin + text)
    click.echo(f"wrote {path} and {ranges}")
    if plot is not None:
        from pm01_nav.rendering.identification_plot import save_identification_plot

        save_identification_plot(found.base.times, found.base.measured, found.base.predicted, plot)
        click.echo(f"wrote {plot}")


def _check_plot(plot: str) -> None:
    from pm01_nav.config import check_output
    from pm01_nav.errors import InputError

    if not plot.lower().endswith(".png"):
        raise InputError(f"plot = {plot}: must end in .png")
    check_output(plot, "plot")


def _print(found: Identification, console: object) -> None:
    from rich.console import Console
    from rich.table import Table

    assert isinstance(console, Console)
    table = Table("quantity", "estimate", "95 % interval")
    for name, estimate in found.estimates.items():
        table.add_row(name, f"{estimate.value:.4g}", f"{estimate.low:.4g} to {estimate.high:.4g}")
    console.print(table)
    for name in found.base.estimates.keys() - found.estimates.keys():
        console.print(f"{name}: the drive never reached it, or not clearly")
