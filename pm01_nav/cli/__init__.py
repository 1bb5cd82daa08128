# SPDX-License-Identifier: Apache-2.0
"""The command line ``pm01``; each command lives in the module of its name."""

from __future__ import annotations

import importlib
import sys
import time
import warnings

STARTED_AT = time.perf_counter()
"""When the command began; a time budget counts from here, imports and all."""

try:
    import click
except ImportError:
    sys.stderr.write("error: the command line needs: pip install 'pm01-nav[train,viz]'\n")
    raise SystemExit(2) from None

from pm01_nav import __version__  # noqa: E402
from pm01_nav.errors import InputError, InputWarning  # noqa: E402
from pm01_nav.openmp import wait_briefly  # noqa: E402

wait_briefly()

COMMANDS = (
    "demo",
    "train",
    "sweep",
    "tune",
    "evaluate",
    "benchmark",
    "report",
    "export",
    "publish",
    "replay",
    "worlds",
    "robots",
    "drive",
    "record",
    "identify",
    "doctor",
)


class Commands(click.Group):
    """Load a command's module when it is asked for, so that ``pm01 --help`` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Name the commands in the order in which a newcomer needs them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        return importlib.import_module(f"pm01_nav.cli.{cmd_name}").command


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="pm01")
def pm01() -> None:
    """Train a wheeled robot with a 2D lidar to drive itself, measure it, take it to the robot.

    \b
    Start here:
      pm01 demo    a policy in a minute, measured and filmed
      pm01 train --task static --time-budget 60 --out runs/x
      pm01 evaluate runs/x --episodes 1000
      pm01 replay runs/x -o replay.mp4
    """


def main() -> None:
    """Run the command line; a mistake in the input ends it with one line and exit code 2."""
    warnings.formatwarning = _one_line
    try:
        pm01()
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        raise SystemExit(2) from None


def _one_line(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    line: str | None = None,
) -> str:
    """Show a warning about somebody's input without the line of our code that found it."""
    if issubclass(category, InputWarning):
        return f"warning: {message}\n"
    return _as_usual(message, category, filename, lineno, line)


_as_usual = warnings.formatwarning
