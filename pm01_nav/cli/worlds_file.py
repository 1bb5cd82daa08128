# SPDX-License-Identifier: Apache-2.0
"""``pm01 worlds show`` and ``export`` for a world or map of a person's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pm01_nav.cli.options import region_option, sdf_options

if TYPE_CHECKING:
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.worlds.pool import WorldPool


LEAST_WORTH_SAYING = 0.1
"""Less free space that is left out is not mentioned [m²]."""


def file_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that say how a file is read."""
    for option in (*reversed(sdf_options), region_option):
        command = option(command)
    return command


def is_file(source: str, options: dict[str, Any]) -> bool:
    """Tell whether ``source`` is a file, not the name of a suite.

    Raises:
        InputError: it is neither, or a suite is given ``options`` that are for files.
    """
    from pm01_nav.errors import InputError
    from pm01_nav.worlds.suites import suites

    if source not in suites():
        if Path(source).suffix or Path(source).exists():
            return True
        allowed = ", ".join(suites())
        raise InputError(f"suite = {source!r}: unknown; allowed: {allowed}, or a world's file")
    for name, value in options.items():
        if value:
            raise InputError(f"--{name}: is for a file, not for the suite {source}")
    return False


def own_task(path: str, **options: Any) -> TaskConfig:
    """Return the task of driving in a file's world, with ``options`` that are keys of the task.

    Raises:
        InputError: an option is not allowed.
    """
    from pm01_nav.config import validate
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.task.tasks import task_config

    given = {key: value for key, value in options.items() if value not in (None, ())}
    return validate(TaskConfig, task_config("map").model_dump() | {"map": path} | given, "options")


def show_file(config: TaskConfig, seed: int, output: str) -> None:
    """Draw a file's world, and say how much of it a robot can use.

    Raises:
        InputError: the file is unusable, or the output cannot be written to.
    """
    from pm01_nav.rendering.own_world import draw_own_world
    from pm01_nav.rendering.sheet import COLORS, save_sheet
    from pm01_nav.task.worlds import world_pool

    pool = world_pool(config, "held_out", 1)
    save_sheet(draw_own_world(pool, seed).quantize(COLORS), output)
    for line in _facts(config, pool):
        click.echo(line)
    click.echo(f"wrote {output}")


def _facts(config: TaskConfig, pool: WorldPool) -> list[str]:
    """Say where the world lies, what stands in it, and where the robot gets to."""
    import numpy as np

    from pm01_nav.rendering.own_world import split_free

    world, space = pool.worlds[0], pool.free_space(0)
    reached, left_out = split_free(pool)
    cell = space.resolution**2
    x_min, y_min, x_max, y_max = world.bounds
    counts = {
        "discs": len(world.discs),
        "polygons": len(world.polygons),
        "thin walls": len(world.segments),
        "movers": len(world.movers),
    }
    things = [f"{count} {name}" for name, count in counts.items() if count]
    things += ["a map"] if world.grid is not None else []
    lines = [
        f"drives in x {x_min:g} to {x_max:g} m, y {y_min:g} to {y_max:g} m",
        f"holds {', '.join(things) or 'no obstacles'}",
        f"{config.robot} needs {pool.radius:.2f} m around its centre: starts and goals lie in "
        f"{reached.sum() * cell:.1f} m²",
    ]
    if left_out.sum() * cell >= LEAST_WORTH_SAYING:
        regions = np.where(left_out, space.regions(), 0)
        sizes = np.bincount(regions.ravel())[1:]
        rows, columns = np.nonzero(regions == sizes.argmax() + 1)
        places, half = space.centre(rows, columns), space.resolution / 2.0
        corners = *(places.min(axis=0) - half), *(places.max(axis=0) + half)
        region = " ".join(f"{value:.1f}" for value in corners)
        lines.append(
            f"not connected: {left_out.sum() * cell:.1f} m², pieces: {np.count_nonzero(sizes)}; "
            f'the largest, {sizes.max() * cell:.1f} m², lies within "{region}"'
        )
    return lines


def export_file(config: TaskConfig, output: str, format_: str, resolution: float) -> None:
    """Write a file's world in another format.

    Raises:
        InputError: the file is unusable, or the output is the file itself or cannot be written to.
    """
    from pm01_nav.errors import InputError
    from pm01_nav.worlds.files import read_world, write_world
    from pm01_nav.worlds.region import drive_within

    source, target = Path(config.map or ""), Path(output)
    if source.exists() and target.exists() and source.samefile(target):
        raise InputError(f"output = {output}: is the file that is read")
    world = read_world(source, model_folders=config.models, partial=config.partial)
    write_world(drive_within(world, config.region), target, format_, resolution=resolution)
    click.echo(f"wrote {output}")
