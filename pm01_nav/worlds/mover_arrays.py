# SPDX-License-Identifier: Apache-2.0
"""Moving obstacles of many worlds in a few flat arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.free_space import free_space
from pm01_nav.worlds.mover import Motion, Mover
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BOUNCE, TRACK, PEDESTRIAN = 0, 1, 2
"""How the kernels move an obstacle; loops and splines both follow a track, a table of places."""
KINDS: dict[Motion, int] = {
    "bounce": BOUNCE,
    "loop": TRACK,
    "spline": TRACK,
    "pedestrian": PEDESTRIAN,
}
TRACK_DT = 0.05
"""Greatest time between two places of a track [s]; in between it is straight."""
PLACES_PER_WORLD = 256
"""Places kept of a world with pedestrians, from which they draw where to walk."""


class MoverArrays(NamedTuple):
    """The movers of a pool; world w owns rows ``mover_begin[w]`` to ``mover_begin[w + 1]``."""

    mover_begin: IntArray
    mover_kind: IntArray
    """BOUNCE, TRACK or PEDESTRIAN, shape (n,)."""
    mover_radius: FloatArray
    """[m], shape (n,)."""
    mover_speed: FloatArray
    """Of a track the greatest [m/s], shape (n,)."""
    mover_direction: FloatArray
    """Unit vector in which a bounce starts, shape (n, 2)."""
    mover_period: FloatArray
    """Time once round a track [s], 0 for others, shape (n,)."""
    mover_jumps: NDArray[np.bool_]
    """Whether a track's end is not its beginning, shape (n,)."""
    mover_points: FloatArray
    """A track's places at even times, its end included; others' waypoints [m], shape (p, 2)."""
    mover_point_begin: IntArray
    """Mover m owns the points ``mover_point_begin[m]`` to ``mover_point_begin[m + 1]``."""
    mover_places: FloatArray
    """Where a world's pedestrians find room [m], shape (q, 2)."""
    mover_place_begin: IntArray
    bounds: FloatArray
    """Of each world: x_min, y_min, x_max, y_max [m], shape (num_worlds, 4)."""
    mover_random_phase: bool
    """Whether each episode finds a track's mover at a random time of its round."""


def pack_movers(worlds: Sequence[World], *, random_phase: bool = True) -> MoverArrays:
    """Lay the movers of all worlds end to end."""
    movers = [mover for world in worlds for mover in world.movers]
    points = [_points(mover) for mover in movers]
    places = [_places(world, index) for index, world in enumerate(worlds)]
    ends = np.array([(*p[0], *p[-1]) for p in points]).reshape(-1, 4)
    tracks = np.array([KINDS[m.motion] == TRACK for m in movers], dtype=np.bool_)
    heading = np.array([m.heading for m in movers])
    return MoverArrays(
        mover_begin=_begin([len(world.movers) for world in worlds]),
        mover_kind=np.array([KINDS[m.motion] for m in movers], dtype=np.int64),
        mover_radius=np.array([m.radius for m in movers]),
        mover_speed=np.array([_speed(m, p) for m, p in zip(movers, points, strict=True)]),
        mover_direction=np.stack([np.cos(heading), np.sin(heading)], axis=-1),
        mover_period=np.array([_period(m) for m in movers]),
        mover_jumps=tracks & (ends[:, :2] != ends[:, 2:]).any(axis=1),
        mover_points=np.concatenate([*points, np.zeros((0, 2))]),
        mover_point_begin=_begin([len(p) for p in points]),
        mover_places=np.concatenate([*places, np.zeros((0, 2))]),
        mover_place_begin=_begin([len(p) for p in places]),
        bounds=np.array([world.bounds for world in worlds], dtype=np.float64).reshape(-1, 4),
        mover_random_phase=random_phase,
    )


def loop_position(mover: Mover, times: FloatArray) -> FloatArray:
    """Return where a ``loop`` is at ``times`` (n,) [s] after its first point, shape (n, 2)."""
    corners = np.concatenate([mover.points, mover.points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    driven = np.clip(mover.speed * times, 0.0, along[-1])
    return np.stack([np.interp(driven, along, corners[:, axis]) for axis in range(2)], axis=-1)


def spline_position(mover: Mover, times: FloatArray) -> FloatArray:
    """Return where a ``spline`` is at ``times`` (n,) [s] within its round, shape (n, 2).

    The curve of Gazebo Classic's ``PoseAnimation``: cubic Hermite between keys over the part u of
    the interval that has passed. A key's tangent is half the difference of its neighbours, an end's
    half the difference to its only neighbour; a curve that ends where it began has no ends.
    """
    p, t = mover.points, mover.times
    before, after = np.concatenate([p[:1], p[:-1]]), np.concatenate([p[1:], p[-1:]])
    if (p[0] == p[-1]).all():
        before[0], after[-1] = p[-2], p[1]
    tangent = 0.5 * (after - before)
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
    u = np.clip((times - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0)[:, None]
    return (
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * p[k]
        + u * (1.0 - u) ** 2 * tangent[k]
        + (3.0 - 2.0 * u) * u**2 * p[k + 1]
        + (u - 1.0) * u**2 * tangent[k + 1]
    )


def _points(mover: Mover) -> FloatArray:
    if KINDS[mover.motion] != TRACK:
        return np.asarray(mover.points, dtype=np.float64)
    period = _period(mover)
    times = np.linspace(0.0, period, max(int(np.ceil(period / TRACK_DT - 1e-9)), 1) + 1)
    return (loop_position if mover.motion == "loop" else spline_position)(mover, times)


def _period(mover: Mover) -> float:
    if mover.motion == "loop":
        corners = np.concatenate([mover.points, mover.points[:1]])
        return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum() / mover.speed)
    return float(mover.times[-1]) if mover.motion == "spline" else 0.0


def _speed(mover: Mover, points: FloatArray) -> float:
    if KINDS[mover.motion] != TRACK:
        return mover.speed
    step = _period(mover) / (len(points) - 1)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).max() / step) if step else 0.0


def _places(world: World, index: int) -> FloatArray:
    """Draw places from the largest region that is free for the world's largest pedestrian."""
    radii = [mover.radius for mover in world.movers if mover.motion == "pedestrian"]
    if not radii:
        return np.zeros((0, 2))
    space = free_space(world, max(radii))
    regions = space.regions()
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    rows, columns = np.nonzero((regions == sizes.argmax()) & (regions > 0))
    # Uniform on the free cells, without repetition.
    order = np.random.default_rng([index]).permutation(len(rows))[:PLACES_PER_WORLD]
    return space.centre(rows[order], columns[order])


def _begin(lengths: Sequence[int]) -> IntArray:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
