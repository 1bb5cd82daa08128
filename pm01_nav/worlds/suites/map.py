# SPDX-License-Identifier: Apache-2.0
"""A world of one's own, from a file."""

from __future__ import annotations

from pm01_nav.worlds.files import read_world
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.reading import Reading, tell
from pm01_nav.worlds.region import drive_within, starts_outside
from pm01_nav.worlds.suites.registry import Wanted, world_source


@world_source(path="map")
def map(
    wanted: Wanted,
    map: str,
    models: tuple[str, ...],
    partial: bool,
    region: tuple[float, float, float, float] | None,
) -> WorldPool:
    """Read the world in the file ``map``; warn if episodes start outside of what walls enclose.

    Raises:
        InputError: the file or the region is unusable, or no way leads to a goal.
    """
    world = read_world(map, model_folders=models, partial=partial)
    pool = build_pool([drive_within(world, region)], wanted.radius)
    if (warning := starts_outside(world, pool.arrays.starts)) is not None:
        tell(Reading(world, (warning,)))
    return pool
