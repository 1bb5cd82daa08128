# SPDX-License-Identifier: Apache-2.0
"""The worlds a task is trained and evaluated in."""

from __future__ import annotations

from typing import Literal

from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.worlds.barn import load_barn
from pm01_nav.worlds.dynabarn import read_dynabarn
from pm01_nav.worlds.files import read_world
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.pool_cache import suite_pool
from pm01_nav.worlds.suites import SUITES

Split = Literal["train", "held_out"]
FILE_SUITES = ("map", "barn", "dynabarn")
SEEDS_PER_RUN = 1 << 20
"""World seeds set aside for each run seed, so that no two runs share worlds."""


def world_pool(
    config: TaskConfig, split: Split, count: int, seed: int = 0, *, first: int = 0
) -> WorldPool:
    """Make or read worlds for a task.

    Generated worlds of the two splits never share a seed; ``seed`` chooses among those of a
    split, and the first of them can be left out. Worlds from files are the same in both splits
    and ``count`` and ``first`` do not apply.

    Raises:
        InputError: the suite is unknown, its files are unusable, or no way leads to a goal.
    """
    radius = config.robot_spec().footprint.circumscribed_radius + config.margin
    if config.suite == "map":
        world = read_world(
            _required(config.map, "map"), model_folders=config.models, partial=config.partial
        )
        return build_pool([world], radius)
    if config.suite == "barn":
        inscribed = config.robot_spec().footprint.inscribed_radius
        return build_pool(load_barn(_required(config.worlds, "worlds")).worlds, inscribed)
    if config.suite == "dynabarn":
        inscribed = config.robot_spec().footprint.inscribed_radius
        worlds = read_dynabarn(_required(config.worlds, "worlds"))
        # As in the challenge, each run begins at the beginning of the obstacles' tracks.
        return build_pool(worlds, inscribed, random_phase=False)
    if config.suite not in SUITES:
        allowed = ", ".join(sorted([*SUITES, *FILE_SUITES]))
        raise InputError(f"suite = {config.suite!r}: unknown; allowed: {allowed}")
    seeds = world_seeds(split, first + count, seed)[first:]
    return suite_pool(config.suite, seeds, radius, config.suite_params)


def world_seeds(split: Split, count: int, seed: int) -> range:
    """Return the world seeds that a run with ``seed`` draws from: even to train, odd held out."""
    first = 2 * seed * SEEDS_PER_RUN + (split == "held_out")
    return range(first, first + 2 * count, 2)


def _required(path: str | None, name: str) -> str:
    if path is None:
        raise InputError(f"{name}: this task needs it; give --{name} PATH")
    return path
