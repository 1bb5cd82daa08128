# SPDX-License-Identifier: Apache-2.0
"""The simulator's arrays: one row an environment."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pm01_nav.robot import RobotSpec
from pm01_nav.sim.random import normal_values

FloatArray = NDArray[np.float64]
Arrays = TypeVar("Arrays", bound=tuple[NDArray[Any], ...])
PedestrianModel = Literal["orca", "social_force"]
ORCA, SOCIAL_FORCE = 0, 1
PEDESTRIAN_MODELS: dict[PedestrianModel, int] = {"orca": ORCA, "social_force": SOCIAL_FORCE}
BLOCK = 8
"""Beams that one vector instruction handles; rows of ranges are padded to whole blocks."""


class SimState(NamedTuple):
    """Everything that changes while the simulator runs; kernels write it in place."""

    pose: FloatArray
    """x, y, yaw in the world [m, m, rad], shape (num_envs, 3); yaw in [-pi, pi)."""
    twist: FloatArray
    """Speed of each of the drive's axes in base_link [m/s, rad/s], shape (num_envs, axes)."""
    goal: FloatArray
    """x, y in the world [m], shape (num_envs, 2)."""
    goal_polar: FloatArray
    """Distance and bearing of the goal in base_link [m, rad], shape (num_envs, 2)."""
    heading: FloatArray
    """cos and sin of the yaw, shape (num_envs, 2)."""
    ranges: NDArray[np.float32]
    """What the lidar measures, whatever its limits [m], shape (num_envs, num_beams padded to whole
    blocks); beam 0 at angle_min."""
    nearest: NDArray[np.float32]
    """Nearest reading of each sector, by REP-117 [m], shape (num_envs, num_sectors)."""
    clearance: FloatArray
    """From the footprint to the nearest obstacle [m], 0 or below in contact, shape (num_envs,)."""
    contact: NDArray[np.bool_]
    """Whether the footprint was stopped by an obstacle in this step, shape (num_envs,)."""
    world: NDArray[np.int64]
    """Index of the world in the pool, shape (num_envs,)."""
    mover_position: FloatArray
    """x, y of each mover's centre [m], shape (num_envs, most movers of a world, 2)."""
    mover_velocity: FloatArray
    """From its place a control step ago to this one [m/s], same shape; zeros in unused rows."""
    mover_radius: FloatArray
    """[m], shape (num_envs, most movers of a world)."""
    mover_target: FloatArray
    """Where a pedestrian walks [m], or a bouncing mover's direction, like ``mover_position``."""
    mover_clock: FloatArray
    """Time in a track's round, or until a pedestrian gives its target up [s], like the radius."""
    mover_leg: NDArray[np.int64]
    """Waypoint to which a pedestrian walks, like ``mover_radius``."""
    mover_count: NDArray[np.int64]
    """Movers in the present world, shape (num_envs,)."""
    path_field: NDArray[np.float32]
    """Way to the goal from each cell of the world's raster [m], (num_envs, most cells or 0)."""
    path_distance: FloatArray
    """Way to the goal from the robot [m], shape (num_envs,); see ``path_distance``."""
    age: NDArray[np.int64]
    """Observations of the episode so far, shape (num_envs,)."""
    trail: FloatArray
    """Noted places x, y [m], shape (num_envs, capacity or 0, 2)."""
    trail_length: NDArray[np.int64]
    """Places noted in the episode, the forgotten ones included, shape (num_envs,)."""
    visited: NDArray[np.float32]
    """How much of the trail lies in each sector, 0 to 1, shape (num_envs, trail sectors)."""
    rng_key: NDArray[np.uint64]
    """Which random stream belongs to the environment, shape (num_envs,)."""
    rng_count: NDArray[np.uint64]
    """How many numbers have been drawn from it, shape (num_envs,)."""


def rows(arrays: Arrays, indices: NDArray[np.int64]) -> Arrays:
    """Return copies of some rows of every array of a named tuple."""
    make: Any = type(arrays)
    return make(*(array[indices] for array in arrays))


def padded(num_beams: int) -> int:
    """Return the number of beams rounded up to whole blocks."""
    return -(-num_beams // BLOCK) * BLOCK


class Sizes(NamedTuple):
    """How wide the rows of a state are."""

    beams: int
    sectors: int
    axes: int = 2
    movers: int = 0
    path_cells: int = 0
    trail_capacity: int = 0
    trail_size: int = 0


def new_state(num_envs: int, sizes: Sizes) -> SimState:
    """Return a state of zeros."""
    return SimState(
        pose=np.zeros((num_envs, 3)),
        twist=np.zeros((num_envs, sizes.axes)),
        goal=np.zeros((num_envs, 2)),
        goal_polar=np.zeros((num_envs, 2)),
        heading=np.zeros((num_envs, 2)),
        ranges=np.zeros((num_envs, padded(sizes.beams)), dtype=np.float32),
        nearest=np.zeros((num_envs, sizes.sectors), dtype=np.float32),
        clearance=np.zeros(num_envs),
        contact=np.zeros(num_envs, dtype=np.bool_),
        world=np.zeros(num_envs, dtype=np.int64),
        mover_position=np.zeros((num_envs, sizes.movers, 2)),
        mover_velocity=np.zeros((num_envs, sizes.movers, 2)),
        mover_radius=np.zeros((num_envs, sizes.movers)),
        mover_target=np.zeros((num_envs, sizes.movers, 2)),
        mover_clock=np.zeros((num_envs, sizes.movers)),
        mover_leg=np.zeros((num_envs, sizes.movers), dtype=np.int64),
        mover_count=np.zeros(num_envs, dtype=np.int64),
        path_field=np.zeros((num_envs, sizes.path_cells), dtype=np.float32),
        path_distance=np.zeros(num_envs),
        age=np.zeros(num_envs, dtype=np.int64),
        trail=np.zeros((num_envs, sizes.trail_capacity, 2)),
        trail_length=np.zeros(num_envs, dtype=np.int64),
        visited=np.zeros((num_envs, sizes.trail_size), dtype=np.float32),
        rng_key=np.zeros(num_envs, dtype=np.uint64),
        rng_count=np.zeros(num_envs, dtype=np.uint64),
    )


class Scratch(NamedTuple):
    """Room for work within one call; nothing in it is worth keeping."""

    queue: NDArray[np.int32]
    """Cells whose neighbours may have become nearer, shape (num_envs, path cells)."""
    queued: NDArray[np.bool_]
    """Whether a cell stands in the queue, same shape."""


def new_scratch(num_envs: int, sizes: Sizes) -> Scratch:
    """Return room for ``num_envs`` environments."""
    shape = (num_envs, sizes.path_cells)
    return Scratch(np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=np.bool_))


class TrailParams(NamedTuple):
    """The trail as the kernels read it; see ``task.trail.TrailLayout``."""

    sectors: int = 0
    """0 keeps no trail."""
    interval_steps: int = 1
    capacity: int = 0
    reach: float = 1.0
    near: float = 1.0
    settled_places: int = 1


class Features(NamedTuple):
    """What is computed in each step because a task asks for it."""

    sectors: int = 0
    """Parts of the scan, as equal as can be, in each of which the nearest range is kept; 0 makes
    every beam a part."""
    trail: TrailParams = TrailParams()
    """How each robot's way so far is remembered."""
    path_distances: bool = False
    """Whether the length of the way to the goal is known; else it is the straight distance."""


class BaseParams(NamedTuple):
    """The robot's base as the kernels read it; see ``RobotSpec`` for meanings and units."""

    envelope: int
    """How the speeds of the axes limit each other: BOX or ELLIPSE of ``drives``."""
    linear_min: float
    linear_max: float
    lateral_max: float
    angular_max: float
    linear_acceleration: float
    lateral_acceleration: float
    angular_acceleration: float
    radius: float
    """Circumscribed radius of the footprint [m]."""
    vertices: FloatArray
    """Corners of a polygonal footprint [m], shape (n, 2); no rows for a circle."""
    edges: FloatArray
    """Outward unit normal and offset of each side: nx*x + ny*y <= d inside, shape (n, 3)."""
    wheel_separation: float
    """Between what drives on the left and on the right [m]."""
    padding: float
    """What the footprint is larger by, to every side [m]."""


class LidarParams(NamedTuple):
    """The lidar as the kernels read it; see ``Lidar`` for meanings and units."""

    cos: NDArray[np.float32]
    """Direction of each beam in the lidar frame, shape (num_beams padded to whole blocks,)."""
    sin: NDArray[np.float32]
    num_beams: int
    angle_min: float
    beams_per_radian: float
    range_min: float
    range_max: float
    x: float
    y: float
    mount_cos: float
    mount_sin: float
    noise_std: float
    normal_values: NDArray[np.float32]
    """Equally likely values of N(0, 1), shape (65536,)."""


class TimeStep(NamedTuple):
    """How a control step is divided."""

    dt: float
    """One integration step [s]."""
    substeps: int
    """Integration steps in a control step."""
    lag_keep: float
    """exp(-dt / lag): what a first-order lag leaves of an error after one integration step."""


class CrowdParams(NamedTuple):
    """How movers are stepped."""

    model: int
    """How pedestrians avoid each other: ORCA or SOCIAL_FORCE."""
    avoid_robot: bool
    """Whether pedestrians avoid the robot, too."""
    dt: float
    """Time of a control step [s]."""


def base_params(robot: RobotSpec) -> BaseParams:
    """Collect what the kernels need to know of the base."""
    vertices = np.array(robot.footprint.vertices, dtype=np.float64).reshape(-1, 2)
    along = np.roll(vertices, -1, axis=0) - vertices
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    normals = np.stack([along[:, 1] / length, -along[:, 0] / length], axis=-1)
    offsets = (normals * vertices).sum(axis=1)
    radius = robot.footprint.circumscribed_radius
    drive = robot.base
    linear_max, lateral_max, angular_max = drive.planar(drive.high).tolist()
    linear, lateral, angular = drive.planar(drive.acceleration).tolist()
    return BaseParams(
        envelope=drive.envelope,
        linear_min=drive.linear_min,
        linear_max=linear_max,
        lateral_max=lateral_max,
        angular_max=angular_max,
        linear_acceleration=linear,
        lateral_acceleration=lateral,
        angular_acceleration=angular,
        radius=radius,
        vertices=vertices,
        edges=np.concatenate([normals, offsets[:, None]], axis=1),
        wheel_separation=robot.wheels.separation if robot.wheels else 2.0 * radius,
        padding=0.0,
    )


def lidar_params(robot: RobotSpec) -> LidarParams:
    """Collect what the kernels need to know of the lidar."""
    lidar = robot.lidar
    angles = lidar.angle_min + lidar.angle_increment * np.arange(padded(lidar.num_beams))
    return LidarParams(
        cos=np.cos(angles).astype(np.float32),
        sin=np.sin(angles).astype(np.float32),
        num_beams=lidar.num_beams,
        angle_min=lidar.angle_min,
        beams_per_radian=1.0 / max(lidar.angle_increment, 1e-9),
        range_min=lidar.range_min,
        range_max=lidar.range_max,
        x=lidar.x,
        y=lidar.y,
        mount_cos=float(np.cos(lidar.yaw)),
        mount_sin=float(np.sin(lidar.yaw)),
        noise_std=lidar.noise_std,
        normal_values=normal_values(),
    )
