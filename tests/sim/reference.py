# SPDX-License-Identifier: Apache-2.0
"""Slow, obvious twins of the simulator's kernels, for tests to compare with.

Plain numpy in float64: every beam against every obstacle, no bounds, no shortcuts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.world import OccupancyGrid, World

FloatArray = NDArray[np.float64]


def reference_scan(world: World, robot: RobotSpec, pose: ArrayLike) -> FloatArray:
    """Return the exact ranges seen from ``pose`` (3,) [m, m, rad], shape (num_beams,) [m].

    +inf beyond ``range_max``, -inf below ``range_min`` and at 0 (REP-117); no noise.
    """
    lidar = robot.lidar
    x, y, yaw = np.asarray(pose, dtype=np.float64)
    origin = np.array([x, y]) + _rotation(yaw) @ np.array([lidar.x, lidar.y])
    angles = yaw + lidar.yaw + lidar.angles
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    ranges = np.full(lidar.num_beams, np.inf)
    for disc in world.discs:
        ranges = np.minimum(ranges, _rays_to_disc(origin, directions, disc))
    for segment in world.all_segments:
        ranges = np.minimum(ranges, _rays_to_segment(origin, directions, segment))
    if world.grid is not None:
        # Everything is seen in the grid's frame: there its cells are not turned.
        start, turned = to_frame(world.grid, origin), directions @ _rotation(world.grid.yaw)
        for box in solid_boxes(world.grid):
            ranges = np.minimum(ranges, _rays_to_box(start, turned, box))
    ranges[ranges > lidar.range_max] = np.inf
    ranges[(ranges < lidar.range_min) | (ranges == 0.0)] = -np.inf
    return ranges


def _rays_to_disc(origin: FloatArray, directions: FloatArray, disc: FloatArray) -> FloatArray:
    """Solve |t u - c|^2 = r^2 for the nearer t >= 0, shape (num_beams,); 0 inside the disc."""
    centre, radius = disc[:2] - origin, disc[2]
    if centre @ centre <= radius**2:
        return np.zeros(len(directions))
    half = directions @ centre
    discriminant = half**2 - (centre @ centre - radius**2)
    near = half - np.sqrt(np.maximum(discriminant, 0.0))
    return np.where((discriminant >= 0.0) & (near >= 0.0), near, np.inf)


def _rays_to_segment(origin: FloatArray, directions: FloatArray, segment: FloatArray) -> FloatArray:
    """Solve t u - s e = p for t >= 0 and s in [0, 1], shape (num_beams,)."""
    start = segment[:2] - origin
    extent = segment[2:] - segment[:2]
    matrices = np.stack([directions, np.broadcast_to(-extent, directions.shape)], axis=-1)
    # A parallel one is seen edge-on, where a segment has no width.
    crossing = np.linalg.det(matrices) != 0.0
    solutions = np.linalg.solve(matrices[crossing], np.broadcast_to(start, (1, 2))[..., None])
    t, s = solutions[:, 0, 0], solutions[:, 1, 0]
    ranges = np.full(len(directions), np.inf)
    ranges[crossing] = np.where((t >= 0.0) & (s >= 0.0) & (s <= 1.0), t, np.inf)
    return ranges


def _rays_to_box(origin: FloatArray, directions: FloatArray, box: FloatArray) -> FloatArray:
    """Intersect rays with an axis-aligned box (x_min, y_min, x_max, y_max) by the slab method.

    Returns the distance to it, 0 from inside, infinity if it is not met, shape (num_beams,).
    """
    enter, leave = np.zeros(len(directions)), np.full(len(directions), np.inf)
    for axis in range(2):
        low, high = box[axis] - origin[axis], box[axis + 2] - origin[axis]
        along = directions[:, axis]
        parallel = along == 0.0
        divisor = np.where(parallel, 1.0, along)
        near = np.minimum(low / divisor, high / divisor)
        far = np.maximum(low / divisor, high / divisor)
        between = low <= 0.0 <= high
        near = np.where(parallel, -np.inf if between else np.inf, near)
        far = np.where(parallel, np.inf if between else -np.inf, far)
        enter, leave = np.maximum(enter, near), np.minimum(leave, far)
    return np.where(enter <= leave, enter, np.inf)


def reference_clearance(world: World, robot: RobotSpec, pose: ArrayLike) -> float:
    """Return the distance from the footprint at ``pose`` to the nearest obstacle [m].

    Negative inside a disc, and for a round footprint inside anything; a polygonal one that meets a
    wall or a cell has 0. Infinity in a world without obstacles.
    """
    pose = np.asarray(pose, dtype=np.float64)
    if robot.footprint.shape == "circle":
        return _clearance_of_circle(world, pose[:2], robot.footprint.radius)
    corners = np.array(robot.footprint.vertices) @ _rotation(pose[2]).T + pose[:2]
    return _clearance_of_polygon(world, corners)


def _clearance_of_circle(world: World, centre: FloatArray, radius: float) -> float:
    distances = [float(np.linalg.norm(disc[:2] - centre) - disc[2]) for disc in world.discs]
    distances += [_point_to_segment(centre, s[:2], s[2:]) for s in world.all_segments]
    if world.grid is not None:
        place = to_frame(world.grid, centre)
        for box in solid_boxes(world.grid):
            distances.append(float(np.linalg.norm(np.clip(place, box[:2], box[2:]) - place)))
    return min(distances, default=np.inf) - radius


def _clearance_of_polygon(world: World, corners: FloatArray) -> float:
    distances = [_point_to_polygon(disc[:2], corners) - disc[2] for disc in world.discs]
    distances += [_between_convex(corners, s.reshape(2, 2)) for s in world.all_segments]
    if world.grid is not None:
        corners = to_frame(world.grid, corners)
        for box in solid_boxes(world.grid):
            x_min, y_min, x_max, y_max = box
            square = np.array([[x_min, y_min], [x_max, y_min], [x_max, y_max], [x_min, y_max]])
            distances.append(_between_convex(corners, square))
    return min(distances, default=np.inf)


def _point_to_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> float:
    extent = end - start
    length_squared = float(extent @ extent)
    part = 0.0 if length_squared == 0.0 else float((point - start) @ extent) / length_squared
    return float(np.linalg.norm(start + min(max(part, 0.0), 1.0) * extent - point))


def _point_to_polygon(point: FloatArray, corners: FloatArray) -> float:
    """Return the distance to the outline of a convex polygon, negative inside [m]."""
    following = np.roll(corners, -1, axis=0)
    sides = zip(corners, following, strict=True)
    distance = min(_point_to_segment(point, a, b) for a, b in sides)
    extent, offset = following - corners, point - corners
    left_of_all = (extent[:, 0] * offset[:, 1] - extent[:, 1] * offset[:, 0] >= 0.0).all()
    return -distance if left_of_all else distance


def _between_convex(one: FloatArray, two: FloatArray) -> float:
    """Return the distance between convex shapes, 0 where they meet; two corners are a segment."""
    sides = [np.roll(shape, -1, axis=0) - shape for shape in (one, two)]
    # Convex shapes are apart if and only if some line, square to a side of one, tells them apart;
    # the directions of the sides are added for two shapes in one line.
    normals = [np.array([-s[1], s[0]]) for group in sides for s in group]
    axes = normals + [s for group in sides for s in group]
    apart = any(
        (one @ a).max() < (two @ a).min() or (two @ a).max() < (one @ a).min() for a in axes
    )
    if not apart:
        return 0.0
    pairs = [(one, two), (two, one)]
    return min(
        _point_to_segment(point, start, end)
        for points, outline in pairs
        for point in points
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True)
    )


def reference_motion(
    robot: RobotSpec,
    pose: ArrayLike,
    twist: ArrayLike,
    commands: ArrayLike,
    control_dt: float,
    *,
    steps: int = 2000,
) -> tuple[FloatArray, FloatArray]:
    """Drive from ``pose`` (3,) and ``twist`` (2,) by ``commands`` (n, 2), each for ``control_dt``.

    Returns pose (3,) [m, m, rad], its yaw not wrapped, and twist (2,) [m/s, rad/s]. Obstacles are
    ignored. Speeds are known in closed form; the unicycle is integrated by the trapezoid rule on
    ``steps`` intervals a command.
    """
    limits, lag = robot.limits, robot.actuator.lag_s
    (x, y, yaw), (v, w) = np.array(pose, dtype=np.float64), np.array(twist, dtype=np.float64)
    t = np.linspace(0.0, control_dt, steps + 1)
    for linear, angular in np.asarray(commands, dtype=np.float64):
        linear = np.clip(linear, limits.linear_min, limits.linear_max)
        angular = np.clip(angular, -limits.angular_max, limits.angular_max)
        speeds = _speeds(v, linear, lag, limits.linear_acceleration, t)
        rates = _speeds(w, angular, lag, limits.angular_acceleration, t)
        yaws = yaw + _cumulative_trapezoid(rates, t)
        x += _cumulative_trapezoid(speeds * np.cos(yaws), t)[-1]
        y += _cumulative_trapezoid(speeds * np.sin(yaws), t)[-1]
        yaw, v, w = yaws[-1], speeds[-1], rates[-1]
    return np.array([x, y, yaw]), np.array([v, w])


def _speeds(speed: float, command: float, lag: float, limit: float, t: FloatArray) -> FloatArray:
    """Solve dv/dt = clip((command - v) / lag, -limit, limit) at times ``t`` (n,) [s].

    The error shrinks evenly until the lag asks for less than the limit, then exponentially.
    """
    error = command - speed
    even_until = max(abs(error) / limit - lag, 0.0)
    even = np.sign(error) * limit * np.minimum(t, even_until)
    rest = np.maximum(t - even_until, 0.0)
    left = np.exp(-rest / lag) if lag > 0.0 else np.where(rest > 0.0, 0.0, 1.0)
    return command - (error - even) * left


def _cumulative_trapezoid(values: FloatArray, t: FloatArray) -> FloatArray:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rotation(angle: float) -> FloatArray:
    """Return the matrix that turns by ``angle`` [rad], shape (2, 2)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def solid_boxes(grid: OccupancyGrid) -> FloatArray:
    """Return the solid cells as x_min, y_min, x_max, y_max in the grid's frame, (n, 4) [m].

    Four more stand for all outside of a closed grid, each a kilometre wide.
    """
    rows, columns = np.nonzero(grid.occupied)
    height, width = np.array(grid.occupied.shape) * grid.resolution
    low = np.stack([columns, rows], axis=-1).astype(np.float64) * grid.resolution
    boxes = np.hstack([low, low + grid.resolution])
    if not grid.closed:
        return boxes
    far = 1000.0
    outside = [
        [-far, -far, 0.0, height + far],
        [width, -far, width + far, height + far],
        [-far, -far, width + far, 0.0],
        [-far, height, width + far, height + far],
    ]
    return np.vstack([boxes, outside])


def to_frame(grid: OccupancyGrid, points: FloatArray) -> FloatArray:
    """Return points of the world (..., 2) in the grid's frame [m]."""
    return (points - np.array(grid.origin)) @ _rotation(grid.yaw)
