# SPDX-License-Identifier: Apache-2.0
"""Which of a URDF's sensors is the lidar, and what is left out."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot_import import ImportedRobot, import_urdf

Write = Callable[..., Path]


def sensor(
    name: str,
    link: str = "eye",
    samples: object = 360,
    view: tuple[float, float] = (-2.0, 1.0),
    kind: str = "gpu_lidar",
    more: str = "",
) -> str:
    return (
        f'<gazebo reference="{link}"><sensor name="{name}" type="{kind}"><ray><scan><horizontal>'
        f"<samples>{samples}</samples><min_angle>{view[0]}</min_angle><max_angle>{view[1]}"
        f"</max_angle>{more}</horizontal></scan><range><min>0.1</min><max>8</max></range></ray>"
        "</sensor></gazebo>"
    )


def link(
    name: str, xyz: str = "0 0 0", rpy: str = "0 0 0", kind: str = "fixed", axis: str = "0 0 1"
) -> str:
    return (
        f'<link name="{name}"/><joint name="{name}_joint" type="{kind}"><parent link="base_link"/>'
        f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
    )


EYE = link("eye", "0.1 0.02 0.06", "0 0 0.5")


def said(robot: ImportedRobot, *words: str) -> bool:
    return any(all(word in warning for word in words) for warning in robot.warnings)


def test_the_widest_level_sensor_of_many_beams_is_the_lidar(urdf: Write) -> None:
    more = (
        EYE
        + link("floor", rpy=f"0 {math.pi / 2} 0")
        + sensor("cliff", "floor", 50)
        + sensor("infrared", samples=1, view=(-0.01, 0.01))
        + sensor("sonar", samples=5, view=(-0.2, 0.2))
        + sensor("narrow", samples=720, view=(-0.5, 0.5))
        + sensor("dense", samples="1e4", view=(-3, 3), more="<resolution>2</resolution>")
        + sensor("lidar")
        + sensor("rear", samples=180)
        + sensor("nodding", "nod", 720, (-2.2, 2.2))
        + link("nod", kind="revolute", axis="0 1 0")
        + '<gazebo reference="eye"><sensor name="camera" type="depth"/></gazebo>'
    )
    robot = import_urdf(urdf(more=more))
    lidar = robot.spec.lidar
    assert (lidar.num_beams, lidar.angle_min, lidar.angle_max) == (360, -2.0, 1.0)
    assert (lidar.x, lidar.y, lidar.yaw, lidar.upside_down) == (0.1, 0.02, 0.5, False)
    # The wheels' centres lie 0.04 m above the floor, the lidar 0.06 m above them.
    assert robot.spec.body.lidar_height == pytest.approx(0.1)
    assert said(robot, "'cliff'", "left out; tilted by 90 degrees")
    assert said(robot, "'infrared'", "a range sensor of 1 beam")
    assert said(robot, "'sonar'", "a range sensor of 5 beams")
    assert said(robot, "'dense'", "20000 beams, more than 16384")
    assert said(robot, "'nodding'", "tilted by joint 'nod_joint'")
    assert said(robot, "depth sensor 'camera'")
    assert said(robot, "lidar 'rear': left out")
    assert said(robot, "lidar 'narrow': left out")
    assert import_urdf(urdf(more=more), lidar="rear").spec.lidar.num_beams == 180
    assert import_urdf(urdf(more=more), lidar="sonar").spec.lidar.num_beams == 5
    assert import_urdf(urdf(more=more), lidar="eye").notes["lidar.x"] == "link eye"
    with pytest.raises(InputError, match=r"bot\.urdf: sensor 'cliff': tilted by 90 degrees; a"):
        import_urdf(urdf(more=more), lidar="cliff")
    with pytest.raises(InputError, match=r"--lidar 'nose': no such sensor or link; there are:"):
        import_urdf(urdf(more=more), lidar="nose")


def test_one_upside_down_is_mirrored(urdf: Write) -> None:
    # Turned by 0.5 rad about z after half a turn about x: its beam at an angle a looks to 0.5 - a.
    eye = link("eye", "0.1 0 0", f"{math.pi} 0 0.5")
    lidar = import_urdf(urdf(more=eye + sensor("lidar"))).spec.lidar
    assert lidar.upside_down
    assert lidar.yaw == pytest.approx(0.5, abs=1e-8)
    # From -2 to 1 becomes from -1 to 2.
    assert (lidar.angle_min, lidar.angle_max) == (-1.0, 2.0)
    by_pitch = link("eye", "0.1 0 0", f"0 {math.pi} 0")
    lidar = import_urdf(urdf(more=by_pitch + sensor("lidar"))).spec.lidar
    # Half a turn about y: x looks backwards, and the beam at a looks to pi - a.
    assert abs(lidar.yaw) == pytest.approx(math.pi, abs=1e-8)
    assert (lidar.angle_min, lidar.angle_max, lidar.upside_down) == (-1.0, 2.0, True)


@pytest.mark.parametrize(
    ("samples", "more", "beams"),
    [
        ("541", "", 541),
        ("666.5185", "", 666),  # A whole number in Gazebo, the rest falls off.
        ("360", "<resolution>0.5</resolution>", 180),
    ],
)
def test_number_of_beams(urdf: Write, samples: str, more: str, beams: int) -> None:
    robot = import_urdf(urdf(more=EYE + sensor("lidar", samples=samples, more=more)))
    assert robot.spec.lidar.num_beams == beams


def test_pi_of_four_digits(urdf: Write) -> None:
    lidar = import_urdf(urdf(more=EYE + sensor("lidar", view=(-3.1416, 3.1416)))).spec.lidar
    assert (lidar.angle_min, lidar.angle_max) == pytest.approx((-math.pi, math.pi), abs=1e-12)


def test_a_plane_before_rings(urdf: Write) -> None:
    rings = "</horizontal><vertical><samples>16</samples></vertical><horizontal>"
    velodyne = sensor("rings", samples=1800, view=(-3.1, 3.1), more=rings)
    robot = import_urdf(urdf(more=EYE + velodyne + sensor("plane")))
    assert robot.spec.lidar.num_beams == 360
    assert said(robot, "lidar 'rings': left out")
    robot = import_urdf(urdf(more=EYE + velodyne))
    assert robot.spec.lidar.num_beams == 1800
    assert said(robot, "'rings': has several rings")


def test_a_sensor_of_the_urdf_itself(urdf: Write) -> None:
    own = (
        '<sensor name="scanner"><parent link="eye"/><origin xyz="0.05 0 0" rpy="0 0 0.25"/><ray>'
        '<horizontal samples="100" resolution="1" min_angle="-1.5" max_angle="1.5"/></ray></sensor>'
    )
    lidar = import_urdf(urdf(more=link("eye", "0.1 0 0") + own)).spec.lidar
    assert (lidar.num_beams, lidar.angle_min, lidar.x, lidar.yaw) == (100, -1.5, 0.15, 0.25)


def test_a_link_by_its_name(urdf: Write) -> None:
    mount = link("laser_mount", "0.1 0 0.2") + link("laser", "0.02 0 0", "3.14159265 0 0").replace(
        'parent link="base_link"', 'parent link="laser_mount"'
    )
    robot = import_urdf(urdf(more=mount))
    # The last of the chain, 0.1 + 0.02 m.
    assert robot.notes["lidar.x"] == "link laser"
    assert (robot.spec.lidar.x, robot.spec.lidar.upside_down) == (0.12, True)
    assert robot.notes["lidar.num_beams"].startswith("default")
    assert said(robot, "no lidar sensor found: figures are defaults, its place is link 'laser'")
    robot = import_urdf(urdf(more=link("lidar", rpy="0 1.57 0")))
    assert (robot.spec.lidar.x, robot.spec.lidar.num_beams) == (0.0, 360)
    assert said(robot, "link 'lidar': is tilted")
    assert said(robot, "no lidar found: its place and figures are defaults")
