# SPDX-License-Identifier: Apache-2.0
"""A robot from a URDF: every figure, where it comes from, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.robot_import import import_urdf, new_robot_text, robot_text

Write = Callable[..., Path]
LINK = '<link name="{0}">{1}</link><joint name="{0}_joint" type="fixed"><parent link="base_link"/>'
CHILD = '<child link="{0}"/><origin xyz="{1}" rpy="{2}"/></joint>'
SENSOR = (
    '<gazebo reference="eye"><sensor name="s" type="{kind}"><{device}><scan><horizontal>'
    "<samples>180</samples><min_angle>-1.5</min_angle><max_angle>1.5</max_angle></horizontal></scan>"
    "<range><min>0.1</min><max>8.0</max></range><noise><stddev>0.02</stddev></noise></{device}>"
    "</sensor></gazebo>"
)
WHEEL_OF = (
    '<collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="{}" length="0.1"/>'
    "</geometry></collision>"
)
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    "</inertial>"
)
PLUGIN = (
    '<gazebo><plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">'
    "{}</plugin></gazebo>"
)


def fixed(name: str, inside: str = "", xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return LINK.format(name, inside) + CHILD.format(name, xyz, rpy)


def test_wheels_and_outline(urdf: Write) -> None:
    robot = import_urdf(urdf())
    assert robot.spec.name == "test_bot"
    assert robot.spec.wheels.radius == 0.04
    assert robot.spec.wheels.separation == pytest.approx(0.24, abs=1e-6)
    # The box reaches (0.15, 0.1); the wheels' outer edges x = 0.04, y = 0.12 + 0.01.
    expected = {(0.15, 0.1), (0.15, -0.1), (0.04, 0.13), (0.04, -0.13)}
    expected |= {(-x, y) for x, y in expected}
    assert set(robot.spec.footprint.vertices) == expected
    assert robot.notes["wheels.radius"] == "left_wheel, cylinder of its collision"
    assert robot.notes["limits.linear_max"] == "default: not in the URDF; check it"


def test_the_written_file_is_the_robot(urdf: Write, tmp_path: Path) -> None:
    robot = import_urdf(urdf(more=fixed("eye") + SENSOR.format(kind="gpu_lidar", device="lidar")))
    path = tmp_path / "bot.yaml"
    path.write_text(robot_text(robot.spec, robot.notes))
    assert load_robot(path) == robot.spec


@pytest.mark.parametrize(
    ("kind", "device"),
    [("ray", "ray"), ("gpu_ray", "ray"), ("lidar", "lidar"), ("gpu_lidar", "lidar")],
)
def test_lidar_from_its_sensor(urdf: Write, kind: str, device: str) -> None:
    eye = fixed("eye", xyz="0.1 0.02 0.3", rpy=f"0 0 {math.pi / 2}")
    lidar = import_urdf(urdf(more=eye + SENSOR.format(kind=kind, device=device))).spec.lidar
    assert (lidar.num_beams, lidar.angle_min, lidar.angle_max) == (180, -1.5, 1.5)
    assert (lidar.range_min, lidar.range_max, lidar.noise_std) == (0.1, 8.0, 0.02)
    assert (lidar.x, lidar.y) == (0.1, 0.02)
    assert lidar.yaw == pytest.approx(math.pi / 2, abs=1e-8)


def test_lidar_by_its_name_gives_the_place_only(urdf: Write) -> None:
    robot = import_urdf(urdf(more=fixed("front_laser", xyz="0.12 0 0.2")))
    assert robot.spec.lidar.x == 0.12
    assert robot.notes["lidar.x"] == "link front_laser"
    assert robot.notes["lidar.num_beams"].startswith("default")
    assert import_urdf(urdf()).warnings == ("no lidar found: its place and figures are defaults",)


def test_limits_of_the_wheels(urdf: Write) -> None:
    robot = import_urdf(urdf(limit='<limit effort="1" velocity="10"/>'))
    # 10 rad/s * 0.04 m = 0.4 m/s; turning on the spot 2 * 0.4 / 0.24 = 3.3333 rad/s.
    assert robot.spec.limits.linear_max == pytest.approx(0.4)
    assert robot.spec.limits.linear_min == pytest.approx(-0.4)
    assert robot.spec.limits.angular_max == pytest.approx(10 / 3, rel=1e-6)


def test_limits_of_the_plugin(urdf: Write) -> None:
    plugin = PLUGIN.format(
        "<left_joint>left_joint</left_joint><right_joint>right_joint</right_joint>"
        "<max_linear_velocity>0.7</max_linear_velocity><wheel_radius>0.05</wheel_radius>"
        "<min_linear_velocity>-0.1</min_linear_velocity>"
        "<max_angular_velocity>2</max_angular_velocity>"
        "<max_linear_acceleration>1.5</max_linear_acceleration>"
        "<max_angular_acceleration>6</max_angular_acceleration>"
    )
    robot = import_urdf(urdf(more=plugin))
    limits = robot.spec.limits
    assert (limits.linear_min, limits.linear_max, limits.angular_max) == (-0.1, 0.7, 2.0)
    assert (limits.linear_acceleration, limits.angular_acceleration) == (1.5, 6.0)
    # The shapes win, and the difference is said.
    assert robot.spec.wheels.radius == 0.04
    assert "wheels.radius: 0.04 m by the shapes, 0.05 m by the plugin" in robot.warnings


def test_frame_lies_in_the_middle_of_the_axle(urdf: Write) -> None:
    body = '<collision><geometry><box size="0.4 0.2 0.1"/></geometry></collision>'
    robot = import_urdf(urdf(body=body, x="0.1", more=fixed("scan", xyz="0.1 0 0.2")))
    x = np.array(robot.spec.footprint.vertices)[:, 0]
    # The box from -0.2 to 0.2, seen from x = 0.1.
    assert (x.min(), x.max()) == pytest.approx((-0.3, 0.1))
    assert robot.spec.lidar.x == 0.0
    said = "the middle of the axle lies at (0.1, 0) m in base_link"
    assert any(warning.startswith(said) for warning in robot.warnings)


def test_round_robot_is_a_circle(urdf: Write) -> None:
    body = '<collision><geometry><cylinder radius="0.2" length="0.1"/></geometry></collision>'
    footprint = import_urdf(urdf(body=body)).spec.footprint
    assert (footprint.shape, footprint.radius) == ("circle", 0.2)


def test_visuals_serve_where_nothing_collides(urdf: Write) -> None:
    body = '<visual><geometry><box size="0.3 0.2 0.1"/></geometry></visual>'
    solid = '<visual><geometry><sphere radius="0.03"/></geometry></visual>'
    robot = import_urdf(urdf(body=body, solid=solid))
    assert robot.spec.wheels.radius == 0.03
    assert robot.notes["footprint"] == "hull of the visual shapes"


def test_our_own_description(tmp_path: Path) -> None:
    xacro = pytest.importorskip("xacro", reason="needs xacro (extra dev)")
    source = Path(__file__).parents[2] / "src" / "pm01_description" / "urdf" / "pm01.urdf.xacro"
    path = tmp_path / "pm01.urdf"
    for variant in ("harmonic", "fortress"):
        path.write_text(xacro.process_file(str(source), mappings={"gazebo": variant}).toxml())
        found, expected = import_urdf(path), load_robot("pm01")
        assert not found.warnings
        assert found.spec.footprint == expected.footprint
        assert found.spec.wheels == expected.wheels
        assert found.spec.limits == expected.limits
        lidar = found.spec.lidar.model_dump()
        assert lidar == pytest.approx(expected.lidar.model_dump(), abs=1e-8)
        # 3.0 + 0.65 + 2 * 0.15 + 2 * 0.04 + 0.125 + 0.01 kg
        assert found.spec.body.mass == pytest.approx(4.165)


def test_wheels_that_differ_must_be_named(urdf: Write) -> None:
    text = urdf().read_text()
    small = WHEEL_OF.format("0.02")
    more = "".join(
        f'<link name="{s}">{INERTIAL}{small}</link><joint name="{s}" type="continuous">'
        f'<parent link="base_link"/><child link="{s}"/><origin xyz="0.1 {y} 0"/>'
        '<axis xyz="0 1 0"/></joint>'
        for s, y in (("a", 0.05), ("b", -0.05))
    )
    path = urdf(text.replace("</robot>", more + "</robot>"))
    with pytest.raises(
        InputError, match=r"the wheels differ in their distance .*--wheels LEFT RIGHT"
    ):
        import_urdf(path)
    assert import_urdf(path, wheels=("a", "b")).spec.wheels.radius == 0.02
    # The order does not matter.
    assert import_urdf(path, wheels=("b", "a")).spec.wheels.separation == pytest.approx(0.1)
    with pytest.raises(InputError, match="--wheels: 'c': no such joint; there are: 'left_joint'"):
        import_urdf(path, wheels=("a", "c"))
    with pytest.raises(InputError, match="joints 'a' and 'a': lie at the same y"):
        import_urdf(path, wheels=("a", "a"))


def test_odd_names_do_no_harm(urdf: Write, tmp_path: Path) -> None:
    text = (
        urdf()
        .read_text()
        .replace("left_wheel", "l&#10;# x: 1\u2028\u00e9")
        .replace("Test Bot", "9 \u00e9!")
    )
    robot = import_urdf(urdf(text))
    assert robot.spec.name == "robot_9"
    written = robot_text(robot.spec, robot.notes)
    assert yaml.safe_load(written)["wheels"]["radius"] == 0.04
    assert written.isascii()


def test_template_loads_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "My Robot-2.yaml"
    path.write_text(new_robot_text(path))
    robot = load_robot(path)
    assert robot.name == "my_robot_2"
    # Nothing is left out, and every figure has a comment or its neighbour's.
    given = yaml.safe_load(path.read_text())
    assert set(given) == set(robot.model_dump())
    assert set(given["lidar"]) == set(robot.lidar.model_dump())
