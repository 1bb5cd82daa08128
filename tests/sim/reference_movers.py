# SPDX-License-Identifier: Apache-2.0
"""Slow, obvious twins of the kernels that move obstacles, for tests to compare with."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from pm01_nav.worlds.world import World
from tests.sim.reference import solid_boxes, to_frame

FloatArray = NDArray[np.float64]


def reference_gap(world: World, centre: FloatArray, radius: float) -> float:
    """Return the distance from a disc to the nearest obstacle or bound [m], negative inside."""
    x_min, y_min, x_max, y_max = world.bounds
    distances = [centre[0] - x_min, centre[1] - y_min, x_max - centre[0], y_max - centre[1]]
    distances += [np.linalg.norm(centre - offset) for offset in nearest_points(world, centre)]
    return float(min(distances)) - radius


def nearest_points(world: World, centre: FloatArray) -> list[FloatArray]:
    """Return the nearest point of each disc, segment and solid cell to a place."""
    points = []
    for x, y, radius in world.discs:
        away = centre - (x, y)
        points.append(np.array([x, y]) + radius * away / np.linalg.norm(away))
    for segment in world.all_segments:
        start, extent = segment[:2], segment[2:] - segment[:2]
        part = np.clip((centre - start) @ extent / max(extent @ extent, 1e-18), 0.0, 1.0)
        points.append(start + part * extent)
    if world.grid is not None:
        grid, place = world.grid, to_frame(world.grid, centre)
        in_frame = [np.clip(place, box[:2], box[2:]) for box in solid_boxes(grid)]
        points += [grid.to_world(point / grid.resolution) for point in in_frame]
    return points


def reference_first_hit(
    world: World, centre: FloatArray, direction: FloatArray, length: float, radius: float
) -> tuple[float, FloatArray]:
    """Return how far a free disc moves before it touches something, and the normal there.

    Steps as long as the gap, or of a millimetre, then a root finder; the normal is the gap's
    gradient by differences.
    """

    def gap(distance: float) -> float:
        return reference_gap(world, centre + distance * direction, radius)

    before = 0.0
    while before < length:
        after = min(before + max(gap(before), 1e-3), length)
        if gap(after) <= 0.0:
            distance = float(np.asarray(brentq(gap, before, after, xtol=1e-13)))
            place = centre + distance * direction
            steps = 1e-6 * np.eye(2)
            ahead = [reference_gap(world, place + step, radius) for step in steps]
            behind = [reference_gap(world, place - step, radius) for step in steps]
            normal = (np.array(ahead) - np.array(behind)) / 2e-6
            return distance, normal / np.linalg.norm(normal)
        before = after
    return length, np.zeros(2)


def reference_avoidance(
    way: FloatArray, velocity: FloatArray, reach: float, horizon: float
) -> tuple[FloatArray, float]:
    """Return the outward normal of a velocity obstacle nearest to a velocity, and how far it is.

    The obstacle is convex: all s (way + d) with s >= 1 / horizon and |d| <= reach. Its furthest
    point along a unit vector n is at n . (way + reach n) / horizon, or infinity if that is above 0.
    The nearest point of its border lies along the n for which the furthest point exceeds the
    velocity least.
    """

    def excess(angle: float) -> float:
        normal = np.array([np.cos(angle), np.sin(angle)])
        return float((normal @ way + reach) / horizon - normal @ velocity)

    # Those n for which n . way + reach <= 0.
    back = np.arctan2(-way[1], -way[0])
    half = np.arccos(min(reach / float(np.linalg.norm(way)), 1.0))
    best = minimize_scalar(
        excess, bounds=(back - half, back + half), method="bounded", options={"xatol": 1e-12}
    )
    candidates = [float(best.x), back - half, back + half]
    angle = min(candidates, key=excess)
    return np.array([np.cos(angle), np.sin(angle)]), excess(angle)


def reference_velocity(
    planes: FloatArray, num_fixed: int, wanted: FloatArray, speed_max: float
) -> tuple[FloatArray, float]:
    """Return the best velocity by trying all that can be, and the violation that it needs.

    ``planes`` (n, 3) permit n . v >= least. Where nothing is permitted, those after the fixed ones
    are lowered by the same amount, as little as is needed.
    """
    best = _nearest_permitted(planes, wanted, speed_max)
    if best is not None:
        return best, 0.0
    low, high = 0.0, 10.0 * speed_max + float(planes[:, 2].max())
    while high - low > 1e-10:
        middle = 0.5 * (low + high)
        if _nearest_permitted(_lowered(planes, num_fixed, middle), wanted, speed_max) is None:
            low = middle
        else:
            high = middle
    best = _nearest_permitted(_lowered(planes, num_fixed, high), wanted, speed_max)
    assert best is not None
    return best, high


def _lowered(planes: FloatArray, num_fixed: int, amount: float) -> FloatArray:
    lowered = planes.copy()
    lowered[num_fixed:, 2] -= amount
    return lowered


def _nearest_permitted(
    planes: FloatArray, wanted: FloatArray, speed_max: float
) -> FloatArray | None:
    """Try the wanted velocity, its foot on each border, and all crossings of borders and circle."""
    tries = [wanted]
    for nx, ny, least in planes:
        normal, along = np.array([nx, ny]), np.array([-ny, nx])
        tries.append(wanted + (least - normal @ wanted) * normal)
        if abs(least) <= speed_max:
            half = np.sqrt(speed_max**2 - least**2)
            tries += [least * normal + half * along, least * normal - half * along]
    for one, two in combinations(planes, 2):
        matrix = np.stack([one[:2], two[:2]])
        if abs(np.linalg.det(matrix)) > 1e-12:
            tries.append(np.linalg.solve(matrix, [one[2], two[2]]))
    found = np.array(tries)
    permitted = (found @ planes[:, :2].T >= planes[:, 2] - 1e-9).all(axis=1)
    permitted &= np.linalg.norm(found, axis=1) <= speed_max + 1e-9
    if not permitted.any():
        return None
    found = found[permitted]
    return found[np.linalg.norm(found - wanted, axis=1).argmin()]


def reference_repulsion(way: FloatArray, velocity: FloatArray, reach: float) -> FloatArray:
    """Return the acceleration [m/s^2] by Moussaid et al. (2009), formulas 2.3 to 2.5."""
    distance = float(np.linalg.norm(way))
    interaction = 2.0 * velocity + way / distance
    scale = 0.35 * float(np.linalg.norm(interaction))
    tangent = interaction / np.linalg.norm(interaction)
    normal = np.array([-tangent[1], tangent[0]])
    angle = np.arctan2(tangent[0] * way[1] - tangent[1] * way[0], tangent @ way) + 0.005 * scale
    strength = 4.5 * np.exp(-max(distance - reach, 0.0) / scale)
    slow, turn = np.exp(-((3.0 * scale * angle) ** 2)), np.exp(-((2.0 * scale * angle) ** 2))
    return -strength * (slow * tangent + np.sign(angle) * turn * normal)


def reference_crowd_step(
    world: World,
    bodies: FloatArray,
    targets: FloatArray,
    dt: float,
    plan: Callable[[FloatArray, FloatArray, int], tuple[FloatArray, list[FloatArray]]],
) -> tuple[FloatArray, FloatArray]:
    """Return the pedestrians' next velocities (n, 2), and what half-planes they violate (n,) [m/s].

    ``bodies`` (n, 6) are x, y, vx, vy, radius and preferred speed. ``plan(bodies, wanted, k)`` is
    the model: it returns the velocity that pedestrian k asks for and its further half-planes.
    """
    chosen, violations = [], []
    for k, (x, y, _, _, radius, speed) in enumerate(bodies):
        place = np.array([x, y])
        fixed = []
        for point in nearest_points(world, place):
            distance = float(np.linalg.norm(place - point))
            if distance - radius < 1.3 * speed * 0.5:
                away = (place - point) / distance
                fixed.append(np.array([*away, min(-(distance - radius) / 0.5, speed)]))
        for j, other in enumerate(bodies):
            away = place - other[:2]
            gap = float(np.linalg.norm(away)) - radius - other[4]
            if j != k and gap < 2.0 * dt * 1.3 * max(speed, other[5]):
                away /= np.linalg.norm(away)
                fixed.append(np.array([*away, min(-gap / (2.0 * dt), speed)]))
        towards = targets[k] - place
        wanted, planes = plan(bodies, speed * towards / np.linalg.norm(towards), k)
        wanted = wanted * min(1.0, 1.3 * speed / max(float(np.linalg.norm(wanted)), 1e-12))
        rows = np.array([*fixed, *planes]).reshape(-1, 3)
        velocity, violation = reference_velocity(rows, len(fixed), wanted, 1.3 * speed)
        chosen.append(velocity)
        violations.append(violation)
    return np.array(chosen), np.array(violations)


def neighbours(bodies: FloatArray, k: int) -> list[tuple[FloatArray, FloatArray, float]]:
    """Return way, relative velocity and sum of radii to all whom pedestrian k looks at."""
    near = []
    for j, other in enumerate(bodies):
        way, velocity = other[:2] - bodies[k, :2], bodies[k, 2:4] - other[2:4]
        distance = float(np.linalg.norm(way))
        closing = float(way @ velocity) / distance if j != k else 0.0
        if j != k and (distance < 1.5 or (distance < 3.0 and distance < 4.0 * closing)):
            near.append((way, velocity, float(bodies[k, 4] + other[4])))
    return near


def plan_by_orca(
    bodies: FloatArray, wanted: FloatArray, k: int
) -> tuple[FloatArray, list[FloatArray]]:
    """Half of what each velocity obstacle asks for is taken on oneself."""
    planes = []
    for way, velocity, reach in neighbours(bodies, k):
        normal, short = reference_avoidance(way, velocity, reach, 2.0)
        planes.append(np.array([*normal, normal @ bodies[k, 2:4] + 0.5 * short]))
    return wanted, planes


def plan_by_forces(
    bodies: FloatArray, wanted: FloatArray, k: int, dt: float = 0.1
) -> tuple[FloatArray, list[FloatArray]]:
    """Add the forces of all neighbours, but not of walls, to the present velocity."""
    force = (wanted - bodies[k, 2:4]) / 0.54
    for way, velocity, reach in neighbours(bodies, k):
        force = force + reference_repulsion(way, velocity, reach)
    return bodies[k, 2:4] + dt * force, []
