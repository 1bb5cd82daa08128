# SPDX-License-Identifier: Apache-2.0
"""How far points are from a robot's outline."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pm01_nav.robot import Footprint

FloatArray = NDArray[np.float64]


class Outline:
    """A circle, or a convex polygon, in base_link."""

    def __init__(self, footprint: Footprint) -> None:
        """Take over what a robot's description says of its outline."""
        self.radius = footprint.circumscribed_radius
        """Distance from base_link to the farthest point of the outline [m]."""
        self.turning_radius = 0.0 if footprint.shape == "circle" else self.radius
        """How far turning moves a point of the outline to another place, for each radian [m]."""
        self._normals: FloatArray | None = None
        if footprint.shape == "polygon":
            corners = np.array(footprint.vertices)
            edges = np.roll(corners, -1, axis=0) - corners
            # Counter-clockwise, so the outside is to the right.
            outward = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
            self._normals = outward / np.linalg.norm(outward, axis=1, keepdims=True)
            self._offsets = (self._normals * corners).sum(axis=1)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return how far points (..., 2) are outside [m]; negative inside, shape (...).

        Beside a polygon's corner it is less than the true distance, never more.
        """
        if self._normals is None:
            return np.hypot(points[..., 0], points[..., 1]) - self.radius
        return (points @ self._normals.T - self._offsets).max(axis=-1)
