# SPDX-License-Identifier: Apache-2.0
"""A memory of the places where the robot has been, for policies without a map.

A robot that sees only what is around it and where the goal lies drives into the same dead end
again and again. It knows from its odometry where it has been, so the observation can tell it which
directions are new. Environments have the same from the simulator (``sim.trail``).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.durations import whole_steps
from pm01_nav.errors import InputError
from pm01_nav.geometry import after_twist, compose_poses

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrailLayout:
    """How a trail is kept and shown."""

    sectors: int = 18
    """Equal sectors around the robot, the first one behind, counter-clockwise."""
    interval_s: float = 1.0
    """Time between two noted places [s], rounded to control periods."""
    capacity: int = 128
    """Places remembered; then the oldest is forgotten."""
    reach: float = 3.0
    """Places further away than this do not count [m]."""
    near: float = 0.5
    """Nearer than this a place counts the less the nearer it is: it has no clear direction [m]."""
    settled_places: int = 5
    """A place is left behind, and coming near it is to come back, once so many more are noted."""

    @property
    def size(self) -> int:
        """How many numbers show the trail: the sectors, and how familiar the present place is."""
        return self.sectors + 1

    def __post_init__(self) -> None:
        """Refuse numbers that are not positive.

        Raises:
            InputError: names the first one.
        """
        for name, value in asdict(self).items():
            if not 0 < value < math.inf:
                raise InputError(f"trail.{name} = {value}: must be above 0")


def visited_sectors(
    layout: TrailLayout, places: FloatArray, pose: FloatArray
) -> NDArray[np.float32]:
    """Return how much of the trail lies in each sector, 0 to 1, shape (n, sectors).

    ``places`` (n, m, 2) [m] and ``pose`` (n, 3) [m, m, rad] are in the same frame. A place counts
    min(d / near, 1) (1 - d / reach) at the distance d, shared between the two sectors whose middles
    are next to its direction; a sector's sum s is shown as s / (1 + s).
    """
    offset = places - pose[:, None, :2]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    weight = np.minimum(distance / layout.near, 1.0) * (1.0 - distance / layout.reach)
    weight = np.maximum(weight, 0.0)
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) - pose[:, None, 2]
    place = (bearing / (2.0 * np.pi) + 0.5) * layout.sectors - 0.5
    right = np.floor(place)
    share = place - right
    row = layout.sectors * np.arange(len(pose))[:, None]
    sums = np.zeros(len(pose) * layout.sectors)
    for sector, part in ((right, 1.0 - share), (right + 1.0, share)):
        index = row + sector.astype(np.int64) % layout.sectors
        sums += np.bincount(index.ravel(), (weight * part).ravel(), len(sums))
    sums = sums.reshape(len(pose), layout.sectors)
    return (sums / (1.0 + sums)).astype(np.float32)


def familiarity(layout: TrailLayout, settled: FloatArray, pose: FloatArray) -> NDArray[np.float32]:
    """Return how near each robot is to a place that it had left behind, 0 to 1, shape (n,).

    It is 1 - d / near at a distance d to the nearest of the ``settled`` places
    (n, m, 2) [m], of which there may be none.
    """
    offset = settled - pose[:, None, :2]
    distance = np.hypot(offset[..., 0], offset[..., 1]).min(axis=1, initial=layout.near)
    return (1.0 - distance / layout.near).astype(np.float32)


class Trail:
    """The trails of n robots, kept by dead reckoning from their measured velocities."""

    def __init__(self, layout: TrailLayout, control_dt: float, count: int) -> None:
        """Begin ``count`` trails where the robots stand; ``control_dt`` [s] from step to step."""
        self.layout = layout
        self._dt = control_dt
        self._interval = whole_steps(layout.interval_s, control_dt)
        self._pose = np.zeros((count, 3))
        self._velocity: FloatArray | None = None
        self._places = np.zeros((count, layout.capacity, 2))
        self._until_note = 1
        self._noted = 0

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only."""
        self._pose, self._places = self._pose[robots], self._places[robots]
        if self._velocity is not None:
            self._velocity = self._velocity[robots]

    def follow(
        self,
        velocity: ArrayLike,
        *,
        seconds: float | None = None,
        steps: int = 1,
        motion: FloatArray | None = None,
    ) -> NDArray[np.float32]:
        """Move on by one control step; return ``visited_sectors`` and ``familiarity``, (n, size).

        ``velocity`` (n, 2): measured v and w [m/s, rad/s] now. ``seconds`` and ``steps`` tell if it
        was not one control step. ``motion`` (n, 3) [m, m, rad] is how far the robots came, as seen
        from where they were, if that is known better. The first call moves nothing.
        """
        velocity = np.asarray(velocity, dtype=np.float64)
        if motion is not None:
            self._pose = compose_poses(self._pose, motion)
        elif self._velocity is not None:
            mean = 0.5 * (self._velocity + velocity)
            self._pose = after_twist(self._pose, mean, self._dt if seconds is None else seconds)
        self._velocity = velocity.copy()
        self._until_note -= steps
        if self._until_note <= 0:
            self._places[:, self._noted % self.layout.capacity] = self._pose[:, :2]
            self._noted += 1
            self._until_note += self._interval
        places = self._places[:, : self._noted]
        # How many places were noted after that of a slot; the slots are a ring.
        later = (self._noted - 1 - np.arange(places.shape[1])) % self.layout.capacity
        settled = places[:, later >= self.layout.settled_places]
        sectors = visited_sectors(self.layout, places, self._pose)
        here = familiarity(self.layout, settled, self._pose)
        return np.concatenate([sectors, here[:, None]], axis=1)
