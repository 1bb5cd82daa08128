# SPDX-License-Identifier: Apache-2.0
"""``pm01 robots``."""

from __future__ import annotations

from typing import Any

import click


@click.group("robots", short_help="Show a robot, begin a new one, or import a URDF.")
def command() -> None:
    """Show a robot, begin a new one, or import one from a URDF.

    \b
      pm01 robots show turtlebot3_burger -o burger.png
      pm01 robots new my_robot.yaml
      pm01 robots import my_robot.urdf.xacro -o my_robot.yaml
      pm01 evaluate goal_seeking --task empty --robot my_robot.yaml
    """


@command.command("show")
@click.argument("robot", metavar="NAME|FILE")
@click.option("-o", "--output", metavar="FILE", help="A .png to draw the robot into.")
def show(robot: str, output: str | None) -> None:
    """Print what a robot is: one by name (pm01, jackal, ...) or its YAML.

    Behind each figure stands the comment of its line, which says where it came from, and below the
    table the comment at the head of the file, which says what an import left out.

    The picture shows it from above, x to the right: outline, wheels, and the lidar's beams from
    where it begins to see, beam 0 thick.
    """
    from rich.console import Console

    from pm01_nav.cli.display import robot_table
    from pm01_nav.robot import load_robot, robot_path
    from pm01_nav.robot_import import read_notes

    spec = load_robot(robot)
    with robot_path(robot) as path:
        notes = read_notes(path)
    Console().print(robot_table(spec, notes.by_key))
    for line in notes.head:
        click.echo(line)
    if output is not None:
        from pm01_nav.rendering.robot_sheet import draw_robot
        from pm01_nav.rendering.sheet import save_sheet

        save_sheet(draw_robot(spec), output)
        click.echo(f"wrote {output}")


force_option = click.option("--force", is_flag=True, help="Write over a file that exists.")


@command.command("new")
@click.argument("file")
@force_option
def new(file: str, force: bool) -> None:
    """Write a template with a comment on each line, to put one's own figures in.

    It loads as it is.
    """
    from pm01_nav.robot_import import new_robot_text, write_robot

    write_robot(file, new_robot_text(file), force=force)
    click.echo(f"wrote {file}")


@command.command("import")
@click.argument("file", metavar="FILE.urdf|FILE.xacro")
@click.argument("arguments", nargs=-1, metavar="[NAME:=VALUE]...")
@click.option("-o", "--output", required=True, metavar="FILE", help="The .yaml to write.")
@click.option(
    "--wheels",
    nargs=2,
    metavar="LEFT RIGHT",
    help="The joints of the driven wheels, where the file leaves a choice.",
)
@click.option(
    "--wheel-radius",
    type=click.FloatRange(0.0, min_open=True),
    metavar="METRES",
    help="Where no shape or readable mesh tells it.",
)
@click.option(
    "--footprint-radius",
    type=click.FloatRange(0.0, min_open=True),
    metavar="METRES",
    help="A circle in place of the outline of the shapes.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="LINK",
    help="Leave a link, an arm say, and all that it carries out of the footprint; may be repeated.",
)
@click.option("--lidar", metavar="NAME", help="The sensor or the link that is the lidar.")
@click.option(
    "--packages",
    multiple=True,
    metavar="DIR",
    help="Where ROS packages lie, for package:// and $(find ...); may be repeated.",
)
@force_option
def import_(
    file: str, arguments: tuple[str, ...], output: str, force: bool, **options: Any
) -> None:
    """Make a robot's YAML from the URDF of a differential-drive robot.

    A xacro file is expanded, with NAME:=VALUE as its arguments, if xacro is installed. Each figure
    gets a comment that says where it came from; check those marked as defaults. What was left out
    stands at the head.
    """
    from pm01_nav.robot_import import import_urdf, robot_text, write_robot

    robot = import_urdf(file, arguments=_arguments(arguments), **options)
    for warning in robot.warnings:
        click.echo(f"warning: {warning}", err=True)
    head = "\n".join(robot.warnings)
    write_robot(output, robot_text(robot.spec, robot.notes, head), force=force)
    click.echo(f"wrote {output}")


def _arguments(given: tuple[str, ...]) -> dict[str, str]:
    from pm01_nav.errors import InputError

    found = {}
    for text in given:
        name, sign, value = text.partition(":=")
        if not sign or not name:
            raise InputError(f"{text}: a xacro file's arguments are given as NAME:=VALUE")
        found[name] = value
    return found
