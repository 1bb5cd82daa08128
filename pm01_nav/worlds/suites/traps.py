# SPDX-License-Identifier: Apache-2.0
"""Dead ends that must be left again: traps between the start and the goal."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.suites.layout import (
    PASSAGE,
    WALL_THICKNESS,
    Area,
    Layout,
    points_along,
    room_walls,
    thick_chain,
    turned,
)
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

SIDE = 10.0
"""Of the room [m]."""
MOUTH = 0.8 + WALL_THICKNESS
"""Least width of a trap's opening between the middles of thin walls [m]."""
HALF_AREA = 0.5
"""Half the side of the square in which starts, or goals, are drawn [m]."""


class _Trap(NamedTuple):
    """A trap in its own frame: its mouth faces -x, its middle is the origin."""

    depth: float
    """From the mouth to the closed end [m]."""
    outline: FloatArray
    """Shape (n, 2)."""

    def put(self, layout: Layout, centre: tuple[float, float], yaw: float) -> None:
        layout.polygons.append(turned(self.outline, centre, yaw))


@suite(frozen="7df7fe439991f8d70735d4d6a33c27d6122150c929ee25a9eaf929be810a5633")
def u_traps(rng: np.random.Generator) -> World:
    """Draw a room in which a trap stands between the start and the goal.

    The start is in the trap's mouth or before it and the goal behind it, or the other way round;
    sometimes both are anywhere.
    """
    bounds = (0.0, 0.0, SIDE, SIDE)
    layout = Layout(bounds, [room_walls(*bounds)])
    trap = _draw_trap(rng)
    # Middle of the trap U(4, 6)^2 m; yaw U(-pi, pi).
    x, y = rng.uniform(4.0, 6.0, 2)
    yaw = rng.uniform(-np.pi, np.pi)
    trap.put(layout, (x, y), yaw)
    # Distances from the trap's middle along its axis [m]: in it U(-0.1, 0.2) of its depth; before
    # and behind it U(0.9, 2) from its ends. Sideways U(-0.5, 0.5) m, in it not at all.
    inside = np.array([rng.uniform(-0.1, 0.2) * trap.depth, 0.0])
    before = np.array([-0.5 * trap.depth - rng.uniform(0.9, 2.0), rng.uniform(-0.5, 0.5)])
    behind = np.array([0.5 * trap.depth + rng.uniform(0.9, 2.0), rng.uniform(-0.5, 0.5)])
    inside, before, behind = turned(np.array([inside, before, behind]), (x, y), yaw)
    # From inside it to behind it 0.35, from before it to behind it 0.35, from behind it into it
    # 0.15, anywhere to anywhere 0.15.
    case = rng.choice(4, p=(0.35, 0.35, 0.15, 0.15))
    ways = ((inside, behind), (before, behind), (behind, inside), (None, None))
    start, goal = (None if place is None else _square(place) for place in ways[case])
    kept_free = [before, behind]
    # Other traps, anywhere: uniform on 0 ... 2.
    for _ in range(rng.integers(0, 3)):
        _add_trap_aside(layout, kept_free, rng)
    # Discs and boxes to try: uniform on 3 ... 9.
    for _ in range(rng.integers(3, 10)):
        _add_obstacle(layout, kept_free, rng)
    return layout.world("u_traps", start_area=start, goal_area=goal)


def _square(centre: FloatArray) -> Area:
    """Return the square around a place, as near to it as the room allows."""
    x, y = np.clip(centre, HALF_AREA, SIDE - HALF_AREA)
    return x - HALF_AREA, y - HALF_AREA, x + HALF_AREA, y + HALF_AREA


def _draw_trap(rng: np.random.Generator) -> _Trap:
    # Each shape with equal probability.
    shapes: tuple[Callable[[np.random.Generator], _Trap], ...] = (_u, _blind_alley, _bowl, _hook)
    return shapes[rng.integers(len(shapes))](rng)


def _u(rng: np.random.Generator) -> _Trap:
    """Draw a thick U, whose mouth may be wider or narrower than its end."""
    # Inside: width U(1.2, 3) m, depth U(1, 2.5) m; thickness U(0.1, 0.35) m. Each side of the mouth
    # lies U(-0.2, 0.6) m further out than the end.
    width, depth, thickness = rng.uniform(1.2, 3.0), rng.uniform(1.0, 2.5), rng.uniform(0.1, 0.35)
    return _Trap(depth, _thick_u(width, depth, thickness, rng.uniform(-0.2, 0.6)))


def _blind_alley(rng: np.random.Generator) -> _Trap:
    """Draw a narrow, deep alley between two blocks."""
    # Width U(0.8, 1.3) m, depth U(1.8, 3.5) m; thickness U(0.2, 0.8) m.
    width, depth, thickness = rng.uniform(0.8, 1.3), rng.uniform(1.8, 3.5), rng.uniform(0.2, 0.8)
    return _Trap(depth, _thick_u(width, depth, thickness, 0.0))


def _thick_u(width: float, depth: float, thickness: float, flare: float) -> FloatArray:
    """Return the outline of a U, shape (8, 2)."""
    mouth, end = -0.5 * depth, 0.5 * depth
    inner, outer = 0.5 * width, 0.5 * width + thickness
    half = [
        (mouth, inner + flare),
        (end, inner),
        (end, -inner),
        (mouth, -inner - flare),
        (mouth, -outer - flare),
        (end + thickness, -outer),
        (end + thickness, outer),
        (mouth, outer + flare),
    ]
    return np.array(half)


def _bowl(rng: np.random.Generator) -> _Trap:
    """Draw a round bay."""
    # Radius U(0.8, 1.6) m; it reaches U(90, 130) degrees to both sides, in 8 walls.
    radius, reach = rng.uniform(0.8, 1.6), np.deg2rad(rng.uniform(90.0, 130.0))
    # As much less as the mouth needs.
    reach = min(reach, np.pi - np.arcsin(0.5 * MOUTH / radius))
    angles = np.linspace(-reach, reach, 9)
    points = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _Trap(2.0 * radius, thick_chain(points))


def _hook(rng: np.random.Generator) -> _Trap:
    """Draw thin walls like a U with a lip that half closes its mouth."""
    # Width U(1.6, 3) m, depth U(1.2, 2.5) m; the lip covers U(0, 0.5) of the mouth and is at least
    # as long as it is thick, but leaves 0.8 m free; at either side with equal probability.
    width, depth = rng.uniform(1.6, 3.0), rng.uniform(1.2, 2.5)
    lip = min(max(rng.uniform(0.0, 0.5) * width, WALL_THICKNESS), width - MOUTH)
    mouth, end, half = -0.5 * depth, 0.5 * depth, 0.5 * width
    points = np.array(
        [(mouth, half), (end, half), (end, -half), (mouth, -half), (mouth, lip - half)]
    )
    if rng.random() < 0.5:
        points[:, 1] *= -1.0
    return _Trap(depth, thick_chain(points))


def _add_trap_aside(layout: Layout, kept_free: list[FloatArray], rng: np.random.Generator) -> None:
    """Put another trap where it leaves a passage around it."""
    trap = _draw_trap(rng)
    # Middle U(1, 9)^2 m, yaw U(-pi, pi); up to 20 draws.
    for _ in range(20):
        x, y = rng.uniform(1.0, SIDE - 1.0, 2)
        yaw = rng.uniform(-np.pi, np.pi)
        alone = Layout(layout.bounds)
        trap.put(alone, (x, y), yaw)
        points = points_along(alone.world("alone").all_segments)
        far = all(np.hypot(*(place - (x, y))) >= 2.0 for place in kept_free)
        if far and layout.encloses(points) and layout.clearance(points) >= PASSAGE:
            trap.put(layout, (x, y), yaw)
            return


def _add_obstacle(layout: Layout, kept_free: list[FloatArray], rng: np.random.Generator) -> None:
    """Put a disc or a box anywhere, unless it would close a passage."""
    # Centre U(0.5, 9.5)^2 m, radius U(0.12, 0.4) m.
    x, y = rng.uniform(0.5, SIDE - 0.5, 2)
    radius = rng.uniform(0.12, 0.4)
    if any(np.hypot(*(place - (x, y))) < 1.0 + radius for place in kept_free):
        return
    # With probability 0.4 a box within that circle instead; the angle between its diagonal and its
    # length is U(0.3, 1.2) rad, its yaw U(-pi, pi).
    if rng.random() < 0.4:
        angle = rng.uniform(0.3, 1.2)
        sides = 2.0 * radius * np.cos(angle), 2.0 * radius * np.sin(angle)
        layout.add_box_if_clear((x, y, *sides, rng.uniform(-np.pi, np.pi)))
    else:
        layout.add_disc_if_clear(x, y, radius)
