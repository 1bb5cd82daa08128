# SPDX-License-Identifier: Apache-2.0
"""What one picture shows, and where in the picture the world lies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Bounds = tuple[float, float, float, float]
Size = tuple[int, int]
Outcome = Literal["success", "collision", "timeout"]

REFERENCE_SIDE = 720
"""Longer side of a picture in which one unit of the layout is one pixel [px]."""
MARGIN = 16
"""Free border around the world [units]."""
CAPTION_HEIGHT = 32
"""The strip at the bottom that holds the caption [units]."""
SHOWN_AROUND = 0.5
"""So much is shown around what is free in a map [m]."""


@dataclass(frozen=True)
class Scene:
    """What moves in a picture; the world and the robot belong to the ``Canvas``."""

    pose: NDArray[np.floating]
    """The robot in the world [m, m, rad], shape (3,)."""
    goal: NDArray[np.floating]
    """In the world [m], shape (2,)."""
    goal_radius: float
    """The goal counts as reached within this distance [m]."""
    scan: NDArray[np.floating] | None = None
    """Lidar ranges by REP-117 [m], shape (num_beams,), beam 0 at angle_min; None draws none."""
    trail: NDArray[np.floating] = field(default_factory=lambda: np.zeros((0, 2)))
    """Where the robot has been, oldest first [m], shape (n, 2)."""
    movers: NDArray[np.floating] = field(default_factory=lambda: np.zeros((0, 3)))
    """x, y and radius of what else moves [m], shape (n, 3)."""
    caption: str = ""
    """One line below the world; cut where it does not fit."""
    outcome: Outcome | None = None
    """How the episode ended; None while it runs."""


@dataclass(frozen=True)
class View:
    """Where the world lies in a picture; x points right, the world's y up, the picture's down."""

    scale: float
    """[px/m]"""
    origin: tuple[float, float]
    """The world's origin in the picture, x from the left and y from the top [px]."""

    def pixels(self, points: ArrayLike) -> FloatArray:
        """Return world points (..., 2) [m] as picture coordinates (..., 2) [px]."""
        return np.asarray(self.origin) + np.asarray(points) * np.array([self.scale, -self.scale])

    def magnified(self, factor: float) -> View:
        """Return the same view of a picture ``factor`` times as large."""
        x, y = self.origin
        return View(self.scale * factor, (x * factor, y * factor))


def layout_unit(size: Size) -> float:
    """Return the size of one unit of the layout [px] in a picture of (width, height) [px]."""
    return max(size) / REFERENCE_SIDE


def fit(bounds: Bounds, size: Size) -> View:
    """Centre the area ``bounds`` [m] above the caption of a picture of (width, height) [px]."""
    x_min, y_min, x_max, y_max = bounds
    unit = layout_unit(size)
    width = size[0] - 2 * MARGIN * unit
    height = size[1] - (2 * MARGIN + CAPTION_HEIGHT) * unit
    scale = max(min(width / (x_max - x_min), height / (y_max - y_min)), 1e-6)
    middle = (size[0] / 2, MARGIN * unit + height / 2)
    centre_x, centre_y = (x_min + x_max) / 2, (y_min + y_max) / 2
    return View(scale, (middle[0] - centre_x * scale, middle[1] + centre_y * scale))


def shown_area(world: World) -> Bounds:
    """Return what a picture of a world shows [m]: its bounds, or what is free in its map."""
    if world.grid is None or not world.grid.closed:
        return world.bounds
    x_min, y_min, x_max, y_max = world.known_bounds
    around = SHOWN_AROUND
    return x_min - around, y_min - around, x_max + around, y_max + around


def picture_size(bounds: Bounds, longest: int = REFERENCE_SIDE) -> Size:
    """Return an even (width, height) [px] that ``bounds`` [m] fill, the longer one ``longest``."""
    x_min, y_min, x_max, y_max = bounds
    aspect = (x_max - x_min) / (y_max - y_min)
    unit = longest / REFERENCE_SIDE
    across, down = 2 * MARGIN * unit, (2 * MARGIN + CAPTION_HEIGHT) * unit
    width = min(float(longest), (longest - down) * aspect + across)
    height = min(float(longest), (longest - across) / aspect + down)
    # A very long world would leave a sliver in which no caption can be read.
    return _even(max(width, longest / 4)), _even(max(height, longest / 4))


def _even(pixels: float) -> int:
    return 2 * round(pixels / 2)
