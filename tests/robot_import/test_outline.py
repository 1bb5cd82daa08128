# SPDX-License-Identifier: Apache-2.0
"""Footprints and wheels from meshes, what lies where, and what is lost."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot_import import import_urdf

pytest.importorskip("trimesh", reason="needs trimesh (extra meshes)")

Write = Callable[..., Path]
MESH = '<collision>{}<geometry><mesh filename="{}"{}/></geometry></collision>'


def stl(low: tuple[float, ...], high: tuple[float, ...]) -> bytes:
    """An STL of the six sides of a box."""
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    sides = [(axis, end) for axis in range(3) for end in (low, high)]
    triangles = []
    for axis, end in sides:
        a, b, c, d = corners[corners[:, axis] == end[axis]]
        triangles += [(a, b, c), (b, c, d)]
    packed = [struct.pack("<12fH", 0, 0, 0, *np.ravel(t), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(packed)) + b"".join(packed)


def tyre(radius: float, width: float) -> bytes:
    """An STL of a wheel about y with a hub that reaches out to one side."""
    angle = np.arange(32) * np.pi / 16
    triangles = []
    for size, (inner, outer) in ((radius, (-width / 2, width / 2)), (0.01, (-0.03, 0.0))):
        ring = np.column_stack([np.cos(angle), np.zeros(32), np.sin(angle)]) * size
        for i in range(32):
            a, b = ring[i] + [0, inner, 0], ring[i - 1] + [0, inner, 0]
            c, d = ring[i] + [0, outer, 0], ring[i - 1] + [0, outer, 0]
            triangles += [(a, b, c), (b, c, d)]
    packed = [struct.pack("<12fH", 0, 0, 0, *np.ravel(t), 0) for t in triangles]
    return bytes(80) + struct.pack("<I", len(packed)) + b"".join(packed)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A workspace in which a package ``my_bot`` has two meshes."""
    folder = tmp_path / "ws" / "src" / "some_folder"
    (folder / "meshes").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>my_bot</name></package>")
    # In millimetres, 0.4 m x 0.3 m, from 0.03 m below the axle to 0.17 m above it.
    (folder / "meshes" / "body.stl").write_bytes(stl((-200, -150, -30), (200, 150, 170)))
    (folder / "meshes" / "wheel.stl").write_bytes(tyre(0.06, 0.04))
    return tmp_path / "ws"


BODY = MESH.format("", "package://my_bot/meshes/body.stl", ' scale="0.001 0.001 0.001"')
WHEEL = MESH.format("", "package://my_bot/meshes/wheel.stl", "")
RECTANGLE = {(0.2, 0.15), (-0.2, 0.15), (-0.2, -0.15), (0.2, -0.15)}


@pytest.mark.parametrize("how", ["option", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "beside"])
def test_meshes_of_a_package(
    urdf: Write, package: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    path, packages = urdf(body=BODY, solid=WHEEL), []
    if how == "option":
        packages = [package]
    elif how == "ROS_PACKAGE_PATH":
        monkeypatch.setenv(how, f"/nowhere:{package / 'src'}")
    elif how == "AMENT_PREFIX_PATH":
        (package / "share").symlink_to(package / "src")
        monkeypatch.setenv(how, str(package))
    else:
        inside = package / "src" / "some_folder" / "urdf"
        inside.mkdir()
        path = path.rename(inside / "bot.urdf")
    robot = import_urdf(path, packages=packages)
    assert set(robot.spec.footprint.vertices) == RECTANGLE
    # The wheels' joints lie at y = +-0.12 m; the hub does not touch the floor.
    assert robot.spec.wheels.radius == pytest.approx(0.06, abs=1e-6)
    assert robot.spec.wheels.separation == pytest.approx(0.24, abs=1e-6)
    assert robot.notes["wheels.radius"] == "left_wheel, mesh of its collision"
    assert robot.notes["footprint"] == "hull of the collision shapes and meshes"
    # 0.17 m above the axle, which lies 0.06 m above the floor.
    assert robot.spec.body.height == pytest.approx(0.23, abs=1e-6)


def test_a_mesh_beside_the_file_turned_and_scaled(urdf: Write, package: Path) -> None:
    path = urdf(body=MESH.format('<origin rpy="0 0 1.57079632679"/>', "b.stl", ' scale="2 1 1"'))
    (path.parent / "b.stl").write_bytes(stl((-0.1, -0.1, 0.0), (0.1, 0.1, 0.1)))
    vertices = np.array(import_urdf(path).spec.footprint.vertices)
    # 0.2 m x 0.1 m to each side, turned by a quarter; the wheels reach 0.13 m to the sides.
    assert vertices.max(axis=0) == pytest.approx([0.1, 0.2], abs=1e-4)


def test_what_lies_under_the_floor_is_left_out(urdf: Write) -> None:
    # The floor lies 0.04 m under the axle. A slab 1 m wide lies below it, and a skirt that
    # widens downwards, 0.2 m at the axle's height and 0.6 m at 0.1 m below, is cut there.
    slab = (
        '<collision><origin xyz="0 0 -0.5"/><geometry><box size="1 1 0.2"/></geometry></collision>'
    )
    path = urdf(body=slab + MESH.format("", "skirt.stl", ""))
    low, high = -0.1, 0.0
    quad = np.array([[0.3, -0.05, low], [0.3, 0.05, low], [0.1, 0.05, high], [0.1, -0.05, high]])
    half = np.concatenate([quad[[0, 1, 2]], quad[[0, 2, 3]]]).reshape(2, 3, 3)
    both = np.concatenate([half, half * np.array([-1, 1, 1])])
    packed = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(t), 0) for t in both)
    (path.parent / "skirt.stl").write_bytes(bytes(80) + struct.pack("<I", 4) + packed)
    x = np.array(import_urdf(path).spec.footprint.vertices)[:, 0]
    # At 0.05 m below the axle (the floor less 1 cm) half of the way from 0.1 to 0.3 m is done.
    assert x.max() == pytest.approx(0.2, abs=1e-4)


def test_lost_meshes_are_named_with_their_share(urdf: Write, package: Path) -> None:
    antenna = (
        '<link name="antenna"><inertial><mass value="0.1"/></inertial><collision><geometry>'
        '<mesh filename="package://other/a.dae"/></geometry></collision></link>'
        '<joint name="a" type="fixed"><parent link="base_link"/><child link="antenna"/></joint>'
    )
    robot = import_urdf(urdf(more=antenna))
    # Beside the body's box and two wheels; 0.1 kg of 0.1 + 2 x 0.2 kg.
    expected = (
        "link 'antenna': mesh 'package://other/a.dae': not found: left out of the footprint, "
        "1 of 4 shapes; its link has 20 % of the mass"
    )
    assert expected in robot.warnings
    body = MESH.format("", "package://other/body.stl", "")
    with pytest.raises(
        InputError,
        match=r"'base_link': mesh 'package://other/body.stl': not found,"
        r" and nothing else shows the body; give --packages DIR",
    ):
        import_urdf(urdf(body=body))
    with pytest.raises(InputError, match=r"--packages .*none: no such folder"):
        import_urdf(urdf(), packages=[package / "none"])
    with pytest.raises(
        InputError,
        match=r"its shape is mesh \(mesh '.*w.stl': not found\), which "
        r"tells no radius; give --wheel-radius or --packages DIR",
    ):
        import_urdf(urdf(solid=MESH.format("", "package://my_bot/w.stl", "")))
    robot = import_urdf(urdf(body=body), footprint_radius=0.2)
    assert (robot.spec.footprint.shape, robot.spec.footprint.radius) == ("circle", 0.2)
    # A mesh that is none is lost as well.
    path = urdf(more=antenna.replace("package://other/a.dae", "a.dae"))
    (path.parent / "a.dae").write_text('<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>')
    assert any("'a.dae': must not hold a DOCTYPE" in w for w in import_urdf(path).warnings)


def test_arms_can_be_left_out(urdf: Write) -> None:
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    arm = (
        f'<link name="arm">{inertial}</link><joint name="shoulder" type="revolute"><parent '
        'link="base_link"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/>'
        f'</joint><link name="hand">{box}</link><joint name="wrist" type="fixed"><parent link="arm"'
        '/><child link="hand"/><origin xyz="0.5 0 0.2"/></joint>'
    )
    robot = import_urdf(urdf(more=arm))
    assert np.array(robot.spec.footprint.vertices)[:, 0].max() == pytest.approx(0.55)
    # sqrt(0.55^2 + 0.05^2) = 0.552; the body's corner sqrt(0.15^2 + 0.1^2) = 0.180.
    said = "link 'arm' moves and reaches 0.55 m where it stands at zero, the rest 0.18 m: --without"
    assert any(warning.startswith(said) for warning in robot.warnings)
    robot = import_urdf(urdf(more=arm), without=["arm"])
    assert robot.spec.footprint == import_urdf(urdf()).spec.footprint
    assert robot.notes["footprint"] == "hull of the collision shapes, without arm"
    with pytest.raises(InputError, match="--without 'leg': no such link"):
        import_urdf(urdf(more=arm), without=["leg"])


def test_where_wheels_alone_collide_the_body_is_what_one_sees(urdf: Write) -> None:
    body = '<visual><geometry><box size="0.6 0.2 0.1"/></geometry></visual>'
    robot = import_urdf(urdf(body=body))
    assert np.array(robot.spec.footprint.vertices)[:, 0].max() == pytest.approx(0.3)
    assert robot.notes["footprint"] == "hull of the collision and visual shapes"
