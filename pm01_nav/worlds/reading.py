# SPDX-License-Identifier: Apache-2.0
"""What a stranger's file became: a world, and what a person should know of it."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from pm01_nav.worlds.world import World

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Reading:
    """A world from a file."""

    world: World
    notes: tuple[str, ...] = ()
    """What was left out, or looks wrong: one line each, the most important first."""
    summary: str = ""
    """How much of the file was read, such as "lab.sdf: read 85 of 87 shapes"."""


def tell(reading: Reading) -> World:
    """Log what a person should know of a world, and return it.

    The summary is news, a note a warning: without a handler Python shows the notes alone.
    """
    if reading.summary:
        # With notes the share belongs in front of them, whoever listens.
        logger.log(logging.WARNING if reading.notes else logging.INFO, reading.summary)
    for note in reading.notes:
        logger.warning(note)
    return reading.world
