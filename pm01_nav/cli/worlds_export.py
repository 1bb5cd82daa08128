# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds export``."""

from __future__ import annotations

from typing import Any

import click

from pm01_nav.cli.worlds_file import export_file, file_options, is_file, own_task


@click.command("export", short_help="Write a world as YAML, ROS map, SDF or MJCF.")
@click.argument("source", metavar="SUITE|FILE")
@click.option("--seed", default=0, show_default=True, help="Which of the held-out worlds, from 0.")
@click.option(
    "--format",
    "format_",
    required=True,
    metavar="FORMAT",
    help="yaml (ours), map (ROS map server), sdf (Gazebo) or mjcf (MuJoCo).",
)
@click.option(
    "--resolution", default=0.05, show_default=True, help="Side of a map's cell [m], for map."
)
@file_options
@click.option("-o", "--output", required=True, metavar="FILE", help="The file to write.")
def export(
    source: str, seed: int, format_: str, resolution: float, output: str, **options: Any
) -> None:
    """Write one generated world of SUITE, or the own world or map in FILE, to a file.

    Of a SUITE it is the held-out world with the number --seed, the same that `pm01 evaluate`
    drives in for the suite's own task and robot. A map's image, or the map of a YAML world with a
    grid, goes beside it.

    \b
      pm01 worlds export static --seed 1 --format sdf -o static_1.sdf
      pm01 worlds export office.yaml --format sdf -o office.sdf
    """
    from pm01_nav.errors import InputError
    from pm01_nav.task.tasks import task_config
    from pm01_nav.task.worlds import SEEDS_PER_RUN, world_pool
    from pm01_nav.worlds.files import write_world

    if is_file(source, options):
        export_file(own_task(source, **options), output, format_, resolution)
        return
    if not 0 <= seed < SEEDS_PER_RUN:
        raise InputError(f"seed = {seed}: must be 0 to {SEEDS_PER_RUN - 1}")
    # A draw that the robot cannot cross is drawn again, so the robot has a say in the world.
    (world,) = world_pool(task_config(source), "held_out", 1, first=seed).worlds
    write_world(world, output, format_, resolution=resolution)
    click.echo(f"wrote {output}")
