# SPDX-License-Identifier: Apache-2.0
"""Distances to segments, for kernels."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled


@compiled
def point_to_segment(px, py, x1, y1, x2, y2):
    """Return the distance from a point to a segment [m]."""
    ex, ey = x2 - x1, y2 - y1
    along = ((px - x1) * ex + (py - y1) * ey) / max(ex * ex + ey * ey, 1e-18)
    along = min(max(along, 0.0), 1.0)
    dx, dy = px - x1 - along * ex, py - y1 - along * ey
    return np.sqrt(dx * dx + dy * dy)
