# SPDX-License-Identifier: Apache-2.0
"""The parts of which observations are made, by name; one's own are entered in the same way."""

from pm01_nav.task.parts import goal, motion, scan, trail
from pm01_nav.task.parts.base import (
    PARTS,
    Elapsed,
    Memory,
    ObservationPart,
    Seen,
    make_part,
    observation_part,
)

__all__ = [
    "PARTS",
    "Elapsed",
    "Memory",
    "ObservationPart",
    "Seen",
    "goal",
    "make_part",
    "motion",
    "observation_part",
    "scan",
    "trail",
]
