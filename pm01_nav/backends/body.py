# SPDX-License-Identifier: Apache-2.0
"""A robot's body as physics engines build it: a hull, two wheels and two ball casters.

The hull has the footprint's outline, so that it touches what the planar simulator says it touches.
It meets obstacles only, wheels and casters meet the floor only. A wheel's contact is that of a ball
of its radius: one point in the middle, whatever the engine makes of cylinders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]

MASS_PER_AREA = 45.0
"""Of robots that do not say what they weigh [kg/m^2]: PM01's mass by its footprint."""
WHEEL_SHARE = 0.035
"""Part of the robot's mass that each wheel has; the hull has the rest."""
CASTER_PLACE = 0.8
"""Casters stand at this part of the footprint's reach to the front and to the rear."""
CASTER_GAP = 5e-4
"""Casters hang so far over the floor [m]: of three feet in a row the wheels must bear the robot, or
they have no grip."""
MASS_HEIGHT = 1.0 / 3.0
"""The hull's centre of mass, by its height: batteries and motors lie low."""
MAX_CLEARANCE = 0.02
"""Between hull and floor [m], or half of the wheels' radius."""
WHEEL_FRICTION = 1.0
"""Coulomb's coefficient of rubber on a floor; casters slide freely."""


@dataclass(frozen=True)
class BodyModel:
    """Parts in ``base_link``, whose origin is the middle of the axle, z up [m, kg]."""

    outline: FloatArray
    """Corners of the hull (n, 2), counter-clockwise; no rows for a circle."""
    radius: float
    """Circumscribed radius of the hull."""
    bottom: float
    """z of the hull's underside."""
    top: float
    hull_mass: float
    hull_centre: FloatArray
    """Centre of mass, shape (3,)."""
    hull_inertia: FloatArray
    """Moments about the centre of mass along x, y, z [kg m^2], shape (3,)."""
    wheel_radius: float
    wheel_separation: float
    wheel_mass: float
    caster_radius: float
    caster_height: float
    """z of their centres."""
    casters: FloatArray
    """x of the front and of the rear one, shape (2,)."""
    lidar: FloatArray
    """x, y, z of the lidar, shape (3,)."""
    beams: FloatArray
    """Directions of its beams, shape (num_beams, 3)."""

    @property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        return self.hull_mass + 2.0 * self.wheel_mass


def body_model(robot: RobotSpec) -> BodyModel:
    """Return the body that a robot's description makes."""
    outline = np.array(robot.footprint.vertices, dtype=np.float64).reshape(-1, 2)
    radius, wheel = robot.footprint.circumscribed_radius, robot.driven_wheels.radius
    area, centre, moments = _plate(outline, radius)
    mass = robot.body.mass or MASS_PER_AREA * area
    hull_mass = (1.0 - 2.0 * WHEEL_SHARE) * mass
    bottom = min(MAX_CLEARANCE, 0.5 * wheel) - wheel
    top = max(robot.body.height - wheel, bottom + 0.5 * wheel)
    angles = robot.lidar.angles + robot.lidar.yaw
    # Of a prism: the plate's moments, and its height's about the two level axes.
    upright = (top - bottom) ** 2 / 12.0
    x, y = moments
    return BodyModel(
        outline=outline,
        radius=radius,
        bottom=bottom,
        top=top,
        hull_mass=hull_mass,
        hull_centre=np.array([*centre, bottom + MASS_HEIGHT * (top - bottom)]),
        hull_inertia=hull_mass * np.array([x + upright, y + upright, x + y]),
        wheel_radius=wheel,
        wheel_separation=robot.driven_wheels.separation,
        wheel_mass=WHEEL_SHARE * mass,
        caster_radius=0.4 * wheel,
        caster_height=CASTER_GAP - 0.6 * wheel,
        casters=CASTER_PLACE * _reach(outline, radius),
        lidar=np.array([robot.lidar.x, robot.lidar.y, robot.body.lidar_height - wheel]),
        beams=np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1),
    )


def _plate(outline: FloatArray, radius: float) -> tuple[float, FloatArray, tuple[float, float]]:
    """Return area, centre and the mean squares of y and of x about it, of a plate [m]."""
    if len(outline) == 0:
        return np.pi * radius**2, np.zeros(2), (radius**2 / 4.0, radius**2 / 4.0)
    following = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1]
    area = cross.sum() / 2.0
    # Sums over the triangles between the origin and each side.
    centre = (cross[:, None] * (outline + following)).sum(axis=0) / (6.0 * area)
    squares = outline**2 + outline * following + following**2
    about_origin = (cross[:, None] * squares).sum(axis=0) / (12.0 * area)
    x, y = about_origin - centre**2
    return float(area), centre, (float(y), float(x))


def _reach(outline: FloatArray, radius: float) -> FloatArray:
    """Return how far the footprint reaches along x, to the front and to the rear [m]."""
    if len(outline) == 0:
        return np.array([radius, -radius])
    return np.array([outline[:, 0].max(), outline[:, 0].min()])
