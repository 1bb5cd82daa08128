# SPDX-License-Identifier: Apache-2.0
"""The table of world sources: what ``TaskConfig.suite`` may name.

A suite, under ``@suite``, draws as many worlds as are wanted. Any other source, such as a reader of
files, enters under ``@world_source`` and makes the pool itself.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pm01_nav.config import FrozenModel, validate
from pm01_nav.errors import InputError
from pm01_nav.robot import Footprint
from pm01_nav.worlds.pool import Generator, WorldPool
from pm01_nav.worlds.pool_cache import cached_pool
from pm01_nav.worlds.world import World

Draw = TypeVar("Draw", bound=Callable[..., World])
Build = TypeVar("Build", bound=Callable[..., WorldPool])


class Wanted(NamedTuple):
    """Which worlds a task wants, and for which body."""

    seeds: range
    """One for each world that is drawn."""
    footprint: Footprint
    margin: float
    """What starts, goals and a way between them keep free beside the footprint [m]."""

    @property
    def radius(self) -> float:
        """Radius of a disc that holds the robot and the margin [m]."""
        return self.footprint.circumscribed_radius + self.margin


class Suite(NamedTuple):
    """A family of generated worlds."""

    generator: Callable[..., World]
    """Draws a world from random numbers and, where some are given, from ``params``."""
    params: type[FrozenModel]
    """What can be fixed of its worlds; a task gives it as ``suite_params``."""
    frozen: str
    """``suite_hash`` of its held-out worlds; empty where nobody compares results on them."""

    @property
    def name(self) -> str:
        """The generator's own name."""
        return self.generator.__name__

    def variant(self, params: Mapping[str, float]) -> Generator:
        """Return the generator, with some parameters fixed if any are given.

        Raises:
            InputError: the suite has no such parameter, or a value is not allowed.
        """
        if not params:
            return self.generator
        chosen = validate(self.params, params, f"suite {self.name}", inside="suite_params")
        return partial(self.generator, params=chosen)

    def pool(self, wanted: Wanted, suite_params: Mapping[str, float]) -> WorldPool:
        """Draw one world for each seed, or read what was drawn before."""
        fixed = (f"{key}={value!r}" for key, value in sorted(suite_params.items()))
        name, code = " ".join([self.name, *fixed]), inspect.getfile(self.generator)
        return cached_pool(name, self.variant(suite_params), wanted.seeds, wanted.radius, code)


def _no_figures(_: NDArray[np.bool_]) -> dict[str, float]:
    return {}


class WorldSource(NamedTuple):
    """Where the worlds of a task come from."""

    build: Callable[..., WorldPool]
    """From what is ``Wanted`` and from ``keys``."""
    keys: tuple[str, ...]
    """Keys of ``TaskConfig`` that it reads: the names of the further parameters of ``build``."""
    path: str | None = None
    """The one of ``keys`` that names its files; None needs none."""
    held_out: bool = False
    """Whether each seed has a world of its own; else episodes visit the same worlds in turn."""
    stand_in: str | None = None
    """Where worlds are for testing only: the suite to train on instead."""
    figures: Callable[[NDArray[np.bool_]], dict[str, float]] = _no_figures
    """Figures of merit of its own, from the success of episodes, shape (n,)."""
    suite: Suite | None = None


SOURCES: dict[str, WorldSource] = {}


def suite(frozen: str = "", params: type[FrozenModel] = FrozenModel) -> Callable[[Draw], Draw]:
    """Enter a generator in the table under its own name; the rest is as in ``Suite``."""

    def enter(generator: Draw) -> Draw:
        made = Suite(generator, params, frozen)
        SOURCES[made.name] = WorldSource(made.pool, ("suite_params",), held_out=True, suite=made)
        return generator

    return enter


def world_source(**about: Any) -> Callable[[Build], Build]:
    """Enter a function in the table under its own name; ``about`` are fields of ``WorldSource``."""

    def enter(build: Build) -> Build:
        keys = tuple(inspect.signature(build).parameters)[1:]
        SOURCES[build.__name__] = WorldSource(build, keys, **about)
        return build

    return enter


def world_source_of(name: str) -> WorldSource:
    """Return a source by its name.

    Raises:
        InputError: there is none of this name.
    """
    if name not in SOURCES:
        raise InputError(f"suite = {name!r}: unknown; allowed: {', '.join(sorted(SOURCES))}")
    return SOURCES[name]


def suites() -> dict[str, Suite]:
    """Return the suites of generated worlds by name, in alphabetical order."""
    return {name: source.suite for name, source in sorted(SOURCES.items()) if source.suite}
