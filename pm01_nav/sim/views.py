# SPDX-License-Identifier: Apache-2.0
"""Find the list of what can be seen from a place; ``worlds.views`` makes these lists."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled


@compiled
def view_cell(x, y, reach, worlds, w):
    """Return the cell that lists all of world w that is seen from (x, y), up to ``reach`` [m]."""
    size = worlds.view_frame[w, 2]
    column = np.floor((x - worlds.view_frame[w, 0]) / size)
    row = np.floor((y - worlds.view_frame[w, 1]) / size)
    width, height = worlds.view_frame[w, 3], worlds.view_frame[w, 4]
    # Comparisons with NaN, which a world without a raster gives, are false.
    inside = (column >= 0.0) & (row >= 0.0) & (column < width) & (row < height)
    first = worlds.view_begin[w]
    return (
        first + int(1.0 + row * width + column) if inside & (reach <= worlds.view_range) else first
    )


@compiled
def listed(begin, cell):
    """Return where the list of a cell begins and ends, as unsigned numbers (see ``sim.lidar``)."""
    return np.uint64(begin[cell]), np.uint64(begin[cell + 1])
