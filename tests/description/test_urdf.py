# SPDX-License-Identifier: Apache-2.0
"""The URDF of PM01: frames, figures, masses, and what it tells Gazebo."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring, parse

from pm01_nav.robot import load_robot

SPEC = load_robot("pm01")
VARIANTS = ("none", "harmonic", "fortress")
LINKS = (
    *("base_footprint", "base_link", "deck_link", "lidar_link", "imu_link"),
    *("wheel_left_link", "wheel_right_link", "caster_front_link", "caster_rear_link"),
)
MASSIVE = LINKS[1:]


def vector(element: Element | None, key: str, default: str = "0 0 0") -> np.ndarray:
    text = default if element is None else element.get(key, default)
    return np.array([float(word) for word in text.split()])


def link_of(robot: Element, name: str) -> Element:
    (link,) = robot.findall(f"link[@name='{name}']")
    return link


def place(robot: Element, name: str) -> np.ndarray:
    """Where a link's origin lies in the root; no joint of this robot turns its child in z or x."""
    joint = next((j for j in robot.findall("joint") if j.find("child").get("link") == name), None)
    if joint is None:
        return np.zeros(3)
    return place(robot, joint.find("parent").get("link")) + vector(joint.find("origin"), "xyz")


def tensor(robot: Element, name: str) -> np.ndarray:
    inertia = link_of(robot, name).find("inertial/inertia")
    xx, yy, zz = (float(inertia.get(key)) for key in ("ixx", "iyy", "izz"))
    xy, xz, yz = (float(inertia.get(key)) for key in ("ixy", "ixz", "iyz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def mass(robot: Element, name: str) -> float:
    return float(link_of(robot, name).find("inertial/mass").get("value"))


def points_of(geometry: Element, rng: np.random.Generator, count: int) -> np.ndarray:
    """Points spread evenly in a solid, by drawing in the box around it."""
    (shape,) = list(geometry)
    if shape.tag == "box":
        half = vector(shape, "size") / 2
        return rng.uniform(-half, half, (count, 3))
    radius = float(shape.get("radius"))
    half_length = float(shape.get("length", 2 * radius)) / 2
    points = rng.uniform(
        [-radius, -radius, -half_length], [radius, radius, half_length], (2 * count, 3)
    )
    axes = 3 if shape.tag == "sphere" else 2
    return points[(points[:, :axes] ** 2).sum(axis=1) <= radius**2]


def rotation_about_x(angle: float) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


@pytest.mark.parametrize("name", MASSIVE)
def test_inertia_is_that_of_the_shape(robot: Element, name: str) -> None:
    link = link_of(robot, name)
    solid = link.find("collision")
    if solid is None:
        solid = link.find("visual")
    origin = solid.find("origin")
    roll, pitch, yaw = vector(origin, "rpy")
    assert (pitch, yaw) == (0.0, 0.0)
    points = points_of(solid.find("geometry"), np.random.default_rng(1), 400_000)
    points = points @ rotation_about_x(roll).T
    # I = m * mean of (|p|^2 E - p p^T) over the solid, about its own centre.
    squares = (points**2).sum(axis=1).mean() * np.eye(3)
    expected = mass(robot, name) * (squares - points.T @ points / len(points))
    found = tensor(robot, name)
    # 300 000 draws or more know a mean square to 0.2 %; 1 % leaves room.
    assert found == pytest.approx(expected, abs=0.01 * expected.max())
    centre = vector(link.find("inertial/origin"), "xyz")
    assert centre == pytest.approx(vector(origin, "xyz"), abs=1e-12)


def test_inertia_to_the_last_digit(robot: Element) -> None:
    # Chassis, 3 kg: 3 * (0.22^2 + 0.075^2) / 12 = 0.01350625, 3 * (0.2^2 + 0.075^2) / 12 =
    # 0.01140625, 3 * (0.2^2 + 0.22^2) / 12 = 0.0221.
    assert np.diag(tensor(robot, "base_link")) == pytest.approx([0.01350625, 0.01140625, 0.0221])
    # Deck, 0.65 kg: 0.65 * (3 * 0.17^2 + 0.006^2) / 12 = 0.0046982, 0.65 * 0.17^2 / 2 = 0.0093925.
    assert np.diag(tensor(robot, "deck_link")) == pytest.approx([0.0046982, 0.0046982, 0.0093925])
    # Wheel, 0.15 kg: 0.15 * (3 * 0.05^2 + 0.03^2) / 12 = 0.000105, 0.15 * 0.05^2 / 2 = 0.0001875.
    for side in ("left", "right"):
        found = np.diag(tensor(robot, f"wheel_{side}_link"))
        assert found == pytest.approx([0.000105, 0.0001875, 0.000105])
    # Caster, 0.04 kg: 0.4 * 0.04 * 0.02^2 = 6.4e-6.
    assert np.diag(tensor(robot, "caster_rear_link")) == pytest.approx([6.4e-6] * 3)
    # Lidar, 0.125 kg: 0.125 * (3 * 0.035^2 + 0.04^2) / 12, 0.125 * 0.035^2 / 2.
    found = np.diag(tensor(robot, "lidar_link"))
    assert found == pytest.approx([5.4947917e-5, 5.4947917e-5, 7.65625e-5], rel=1e-7)


@pytest.mark.parametrize("name", MASSIVE)
def test_inertia_is_possible(robot: Element, name: str) -> None:
    assert mass(robot, name) > 0
    moments = np.linalg.eigvalsh(tensor(robot, name))
    assert (moments > 0).all()
    # No moment exceeds the sum of the two others; a flat plate reaches it.
    assert moments[2] <= moments[0] + moments[1]


def test_frames_and_joints(robot: Element) -> None:
    assert {link.get("name") for link in robot.findall("link")} == set(LINKS)
    joints = {
        j.get("name"): (j.get("type"), j.find("parent").get("link"), j.find("child").get("link"))
        for j in robot.findall("joint")
    }
    assert joints == {
        "base_joint": ("fixed", "base_footprint", "base_link"),
        "deck_joint": ("fixed", "base_link", "deck_link"),
        "lidar_joint": ("fixed", "deck_link", "lidar_link"),
        "imu_joint": ("fixed", "base_link", "imu_link"),
        "wheel_left_joint": ("continuous", "base_link", "wheel_left_link"),
        "wheel_right_joint": ("continuous", "base_link", "wheel_right_link"),
        "caster_front_joint": ("fixed", "base_link", "caster_front_link"),
        "caster_rear_joint": ("fixed", "base_link", "caster_rear_link"),
    }
    for side in ("left", "right"):
        axis = robot.find(f"joint[@name='wheel_{side}_joint']/axis")
        # About +y a positive angle rolls forward.
        assert vector(axis, "xyz").tolist() == [0, 1, 0]


def test_base_footprint_can_be_left_out(expand: Callable[..., str]) -> None:
    robot = fromstring(expand(base_footprint="false"))
    assert {link.get("name") for link in robot.findall("link")} == set(MASSIVE)
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}
    assert set(MASSIVE) - children == {"base_link"}
    assert all(link_of(robot, name).find("inertial") is not None for name in MASSIVE)


def test_stands_on_wheels_and_casters(robot: Element) -> None:
    for side, sign in (("left", 1), ("right", -1)):
        link = link_of(robot, f"wheel_{side}_link")
        wheel = link.find("collision/geometry/cylinder")
        x, y, z = place(robot, f"wheel_{side}_link")
        assert float(wheel.get("radius")) == pytest.approx(SPEC.wheels.radius)
        assert z == pytest.approx(SPEC.wheels.radius)
        assert (x, y) == pytest.approx((0.0, sign * SPEC.wheels.separation / 2))
        # Turned by 90 degrees about x, the cylinder's axis is the joint's.
        assert vector(link.find("collision/origin"), "rpy") == pytest.approx([math.pi / 2, 0, 0])
    for end in ("front", "rear"):
        ball = link_of(robot, f"caster_{end}_link").find("collision/geometry/sphere")
        assert place(robot, f"caster_{end}_link")[2] == pytest.approx(float(ball.get("radius")))


def test_is_within_its_footprint_and_low(robot: Element) -> None:
    low, total, moment = math.inf, 0.0, np.zeros(3)
    for name in MASSIVE:
        link = link_of(robot, name)
        solid = link.find("collision")
        if solid is not None:
            roll = vector(solid.find("origin"), "rpy")[0]
            points = points_of(solid.find("geometry"), np.random.default_rng(0), 20_000)
            points = points @ rotation_about_x(roll).T + vector(solid.find("origin"), "xyz")
            points = points + place(robot, name)
            reach = float(np.hypot(points[:, 0], points[:, 1]).max())
            assert reach <= SPEC.footprint.radius + 1e-9, name
            low = min(low, points[:, 2].min())
        centre = place(robot, name) + vector(link.find("inertial/origin"), "xyz")
        total, moment = total + mass(robot, name), moment + mass(robot, name) * centre
    assert -1e-12 < low < 0.01
    # 3.0 + 0.65 + 2 * 0.15 + 2 * 0.04 + 0.125 + 0.01 kg
    assert total == pytest.approx(4.165)
    centre = moment / total
    assert centre[:2] == pytest.approx([0, 0], abs=1e-12)
    # Full braking at 2 m/s^2 tips it only if the centre were above 0.13 m * 9.81 / 2 = 0.64 m.
    assert 0.05 < centre[2] < 0.08


def test_figures_are_those_of_the_yaml(expand: Callable[..., str]) -> None:
    robot = fromstring(expand(gazebo="harmonic"))
    limits, lidar = SPEC.limits, SPEC.lidar
    deck = link_of(robot, "deck_link").find("collision/geometry/cylinder")
    assert float(deck.get("radius")) == SPEC.footprint.radius
    axle = place(robot, "base_link")
    assert place(robot, "lidar_link")[:2] - axle[:2] == pytest.approx([lidar.x, lidar.y])
    yaw = vector(robot.find("joint[@name='lidar_joint']/origin"), "rpy")
    assert yaw == pytest.approx([0, 0, lidar.yaw])

    fastest = (limits.linear_max + limits.angular_max * SPEC.wheels.separation / 2) / 0.05
    for side in ("left", "right"):
        limit = robot.find(f"joint[@name='wheel_{side}_joint']/limit")
        assert float(limit.get("velocity")) == pytest.approx(fastest)

    expected = {
        "wheel_separation": SPEC.wheels.separation,
        "wheel_radius": SPEC.wheels.radius,
        "min_linear_velocity": limits.linear_min,
        "max_linear_velocity": limits.linear_max,
        "min_angular_velocity": -limits.angular_max,
        "max_angular_velocity": limits.angular_max,
        "min_linear_acceleration": -limits.linear_acceleration,
        "max_linear_acceleration": limits.linear_acceleration,
        "min_angular_acceleration": -limits.angular_acceleration,
        "max_angular_acceleration": limits.angular_acceleration,
    }
    plugin = robot.find("gazebo/plugin")
    assert {key: float(plugin.findtext(key)) for key in expected} == expected
    sensor = robot.find("gazebo[@reference='lidar_link']/sensor")
    found = {element.tag: element.text for element in sensor.iter()}
    assert int(found["samples"]) == lidar.num_beams
    assert float(found["min_angle"]) == lidar.angle_min
    assert float(found["max_angle"]) == lidar.angle_max
    assert float(found["min"]) == lidar.range_min
    assert float(found["max"]) == lidar.range_max
    assert float(found["stddev"]) == lidar.noise_std


@pytest.mark.parametrize(
    ("variant", "library", "namespace", "frame"),
    [
        ("harmonic", "gz-sim", "gz::sim", "gz_frame_id"),
        ("fortress", "ignition-gazebo", "ignition::gazebo", "ignition_frame_id"),
    ],
)
def test_gazebo_tags(
    expand: Callable[..., str], variant: str, library: str, namespace: str, frame: str
) -> None:
    robot = fromstring(expand(gazebo=variant))
    plugins = [(p.get("filename"), p.get("name")) for p in robot.findall("gazebo/plugin")]
    assert plugins == [
        (f"{library}-diff-drive-system", f"{namespace}::systems::DiffDrive"),
        (f"{library}-joint-state-publisher-system", f"{namespace}::systems::JointStatePublisher"),
    ]
    links = {link.get("name") for link in robot.findall("link")}
    joints = {joint.get("name") for joint in robot.findall("joint")}
    for plugin in robot.findall("gazebo/plugin"):
        for tag in ("left_joint", "right_joint", "joint_name"):
            assert {element.text for element in plugin.findall(tag)} <= joints
    for kind, link in (("gpu_lidar", "lidar_link"), ("imu", "imu_link")):
        (sensor,) = robot.findall(f"gazebo[@reference='{link}']/sensor")
        assert sensor.get("type") == kind
        assert sensor.findtext(frame) == link
    friction = {
        g.get("reference"): float(g.findtext("mu1"))
        for g in robot.findall("gazebo")
        if g.find("mu1") is not None
    }
    # PyBullet has its own tag for the same.
    for name, value in friction.items():
        tag = link_of(robot, name).find("contact/lateral_friction")
        assert float(tag.get("value")) == value
    assert friction == {
        "wheel_left_link": 1.0,
        "wheel_right_link": 1.0,
        "caster_front_link": 0.01,
        "caster_rear_link": 0.01,
    }
    assert {g.get("reference") for g in robot.findall("gazebo")} - {None} <= links


def test_other_gazebo_is_refused(expand: Callable[..., str]) -> None:
    import xacro

    with pytest.raises(xacro.XacroException, match="classic: allowed: none, harmonic, fortress"):
        expand(gazebo="classic")


@pytest.mark.parametrize("variant", VARIANTS)
def test_urdfdom_reads_it(expand: Callable[..., str], tmp_path: Path, variant: str) -> None:
    if shutil.which("check_urdf") is None:
        pytest.skip("needs check_urdf (Debian: liburdfdom-tools)")
    path = tmp_path / "pm01.urdf"
    path.write_text(expand(gazebo=variant))
    done = subprocess.run(["check_urdf", path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "root Link: base_footprint has 1 child" in done.stdout


@pytest.mark.parametrize("variant", VARIANTS)
def test_sdformat_reads_it(expand: Callable[..., str], tmp_path: Path, variant: str) -> None:
    tool = shutil.which("gz") or shutil.which("ign")
    if tool is None:
        pytest.skip("needs gz or ign (Debian: ignition-tools, libsdformat-dev)")
    path = tmp_path / "pm01.urdf"
    path.write_text(expand(gazebo=variant))
    done = subprocess.run([tool, "sdf", "-k", path], capture_output=True, text=True, check=False)
    assert "Valid." in done.stdout, done.stdout + done.stderr
    assert "Warning" not in done.stderr
    printed = subprocess.run([tool, "sdf", "-p", path], capture_output=True, text=True, check=True)
    model = fromstring(printed.stdout).find("model")
    # Fixed joints are lumped: base and both wheels remain, 4.165 kg in all.
    assert len(model.findall("link")) == 3
    masses = [float(element.text) for element in model.findall("link/inertial/mass")]
    assert sum(masses) == pytest.approx(4.165)
    assert len(model.findall("link/sensor")) == (0 if variant == "none" else 2)
    assert len(model.findall("plugin")) == (0 if variant == "none" else 2)


def test_package_names_the_same_version_and_what_it_launches() -> None:
    from pm01_nav import __version__

    folder = Path(__file__).parents[2] / "src" / "pm01_description"
    package = parse(folder / "package.xml").getroot()
    assert package.get("format") == "3"
    assert package.findtext("version") == __version__
    assert package.findtext("license") == "Apache-2.0"
    needed = {element.text for element in package.findall("exec_depend")}
    launch = (folder / "launch" / "view_robot.launch.py").read_text()
    for name in ("robot_state_publisher", "joint_state_publisher_gui", "rviz2", "xacro"):
        assert name in launch
        assert name in needed
