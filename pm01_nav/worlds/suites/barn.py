# SPDX-License-Identifier: Apache-2.0
"""The worlds of the BARN challenge, from the unpacked dataset."""

from __future__ import annotations

from pm01_nav.worlds.barn import load_barn
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.suites.registry import Wanted, world_source


@world_source(path="worlds", stand_in="barn_like")
def barn(wanted: Wanted, worlds: str) -> WorldPool:
    """Read the BARN dataset in the folder ``worlds``."""
    return build_pool(load_barn(worlds).worlds, wanted.footprint.inscribed_radius)
