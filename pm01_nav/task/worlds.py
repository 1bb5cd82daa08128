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
from pm01_nav.worlds.reading import Reading, tell
from pm01_nav.worlds.region import drive_within, starts_outside
from pm01_nav.worlds.suites import SUITES
from pm01_nav.worlds.world import World

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
    if config.suite == "map":
        return own_world_pool(config)
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
    radius = _radius(config)
    seeds = world_seeds(split, first + count, seed)[first:]
    return suite_pool(config.suite, seeds, radius, config.suite_params)


def own_world_pool(config: TaskConfig) -> WorldPool:
    """Read the world of ``config.map``; warn if episodes start outside of what walls enclose.

    Raises:
        InputError: the file is unusable, or no way leads to a goal.
    """
    world = _whole_world(config)
    pool = build_pool([_part(world, config)], _radius(config))
    if (warning := starts_outside(world, pool.arrays.starts)) is not None:
        tell(Reading(world, (warning,)))
    return pool


def own_world(config: TaskConfig) -> World:
    """Read the world of ``config.map``, with ``config.region`` as its bounds if there is one.

    Raises:
        InputError: the file or the region is unusable.
    """
    return _part(_whole_world(config), config)


def _whole_world(config: TaskConfig) -> World:
    path = _required(config.map, "map")
    return read_world(path, model_folders=config.models, partial=config.partial)


def _part(world: World, config: TaskConfig) -> World:
    return world if config.region is None else drive_within(world, config.region)


def _radius(config: TaskConfig) -> float:
    """Return how much room the robot and its margin need around its centre [m]."""
    return config.robot_spec().footprint.circumscribed_radius + config.margin


def world_seeds(split: Split, count: int, seed: int) -> range:
    """Return the world seeds that a run with ``seed`` draws from: even to train, odd held out."""
    first = 2 * seed * SEEDS_PER_RUN + (split == "held_out")
    return range(first, first + 2 * count, 2)


def _required(path: str | None, name: str) -> str:
    if path is None:
        raise InputError(f"{name}: this task needs it; give --{name} PATH")
    return path
