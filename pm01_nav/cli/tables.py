# SPDX-License-Identifier: Apache-2.0
"""Help texts that name what a table holds, such as ``{tasks}``, read when the help is shown."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import click

TABLES = {
    "algorithms": ("training.algorithms", "ALGORITHMS"),
    "backends": ("backends", "BACKENDS"),
    "planners": ("planners", "PLANNERS"),
    "robots": ("robot", "robot_names"),
    "suites": ("worlds.suites", "suites"),
    "sweeps": ("benchmark.sweeps", "SWEEPS"),
    "tasks": ("task.tasks", "task_names"),
}
"""Modules of ``pm01_nav``, and what there is the table or returns its names."""


def names_of(table: str) -> str:
    """Return the names in a table, separated by commas."""
    module, attribute = TABLES[table]
    found: Any = getattr(import_module(f"pm01_nav.{module}"), attribute)
    return ", ".join(found if isinstance(found, dict) else found())


@contextmanager
def _names_filled_in(shown: Any) -> Iterator[None]:
    template = shown.help
    shown.help = re.sub(r"\{(\w+)\}", lambda match: names_of(match[1]), template)
    try:
        yield
    finally:
        shown.help = template


class TableOption(click.Option):
    """An option whose help names what a table holds."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Fill in the names."""
        with _names_filled_in(self):
            return super().get_help_record(ctx)


class TableCommand(click.Command):
    """A command whose help names what a table holds."""

    def format_help_text(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Fill in the names."""
        with _names_filled_in(self):
            super().format_help_text(ctx, formatter)


class TableGroup(TableCommand, click.Group):
    """A group whose help does."""
