# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds``."""

from __future__ import annotations

from typing import Any

import click

from pm01_nav.cli.tables import TableGroup
from pm01_nav.cli.worlds_export import export
from pm01_nav.cli.worlds_file import file_options, is_file, own_task, show_file


@click.group(
    "worlds", cls=TableGroup, short_help="Look at generated and own worlds, or write one to a file."
)
def command() -> None:
    """Look at the worlds of a suite or at an own one, or write one for another simulator.

    A suite is a family of generated worlds: {suites}.
    """


@command.command("show")
@click.argument("source", metavar="SUITE|FILE")
@click.option(
    "--seed",
    type=click.IntRange(0, 2**31 - 1),
    default=1,
    show_default=True,
    help="Chooses the held-out worlds, as in `pm01 evaluate`.",
)
@click.option(
    "--count", type=click.IntRange(1, 100), default=12, show_default=True, help="How many worlds."
)
@click.option("--robot", metavar="NAME|FILE", help="The robot that must fit, for a FILE.")
@file_options
@click.option("-o", "--output", required=True, metavar="FILE", help="The .png to write.")
def show(source: str, seed: int, count: int, output: str, **options: Any) -> None:
    """Draw a sheet of held-out worlds of SUITE, or the own world or map in FILE.

    Of a FILE (a ROS map's YAML, our YAML, SDF) it says what was read of it and what was left out;
    green is where starts and goals lie, red what is free but not connected to them.

    
      pm01 worlds show rooms --seed 5 -o sheet.png
      pm01 worlds show office.yaml -o office.png

    Orange dots are starts, purple rings goals; between them runs the shortest way for the robot
    of the task with the suite's name. What moves is blue-green, with its way and an arrow as long
    as what it covers in 1.5 s.
    """
    from pm01_nav.rendering.sheet import draw_sheet, save_sheet
    from pm01_nav.task.tasks import task_config
    from pm01_nav.task.worlds import world_pool

    if is_file(source, options):
        show_file(own_task(source, **options), seed, output)
        return
    pool = world_pool(task_config(source), "held_out", count, seed)
    save_sheet(draw_sheet(pool, seed), output)
    click.echo(f"wrote {output}")


command.add_command(export)
