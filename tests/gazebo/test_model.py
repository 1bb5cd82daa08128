# SPDX-License-Identifier: Apache-2.0
"""The SDF that Gazebo's server is given."""

from __future__ import annotations

from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest

from pm01_nav.backends.body import body_model
from pm01_nav.backends.gazebo.model import mover_model, obstacles_model, seam_shift, server_world
from pm01_nav.robot import full_circle, load_robot, robot_names
from pm01_nav.worlds.world import World

ON_WHEELS = [name for name in robot_names() if load_robot(name).wheels]

SEAMS = np.radians([45.0, 135.0, 225.0, 315.0])


def world_of(name: str) -> Element:
    world = fromstring(server_world(load_robot(name), 0.004, 0.1)).find("world")
    assert world is not None
    return world


def number(element: Element, path: str) -> float:
    text = element.findtext(path)
    assert text is not None, path
    return float(text)


@pytest.mark.parametrize("name", ON_WHEELS)
def test_the_robot_weighs_what_it_is_said_to(name: str) -> None:
    robot, model = load_robot(name), world_of(name).find("model[@name='robot']")
    assert model is not None
    masses = [float(mass.text or "") for mass in model.iterfind("link/inertial/mass")]
    assert sum(masses) == pytest.approx(body_model(robot).mass)
    # The axle stands at the height of the wheels' radius, so that they touch the floor.
    assert [float(x) for x in (model.findtext("pose") or "").split()] == pytest.approx(
        [0, 0, robot.wheels.radius, 0, 0, 0]
    )
    left = model.findtext("link[@name='wheel_left']/pose") or ""
    assert float(left.split()[1]) == pytest.approx(robot.wheels.separation / 2.0)


@pytest.mark.parametrize("name", ON_WHEELS)
def test_the_drive_keeps_the_robots_limits(name: str) -> None:
    limits, drive = load_robot(name).limits, world_of(name).find("model/plugin")
    assert drive is not None
    assert number(drive, "max_linear_velocity") == limits.linear_max
    assert number(drive, "min_linear_velocity") == limits.linear_min
    assert number(drive, "min_angular_velocity") == -limits.angular_max
    assert number(drive, "max_linear_acceleration") == limits.linear_acceleration
    assert number(drive, "min_angular_acceleration") == -limits.angular_acceleration


@pytest.mark.parametrize("name", ON_WHEELS)
def test_beams_point_where_they_should_and_miss_the_seams(name: str) -> None:
    lidar = load_robot(name).lidar
    sensor = world_of(name).find("model/link/sensor[@name='lidar']")
    assert sensor is not None
    count = int(number(sensor, "lidar/scan/horizontal/samples"))
    low = number(sensor, "lidar/scan/horizontal/min_angle")
    high = number(sensor, "lidar/scan/horizontal/max_angle")
    in_sensor = np.linspace(low, high, count)
    turned = float((sensor.findtext("pose") or "").split()[5])
    assert turned + in_sensor == pytest.approx(lidar.yaw + lidar.angles)
    apart = np.abs((in_sensor[:, None] - SEAMS + np.pi) % (2.0 * np.pi) - np.pi)
    assert apart.min() > 0.15 * lidar.angle_increment


def test_beams_of_one_degree_are_turned_by_half_a_step() -> None:
    robot = load_robot("pm01")
    lidar = robot.lidar.model_copy(update=full_circle(360))
    shift = seam_shift(robot.model_copy(update={"lidar": lidar}))
    assert shift == pytest.approx(np.radians(0.5))


def test_the_lidar_is_read_once_a_control_step() -> None:
    world = world_of("pm01")
    assert number(world, "model/link/sensor[@name='lidar']/update_rate") == pytest.approx(10.0)
    assert number(world, "physics/max_step_size") == pytest.approx(0.004)
    # As fast as the machine can.
    assert number(world, "physics/real_time_factor") == 0.0


def test_obstacles_are_one_model_that_does_not_move(tmp_path) -> None:
    discs = np.array([[1.0, 2.0, 0.25], [3.0, 4.0, 0.5]])
    mesh = tmp_path / "discs.obj"
    text = obstacles_model(World("w", (0.0, 0.0, 9.0, 9.0), discs=discs), mesh)
    (model,) = fromstring(text).findall("model")
    assert model.findtext("static") == "true"
    radii = [number(part, "geometry/cylinder/radius") for part in model.iterfind("link/collision")]
    assert radii == [0.25, 0.5]
    # What is seen is drawn at a stroke.
    (visual,) = model.findall("link/visual")
    assert visual.findtext("geometry/mesh/uri") == mesh.as_uri()
    assert mesh.read_text(encoding="utf-8").count("f ") > 2 * 25


def test_nothing_is_drawn_where_nothing_stands(tmp_path) -> None:
    mesh = tmp_path / "none.obj"
    text = obstacles_model(World("w", (0.0, 0.0, 9.0, 9.0)), mesh)
    assert fromstring(text).find("model/link/visual") is None
    assert not mesh.exists()


def test_a_mover_hangs_in_the_air_too_heavy_to_be_pushed() -> None:
    (model,) = fromstring(mover_model(0.3)).findall("model")
    assert number(model, "link/inertial/mass") == 1000.0
    # A cylinder's moment about its axis is m r^2 / 2.
    assert number(model, "link/inertial/inertia/izz") == pytest.approx(45.0)
    assert model.findtext("link/gravity") == "false"
