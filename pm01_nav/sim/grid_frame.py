# SPDX-License-Identifier: Apache-2.0
"""Between the world and the lines of its grid, which may be turned."""

from __future__ import annotations

from pm01_nav.compilation import compiled


@compiled
def to_cells(x, y, worlds, w):
    """Return where a point lies in world w's grid, in columns and rows."""
    dx, dy = turn_to_grid(x - worlds.grid_frame[w, 0], y - worlds.grid_frame[w, 1], worlds, w)
    return dx / worlds.grid_frame[w, 2], dy / worlds.grid_frame[w, 2]


@compiled
def turn_to_grid(dx, dy, worlds, w):
    """Turn a world vector into the grid's frame."""
    cos, sin = worlds.grid_frame[w, 5], worlds.grid_frame[w, 6]
    return cos * dx + sin * dy, cos * dy - sin * dx


@compiled
def turn_from_grid(dx, dy, worlds, w):
    """Turn a vector of the grid's frame into the world."""
    cos, sin = worlds.grid_frame[w, 5], worlds.grid_frame[w, 6]
    return cos * dx - sin * dy, sin * dx + cos * dy
