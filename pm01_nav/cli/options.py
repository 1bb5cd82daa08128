# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share, and the task they describe together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pm01_nav.cli.tables import TableOption

if TYPE_CHECKING:
    from pm01_nav.task.config import TaskConfig

Command = Callable[..., Any]


def _four_numbers(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, ...] | None:
    """Turn "x0 y0 x1 y1" into numbers.

    Raises:
        InputError: these are not four numbers.
    """
    from pm01_nav.errors import InputError

    if text is None:
        return None
    try:
        numbers = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        numbers = ()
    if len(numbers) != 4:
        raise InputError(f"--region {text!r}: must be four numbers, x_min y_min x_max y_max [m]")
    return numbers


region_option = click.option(
    "--region",
    metavar='"X0 Y0 X1 Y1"',
    callback=_four_numbers,
    help="The part of an own world or map to drive in [m].",
)
sdf_options = (
    click.option(
        "--models",
        multiple=True,
        metavar="DIR",
        help="A folder with models that an SDF world includes (repeatable).",
    ),
    click.option(
        "--partial",
        is_flag=True,
        default=None,
        help="Take what can be read of an SDF world, even if most of it cannot.",
    ),
)


def task_options(command: Command) -> Command:
    """Add the options that choose a task."""
    for option in reversed(
        (
            click.option(
                "--task",
                metavar="NAME",
                cls=TableOption,
                help="Where to drive: {tasks}.",
            ),
            click.option(
                "--map",
                "map_",
                metavar="FILE",
                help="A ROS map's YAML, our YAML or an SDF world, for task map.",
            ),
            region_option,
            *sdf_options,
            click.option(
                "--worlds",
                metavar="PATH",
                help="The unpacked BARN dataset, for task barn, or the JSON file of DynaBARN.",
            ),
            click.option(
                "--robot",
                metavar="NAME|FILE",
                cls=TableOption,
                help="A robot by name ({robots}) or its YAML.",
            ),
            click.option(
                "--backend",
                metavar="NAME",
                cls=TableOption,
                help="What moves the robots: {backends}.  [default: planar]",
            ),
            click.option(
                "--config",
                "config_file",
                metavar="FILE",
                help="A YAML file such as a run's config.yaml; flags go over it.",
            ),
            click.option(
                "--set",
                "changes",
                multiple=True,
                metavar="KEY=VALUE",
                help="Change any key, e.g. --set task.goal_radius=0.5 (repeatable).",
            ),
        )
    ):
        command = option(command)
    return command


def episode_options(command: Command) -> Command:
    """Add the options that choose held-out episodes."""
    episodes = click.option("--episodes", type=click.IntRange(1), default=1000, show_default=True)
    seed = click.option(
        "--seed",
        type=click.IntRange(0, 2**31 - 1),
        default=1,
        show_default=True,
        help="Chooses the held-out worlds, starts and goals.",
    )
    return episodes(seed(command))


def ray_option(command: Command) -> Command:
    """Add the option that names a cluster."""
    text = "Use a Ray cluster: host:port, auto, or local, which starts one here."
    return click.option("--ray", "ray_address", metavar="ADDRESS", help=text)(command)


def randomization_option(command: Command) -> Command:
    """Add the option that says how far robots and sensors are from their description."""
    return click.option(
        "--randomization",
        metavar="off|on|FILE",
        help="What is wrong with robots and sensors in each episode: nothing, a draw from default "
        "ranges, or from those of a YAML file.  [default: off]",
    )(command)


def plan_options(command: Command) -> Command:
    """Add the options that lead a policy along a global plan."""
    look_ahead = click.option(
        "--look-ahead",
        type=click.FloatRange(0.0, min_open=True),
        metavar="METRES",
        help="How far ahead on the global plan the policy's goal lies. [default: 2]",
    )
    global_plan = click.option(
        "--global-plan",
        is_flag=True,
        help="The world is known: lead the policy along a way found on its map.",
    )
    return global_plan(look_ahead(command))


def parse_changes(changes: tuple[str, ...]) -> dict[str, Any]:
    """Turn ``a.b=value`` texts into nested mappings.

    Raises:
        InputError: a text has no ``=``, or its value is no YAML.
    """
    import yaml

    from pm01_nav.config import merge
    from pm01_nav.errors import InputError

    merged: dict[str, Any] = {}
    for text in changes:
        key, separator, value = text.partition("=")
        if not separator or not key:
            raise InputError(f"--set {text}: must look like task.goal_radius=0.5")
        try:
            tree: Any = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(f"--set {text}: the value is not valid YAML") from error
        for part in reversed(key.split(".")):
            tree = {part: tree}
        merged = merge(merged, tree)
    return merged


def task_from_options(
    base: TaskConfig | None,
    *,
    task: str | None,
    config_file: str | None,
    changes: tuple[str, ...],
    map_: str | None = None,
    **options: Any,
) -> TaskConfig:
    """Return the task that the options describe: name or ``base``, then file, then flags.

    The other ``options`` are those of ``chosen_task``.

    Raises:
        InputError: something is unknown or not allowed, or no task was named.
    """
    from pm01_nav.task.choice import chosen_task

    layers = (settings.get("task") or {} for settings in given_settings(config_file, changes))
    source = config_file or "configuration"
    return chosen_task(base, task, *layers, source=source, map=map_, **options)


def given_settings(config_file: str | None, changes: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return what a file says, and what ``--set`` says, which goes over it: ``task``, ``train``.

    Raises:
        InputError: the file is unreadable, or there are other sections.
    """
    from pm01_nav.documents import load_yaml
    from pm01_nav.task.given_files import located

    settings = load_yaml(config_file) if config_file else {}
    if config_file and isinstance(settings.get("task"), dict):
        settings["task"] = located(settings["task"], Path(config_file).parent)
    given = parse_changes(changes)
    _only_sections(settings, config_file or "--set")
    _only_sections(given, "--set")
    return [settings, given]


def _only_sections(settings: dict[str, Any], source: str) -> None:
    from pm01_nav.errors import InputError

    for key, value in settings.items():
        if key not in ("task", "train"):
            raise InputError(f"{source}: {key}: unknown key; allowed here: task, train")
        if not isinstance(value, dict):
            raise InputError(f"{source}: {key} = {value!r}: must be a mapping (key: value)")
