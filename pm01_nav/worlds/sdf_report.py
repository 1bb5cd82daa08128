# SPDX-License-Identifier: Apache-2.0
"""What became of the shapes of an SDF world, in lines for a person."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.worlds.polygon import signed_area
from pm01_nav.worlds.world import World

NAMED = 5
"""So many are named one by one."""
MOST = 0.5
"""A shape on more than this part of the bounds is probably no obstacle."""


@dataclass
class Report:
    """What was found, and what was left out and why."""

    num_shapes: int = 0
    """Collisions, or visuals where nothing collides, without those of robots."""
    lost: list[str] = field(default_factory=list)
    """Shapes that cannot be read: what they are and where."""
    missing: list[str] = field(default_factory=list)
    """Included models that no folder has."""
    unread: list[str] = field(default_factory=list)
    """Populations, actors and included files that hold no model."""
    floors: list[str] = field(default_factory=list)
    robots: list[str] = field(default_factory=list)
    moved: list[str] = field(default_factory=list)
    """Models that a plugin may move."""
    deleted: list[str] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    """Names of frames that old files have and nothing is called by."""

    @property
    def num_lost(self) -> int:
        """A missing model counts as one shape: nobody knows how many it has."""
        return len(self.lost) + len(self.missing)

    @property
    def share(self) -> str:
        """Say how many of the shapes were read."""
        total = self.num_shapes + len(self.missing)
        return f"read {total - self.num_lost} of {total} shapes"

    def check(self, path: Path, folders: str, *, partial: bool, strict: bool) -> None:
        """Refuse a world of which too much is lost.

        Raises:
            InputError: anything is lost and ``strict``; a model is missing, or above half of the
                shapes are lost, and not ``partial``.
        """
        if strict and (self.num_lost or self.unread):
            named = listed([*self.missing, *self.lost, *self.unread])
            raise InputError(f"{path}: not supported: {named}")
        if partial:
            return
        if self.missing:
            raise InputError(
                f"{path}: {listed(self.missing)}: no such model in {folders}; give its folder "
                "(--models DIR), or take the rest (--partial)"
            )
        if self.num_lost * 2 > self.num_shapes:
            raise InputError(
                f"{path}: {self.share}; lost: {listed(self.lost)}; to take the rest: --partial"
            )

    def notes(self) -> list[str]:
        """Return a line for each way in which something was left out or is not sure."""
        lines = [
            ("lost", self.lost),
            ("missing models", self.missing),
            ("not supported", self.unread),
            ("floor, left out", self.floors),
            ("robot, left out", self.robots),
            ("taken where they begin, though a plugin may move them", self.moved),
            ("deleted by <state>", self.deleted),
            ("unknown frames, taken for the usual ones", self.frames),
        ]
        return [f"{what}: {listed(names)}" for what, names in lines if names]


def listed(names: list[str]) -> str:
    """Return names with commas between them, equal ones once, many of them cut short."""
    counts = Counter(names)
    texts = [name if count == 1 else f"{name} ({count} times)" for name, count in counts.items()]
    more = len(texts) - NAMED
    return ", ".join(texts[:NAMED]) + (f" and {more} more" if more > 0 else "")


def crowded(world: World) -> list[str]:
    """Warn of shapes that cover most of the bounds."""
    x_min, y_min, x_max, y_max = world.bounds
    whole = (x_max - x_min) * (y_max - y_min)
    areas = [abs(signed_area(polygon)) for polygon in world.polygons]
    areas += (np.pi * world.discs[:, 2] ** 2).tolist()
    share = max(areas, default=0.0) / whole
    if share <= MOST:
        return []
    return [
        f"one shape covers {100.0 * min(share, 1.0):.0f} % of the bounds: if it is a floor or a "
        "building's outer hull, robots drive in what is left around it"
    ]
