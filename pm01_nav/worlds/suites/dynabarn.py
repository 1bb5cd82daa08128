# SPDX-License-Identifier: Apache-2.0
"""The DynaBARN worlds, from their JSON file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.dynabarn import read_dynabarn
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.suites.registry import Wanted, world_source

SUCCESS = 0.125
"""What the challenge's script gives for any success: it takes the way's length for -31 m."""


def as_published(success: NDArray[np.bool_]) -> dict[str, float]:
    """Return the mean score as the challenge's script has it."""
    return {"dynabarn_score_as_published": SUCCESS * float(success.mean())}


@world_source(path="worlds", stand_in="dynabarn_like", figures=as_published)
def dynabarn(wanted: Wanted, worlds: str) -> WorldPool:
    """Read the worlds in the JSON file ``worlds``."""
    # As in the challenge, each run begins at the beginning of the obstacles' tracks.
    radius = wanted.footprint.inscribed_radius
    return build_pool(read_dynabarn(worlds), radius, random_phase=False)
