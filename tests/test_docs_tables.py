# SPDX-License-Identifier: Apache-2.0
"""Lists in the docs and in help texts name what the tables hold, no more and no less."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest
from click.testing import CliRunner

from pm01_nav.backends import BACKENDS
from pm01_nav.cli import pm01
from pm01_nav.cli.tables import TABLES, names_of
from pm01_nav.planners import PLANNERS
from pm01_nav.task.tasks import task_config, task_names
from pm01_nav.worlds.suites import SOURCES, suites

DOCS = Path(__file__).parents[1] / "docs"


def rows(page: str, heading: str) -> list[str]:
    """Return the rows of the table that begins with ``heading``."""
    lines = iter((DOCS / page).read_text(encoding="utf-8").splitlines())
    assert any(line.startswith(heading) for line in lines)
    next(lines)
    found = []
    for line in lines:
        if not line.startswith("|"):
            break
        found.append(line)
    return found


def first_cells(page: str, heading: str) -> set[str]:
    return {name for row in rows(page, heading) for name in names(row.split("|")[1])}


def names(text: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", text))


def option(name: str) -> set[str]:
    """Return what the guide lists for an option of ``pm01 train``."""
    (row,) = [r for r in rows("guide/train.md", "| option ") if r.startswith(f"| `{name}` |")]
    return names(row.split("|")[2])


def test_docs_list_the_tables():
    trainable = {n for n in task_names() if not SOURCES[task_config(n).suite].stand_in}
    assert first_cells("guide/worlds.md", "| task | worlds") == set(task_names())
    assert option("--task") == trainable
    assert option("--backend") == set(BACKENDS)
    assert first_cells("guide/evaluate.md", "| name | method") == set(PLANNERS)


def helped(*command: str) -> str:
    done = CliRunner().invoke(pm01, [*command, "--help"])
    assert done.exit_code == 0, done.output
    return done.output


def said(text: str, expected: Iterable[str]) -> None:
    assert set(re.findall(r"\w+", text)) >= set(expected)


@pytest.mark.parametrize("command", ["train", "evaluate", "benchmark", "worlds"])
def test_help_lists_the_tables(command: str):
    text = helped(command)
    assert "{" not in re.sub(r"\{\w+:", "", text)
    said(text, suites() if command == "worlds" else {*task_names(), *BACKENDS})
    if command in ("evaluate", "benchmark"):
        said(text, PLANNERS)
    assert helped(command) == text  # nothing was filled in for good


@pytest.mark.parametrize("table", TABLES)
def test_every_table_has_names(table: str):
    assert len(names_of(table).split(", ")) > 1
