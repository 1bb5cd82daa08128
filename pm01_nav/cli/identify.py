# SPDX-License-Identifier: Apache-2.0
"""``pm01 identify``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console

    from pm01_nav.deploy.identification import Identification
    from pm01_nav.deploy.recording import Recording


@click.command("identify", short_help="Measure a robot from a recorded drive.")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@click.option("-o", "--output", required=True, metavar="FILE", help="The robot's .yaml to write.")
@click.option("--robot", default="pm01", show_default=True, metavar="NAME|FILE")
@click.option("--scan", default="/scan", show_default=True, metavar="TOPIC|none")
@click.option("--odom", default="/odom", show_default=True, metavar="TOPIC")
@click.option("--cmd-vel", default="/cmd_vel", show_default=True, metavar="TOPIC")
@click.option("--from", "begin", type=float, metavar="S", help="Leave out what is before.")
@click.option("--to", "end", type=float, metavar="S", help="And after: seconds of each bag.")
@click.option("--plot", metavar="FILE", help="A .png of measured and predicted speeds.")
def command(
    bags: tuple[str, ...],
    output: str,
    robot: str,
    plot: str | None,
    **source: Any,
) -> None:
    """Fit lag, delay, accelerations, wheels and the lidar's errors to a drive, with 95 % intervals.

    BAG is a rosbag2 folder, an .mcap or .db3 file, or a ROS 1 .bag, with /cmd_vel (Twist or
    TwistStamped), /odom and /scan of a drive with many steps of speed, turns to both sides and
    rests. Several bags must be of one robot; --scan none does without scans.

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
    from pm01_nav.deploy.excitation import check_identifiable
    from pm01_nav.deploy.identification import (
        described,
        identified_ranges,
        identified_robot,
        identify,
    )
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
    check_identifiable(spec)
    recordings = [_read(bag, **source) for bag in bags]
    found = identify(recordings, spec)
    origin = f"# Identified from {', '.join(Path(bag).name for bag in bags)} by pm01 identify.\n"
    # Both are made and checked before either is written.
    texts = {
        path: origin + to_yaml(identified_robot(spec, found.estimates)),
        ranges: origin + to_yaml(identified_ranges(spec, found.estimates)),
    }
    _print(found, described(spec), [one.begin for one in recordings], Console())
    for file, text in texts.items():
        write_atomically(file, text)
    click.echo(f"wrote {path} and {ranges}")
    if plot is not None:
        from pm01_nav.rendering.identification_plot import save_identification_plot

        base = found.base
        save_identification_plot(base.times, base.measured, base.predicted, base.used, plot)
        click.echo(f"wrote {plot}")


def _read(
    bag: str, scan: str, odom: str, cmd_vel: str, begin: float | None, end: float | None
) -> Recording:
    from pm01_nav.deploy.recording import read_recording

    topics = {"scan": scan, "odometry": odom, "command": cmd_vel}
    return read_recording(bag, **topics, begin=begin, end=end)


def _check_plot(plot: str) -> None:
    from pm01_nav.config import check_output
    from pm01_nav.errors import InputError

    if not plot.lower().endswith(".png"):
        raise InputError(f"plot = {plot}: must end in .png")
    check_output(plot, "plot")


def _print(
    found: Identification, described: dict[str, float], begins: list[float], console: Console
) -> None:
    from rich.table import Table

    table = Table("quantity", "estimate", "95 % interval")
    for name, estimate in found.estimates.items():
        table.add_row(name, f"{estimate.value:.4g}", f"{estimate.low:.4g} to {estimate.high:.4g}")
    console.print(table)
    for name, reason in found.not_shown.items():
        value = f" ({described[name]:g})" if name in described else ""
        console.print(f"{name}: not shown by the drive, left as described{value}: {reason}")
    for drive, begin, end, reason in found.base.segments:
        number = f"bag {drive + 1}, " if len(begins) > 1 else ""
        times = f"{begin - begins[drive]:.1f} to {end - begins[drive]:.1f} s"
        console.print(f"left out: {number}{times}: {reason}")
    if found.base.spikes:
        console.print(f"left out: {found.base.spikes} single odometries that are far out")
