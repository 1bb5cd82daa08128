# SPDX-License-Identifier: Apache-2.0
"""The body that a description makes: masses and moments worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.backends.body import MASS_PER_AREA, body_model
from pm01_nav.robot import Body, Footprint, load_robot, robot_names

ON_WHEELS = [name for name in robot_names() if load_robot(name).wheels]

PM01 = load_robot("pm01")


def test_pm01() -> None:
    body = body_model(PM01)
    assert body.mass == pytest.approx(4.165)
    # 3.5 % in each wheel.
    assert body.wheel_mass == pytest.approx(0.145775)
    # The deck's top is 11.1 cm over the floor, the axle 5 cm; 2 cm are free below.
    assert (body.bottom, body.top) == pytest.approx((-0.03, 0.061))
    # A cylinder: m r^2 / 2 about its axis, m (3 r^2 + h^2) / 12 across.
    m, r, h = body.hull_mass, 0.17, 0.091
    across = m * (3 * r**2 + h**2) / 12
    assert body.hull_inertia == pytest.approx([across, across, m * r**2 / 2])
    assert body.hull_centre == pytest.approx([0, 0, -0.03 + 0.091 / 3])
    assert body.casters == pytest.approx([0.136, -0.136])
    # Half a millimetre under their lowest points.
    assert body.caster_height - body.caster_radius == pytest.approx(-0.05 + 0.0005)


def test_a_rectangle_off_the_axle() -> None:
    # 0.4 m x 0.2 m, its centre 0.1 m behind the axle.
    corners = ((-0.3, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.3, 0.1))
    footprint = Footprint(shape="polygon", vertices=corners)
    changes = {"footprint": footprint, "body": Body(mass=10.0, height=0.13)}
    body = body_model(PM01.model_copy(update=changes))
    assert body.hull_centre[:2] == pytest.approx([-0.1, 0.0])
    m, h = body.hull_mass, 0.11
    expected = [0.2**2 + h**2, 0.4**2 + h**2, 0.4**2 + 0.2**2]
    assert body.hull_inertia == pytest.approx(m * np.array(expected) / 12)
    assert body.casters == pytest.approx([0.08, -0.24])


def test_a_triangle_by_counting_points() -> None:
    corners = np.array([[-0.2, -0.15], [0.3, 0.0], [-0.1, 0.25]])
    footprint = Footprint(shape="polygon", vertices=tuple(map(tuple, corners.tolist())))
    body = body_model(PM01.model_copy(update={"footprint": footprint}))
    rng = np.random.default_rng(0)
    weights = rng.dirichlet([1.0, 1.0, 1.0], 400_000)  # evenly spread in the triangle
    points = weights @ corners
    assert body.hull_centre[:2] == pytest.approx(points.mean(axis=0), abs=1e-3)
    x, y = points.var(axis=0)
    level = (body.top - body.bottom) ** 2 / 12
    expected = body.hull_mass * np.array([y + level, x + level, x + y])
    assert body.hull_inertia == pytest.approx(expected, rel=0.01)


def test_mass_by_area_where_none_is_given() -> None:
    body = body_model(PM01.model_copy(update={"body": Body()}))
    assert body.mass == pytest.approx(MASS_PER_AREA * np.pi * 0.17**2)


@pytest.mark.parametrize("name", ON_WHEELS)
def test_every_robot_has_a_possible_body(name: str) -> None:
    body = body_model(load_robot(name))
    assert body.bottom < 0 < body.top
    moments = np.sort(body.hull_inertia)
    assert moments[0] > 0
    assert moments[2] <= moments[0] + moments[1]
    # The centre of mass lies between the casters.
    assert body.casters[1] < body.hull_centre[0] < body.casters[0]
    # Braking at 0.5 g does not tip it.
    height = body.hull_centre[2] + body.wheel_radius
    assert 0.5 * height < body.casters[0] - body.hull_centre[0]
