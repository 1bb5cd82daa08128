# SPDX-License-Identifier: Apache-2.0
"""Print what readers of worlds have to say, in the command line's own style."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import click


class _Lines(logging.Handler):
    """Print each line once on stderr, however often a command reads the file."""

    def __init__(self) -> None:
        super().__init__()
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self._said:
            self._said.add(text)
            prefix = "warning: " if record.levelno >= logging.WARNING else ""
            click.echo(prefix + text, err=True)


@contextmanager
def notes_shown() -> Iterator[None]:
    """Print what ``pm01_nav.worlds`` logs while a command runs."""
    logger = logging.getLogger("pm01_nav.worlds")
    level, propagate, lines = logger.level, logger.propagate, _Lines()
    logger.setLevel(logging.INFO)
    logger.propagate = False
    logger.addHandler(lines)
    try:
        yield
    finally:
        logger.removeHandler(lines)
        logger.setLevel(level)
        logger.propagate = propagate
