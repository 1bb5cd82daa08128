# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds``."""

from __future__ import annotations

import click

from pm01_nav.cli.worlds_export import export


@click.group("worlds", short_help="Look at generated worlds, or write one to a file.")
def command() -> None:
    """Look at the worlds of a suite, or write one for another simulator.

    A suite is a family of generated worlds: empty, static, article, barn_like, dynabarn_like,
    corridors, rooms, maze, u_traps, crowd, warehouse, or mixed, which draws from most of them.
    """


@command.command("show")
@click.argument("suite")
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
@click.option("-o", "--output", required=True, metavar="FILE", help="The .png to write.")
def show(suite: str, seed: int, count: int, output: str) -> None:
    """Draw a sheet of held-out worlds of SUITE.

    Orange dots are starts, purple rings goals; between them runs the shortest way for the robot
    of the task with the suite's name. What moves is blue-green, with its way and an arrow as long
    as what it covers in 1.5 s.
    """
    from pm01_nav.errors import InputError
    from pm01_nav.rendering.sheet import draw_sheet, save_sheet
    from pm01_nav.task.tasks import task_config
    from pm01_nav.task.worlds import world_pool
    from pm01_nav.worlds.suites import SUITES

    if suite not in SUITES:
        raise InputError(f"suite = {suite!r}: unknown; allowed: {', '.join(SUITES)}")
    pool = world_pool(task_config(suite), "held_out", count, seed)
    save_sheet(draw_sheet(pool, seed), output)
    click.echo(f"wrote {output}")


command.add_command(export)
