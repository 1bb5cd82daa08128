# SPDX-License-Identifier: Apache-2.0
"""Maps that robots without a map make as they go, from their scans and their odometry.

Like the rolling costmap of Nav2: beams clear the cells that they pass and mark the cell in which
they end; what has not been seen yet counts as free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import ndimage

from pm01_nav.compilation import compiled
from pm01_nav.config import FrozenModel
from pm01_nav.geometry import after_twist, compose_poses
from pm01_nav.planners.scan_planner import clean_ranges
from pm01_nav.robot import RobotSpec
from pm01_nav.task.scans import scan_geometry
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.global_plan import INFLATION_DISTANCE, INFLATION_WEIGHT, Costmap

FloatArray = NDArray[np.float64]


class CostmapParams(FrozenModel):
    """How a rolling costmap is kept."""

    resolution: float = Field(default=0.1, gt=0.0, le=1.0)
    """Side of a cell [m]."""
    size: int = Field(default=160, ge=16, le=2000)
    """Cells along a side."""
    obstacle_range: float = Field(default=6.0, gt=0.0)
    """Returns further away are not marked, and beams clear no further [m]."""
    padding: float = Field(default=0.08, ge=0.0)
    """The robot's inscribed radius is taken this much larger [m]."""


class RollingCostmap:
    """One map around each of n robots, in the frame of its odometry: where it began to look."""

    def __init__(
        self, robot: RobotSpec, control_dt: float, count: int, params: CostmapParams
    ) -> None:
        """Begin ``count`` empty maps; ``control_dt`` [s] lies between two observations."""
        self.params = params
        self.pose = np.zeros((count, 3))
        """Where each robot is by its odometry, x, y, yaw [m, m, rad]."""
        self._dt = control_dt
        self._velocity: FloatArray | None = None
        self._occupied = np.zeros((count, params.size, params.size), dtype=np.uint8)
        # Where in its cell the last return was, as parts of a cell: walls are not moved to centres.
        self._place = np.zeros((count, params.size, params.size, 2), dtype=np.float32)
        self._corner = np.full((count, 2), -(params.size // 2))
        self._radius = robot.footprint.inscribed_radius + params.padding
        lidar = robot.lidar
        self._geometry = scan_geometry(lidar)
        self._mount = (lidar.x, lidar.y)
        self._angles = lidar.angles + lidar.yaw
        self._reach = min(lidar.range_max, params.obstacle_range)

    def observe(
        self,
        scan: NDArray[np.float32],
        velocity: FloatArray,
        *,
        seconds: float | None = None,
        motion: FloatArray | None = None,
    ) -> None:
        """Follow the robots by one control step and enter their scans.

        ``scan`` (n, num_beams): ranges by REP-117 [m]; ``velocity`` (n, 2) [m/s, rad/s] measured
        now. ``seconds`` tells if it was not one control step, ``motion`` (n, 3) [m, m, rad] how far
        the robots came, as seen from where they were, if that is known better. The first call moves
        nothing.
        """
        if motion is not None:
            self.pose = compose_poses(self.pose, motion)
        elif self._velocity is not None:
            mean = 0.5 * (self._velocity + velocity)
            self.pose = after_twist(self.pose, mean, self._dt if seconds is None else seconds)
        self._velocity = velocity.copy()
        self._roll()
        ranges = clean_ranges(scan, self._geometry)
        # A beam that says nothing must not clear what an earlier one has seen.
        ranges[np.isinf(ranges) & ~np.isposinf(scan)] = np.nan
        frame = (self.params.resolution, self._reach)
        cells = (self._occupied, self._place, self._corner)
        _enter(cells, self.pose, ranges, self._angles, self._mount, frame)

    def _roll(self) -> None:
        """Move a map whose robot is nearer to its edge than to its middle."""
        size, quarter = self.params.size, self.params.size // 4
        here = np.floor(self.pose[:, :2] / self.params.resolution).astype(np.int64)
        off = here - self._corner - size // 2
        for i in np.flatnonzero((np.abs(off) > quarter).any(axis=1)):
            across, up = off[i]
            target = tuple(slice(max(-d, 0), size - max(d, 0)) for d in (up, across))
            source = tuple(slice(max(d, 0), size + min(d, 0)) for d in (up, across))
            for cells in (self._occupied[i], self._place[i]):
                moved = np.zeros_like(cells)
                moved[target] = cells[source]
                cells[:] = moved
            self._corner[i] += off[i]

    def costmaps(self, i: int) -> tuple[Costmap, Costmap]:
        """Return where robot i fits now, and where it also fits anywhere in the cells.

        A cell is free if its centre is; a straight line may pass it half a cell nearer to an
        obstacle. Cells close to obstacles are dear.
        """
        resolution = self.params.resolution
        corner = resolution * self._corner[i]
        origin = float(corner[0]), float(corner[1])
        gap = self._distance(i) - self._radius
        extra = inflation(gap)
        least = (0.0, 0.5 * resolution)
        spaces = [FreeSpace(gap > limit, resolution, origin) for limit in least]
        return Costmap(spaces[0], extra, self._radius), Costmap(spaces[1], extra, self._radius)

    def _distance(self, i: int) -> NDArray[np.float32]:
        """Return how far the cells' centres are from the nearest return [m], shape (size, size)."""
        occupied = self._occupied[i]
        if not occupied.any():
            return np.full(occupied.shape, np.inf, dtype=np.float32)
        nearest = ndimage.distance_transform_edt(
            occupied == 0, return_distances=False, return_indices=True
        )
        row, column = np.asarray(nearest)
        place = self._place[i, row, column]
        middle = np.arange(self.params.size, dtype=np.float32) + np.float32(0.5)
        across = place[..., 0] + column - middle[None, :]
        up = place[..., 1] + row - middle[:, None]
        return np.hypot(across, up).astype(np.float32) * np.float32(self.params.resolution)

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        self.pose, self._occupied = self.pose[robots], self._occupied[robots]
        self._place, self._corner = self._place[robots], self._corner[robots]
        if self._velocity is not None:
            self._velocity = self._velocity[robots]


def inflation(gap: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what a metre costs extra so far [m] from closed cells, as ``inflate`` does."""
    left = np.clip(1.0 - gap / np.float32(INFLATION_DISTANCE), 0.0, 1.0)
    return (INFLATION_WEIGHT * left**2).astype(np.float32)


@compiled
def _enter(cells, pose, ranges, angles, mount, frame):
    """Clear the cells that the beams pass, then mark those in which they end; NaN does neither."""
    occupied, place, corner = cells
    resolution, reach = frame
    for i in range(pose.shape[0]):
        cos, sin = np.cos(pose[i, 2]), np.sin(pose[i, 2])
        x = (pose[i, 0] + cos * mount[0] - sin * mount[1]) / resolution - corner[i, 0]
        y = (pose[i, 1] + sin * mount[0] + cos * mount[1]) / resolution - corner[i, 1]
        for marking in range(2):
            for k in range(angles.shape[0]):
                length = ranges[i, k]
                if np.isnan(length):
                    continue
                ux, uy = np.cos(pose[i, 2] + angles[k]), np.sin(pose[i, 2] + angles[k])
                if marking == 0:
                    _clear(occupied, i, x, y, ux, uy, min(length, reach) / resolution - 1.0)
                elif length <= reach:
                    end = x + ux * length / resolution, y + uy * length / resolution
                    _mark(occupied, place, i, end[0], end[1])


@compiled
def _clear(occupied, i, x, y, ux, uy, length):
    """Clear the cells along a beam; all in cells."""
    for k in range(int(2.0 * length) + 1):
        column, row = int(np.floor(x + 0.5 * k * ux)), int(np.floor(y + 0.5 * k * uy))
        if 0 <= column < occupied.shape[2] and 0 <= row < occupied.shape[1]:
            occupied[i, row, column] = 0


@compiled
def _mark(occupied, place, i, x, y):
    """Mark the cell of a point; all in cells."""
    column, row = int(np.floor(x)), int(np.floor(y))
    if 0 <= column < occupied.shape[2] and 0 <= row < occupied.shape[1]:
        occupied[i, row, column] = 1
        place[i, row, column, 0], place[i, row, column, 1] = x - column, y - row
