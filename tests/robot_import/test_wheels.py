# SPDX-License-Identifier: Apache-2.0
"""Which wheels drive, how far apart they are, and which drives are none of ours."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot_import import import_urdf

Write = Callable[..., Path]
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
TYRE = (
    '<collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="{}" length="0.02"/>'
    "</geometry></collision>"
)
BODY = (
    '<link name="base_link"><collision><geometry><box size="0.5 0.2 0.1"/></geometry></collision>'
    "</link>"
)
SIDES = (("l", 0.15), ("r", -0.15))


def joint(
    name: str,
    parent: str = "base_link",
    kind: str = "continuous",
    xyz: str = "0 0 0",
    axis: str = "0 1 0",
    inside: str = "",
    more: str = "",
) -> str:
    """A link and the joint of the same name that carries it."""
    return (
        f'<link name="{name}">{INERTIAL}{inside}</link><joint name="{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f"{more}</joint>"
    )


def wheel(name: str, parent: str = "base_link", xyz: str = "0 0 0", radius: float = 0.05) -> str:
    return joint(name, parent, xyz=xyz, inside=TYRE.format(radius))


def robot(*parts: str) -> str:
    return f'<robot name="bot">{BODY}{"".join(parts)}</robot>'


def on_arms(kind: str, axis: str, more: str = "") -> str:
    """Two wheels that hang 0.1 m out and 0.02 m down from a joint each."""
    return "".join(
        joint(f"{s}_arm", kind=kind, xyz=f"0 {y - np.sign(y) * 0.1} 0", axis=axis, more=more)
        + wheel(f"{s}_wheel", f"{s}_arm", f"0 {np.sign(y) * 0.1} -0.02")
        for s, y in SIDES
    )


LIMIT = '<limit lower="-0.3" upper="0.3" effort="1" velocity="1"/>'


@pytest.mark.parametrize(
    ("kind", "axis", "more"),
    [
        ("prismatic", "0 0 1", LIMIT),
        ("prismatic", "0 1 0", LIMIT),
        ("revolute", "0 1 0", LIMIT),
        ("revolute", "1 0 0", LIMIT),
        ("revolute", "0 1 0", LIMIT + '<mimic joint="l_wheel" multiplier="-1"/>'),
        ("fixed", "0 0 1", ""),
    ],
)
def test_wheels_on_suspensions_drive(urdf: Write, kind: str, axis: str, more: str) -> None:
    spec = import_urdf(urdf(robot(on_arms(kind, axis, more)))).spec
    assert spec.wheels.separation == pytest.approx(0.30, abs=1e-9)
    assert spec.wheels.radius == 0.05


def test_a_mimic_joint_stands_at_its_offset(urdf: Write) -> None:
    more = LIMIT + '<mimic joint="l_wheel" offset="0.03"/>'
    laser = joint("laser", kind="fixed", xyz="0 0 0.1")
    spec = import_urdf(urdf(robot(on_arms("prismatic", "0 0 1", more), laser))).spec
    # The wheels' centres lie at -0.02 + 0.03 m, the floor 0.05 m below them, at -0.04 m.
    assert spec.body.lidar_height == pytest.approx(0.14)


def test_only_a_vertical_hinge_makes_a_caster(urdf: Write) -> None:
    casters = "".join(
        joint(f"{s}_fork", xyz=f"0.2 {y} 0", axis="0 0 1") + wheel(f"{s}_roll", f"{s}_fork")
        for s, y in SIDES
    )
    robot_ = import_urdf(urdf(robot(casters, *(wheel(s, xyz=f"0 {y} 0") for s, y in SIDES))))
    assert robot_.notes["wheels.separation"] == "between l and r"
    # Without a hinge, a caster is known by its name or by what a controller turns.
    small = [wheel(f"{s}_caster_wheel", xyz=f"0.2 {y / 2} -0.03", radius=0.02) for s, y in SIDES]
    robot_ = import_urdf(urdf(robot(*small, *(wheel(s, xyz=f"0 {y} 0") for s, y in SIDES))))
    assert robot_.notes["wheels.separation"] == "between l and r"
    driven = "".join(
        f'<joint name="{s}"><command_interface name="velocity"/></joint>' for s, _ in SIDES
    )
    unnamed = [part.replace("caster_wheel", "roll") for part in small]
    parts = [*unnamed, *(wheel(s, xyz=f"0 {y} 0") for s, y in SIDES)]
    with pytest.raises(InputError, match=r"the wheels differ in their distance"):
        import_urdf(urdf(robot(*parts)))
    control = f'<ros2_control name="c" type="system">{driven}</ros2_control>'
    robot_ = import_urdf(urdf(robot(*parts, control)))
    assert robot_.notes["wheels.separation"] == "between l and r"


def many_wheels(*xs: float) -> str:
    return "".join(wheel(f"{s}{i}", xyz=f"{x} {y} 0") for i, x in enumerate(xs) for s, y in SIDES)


SKID = (
    '<gazebo><plugin filename="libgazebo_ros_skid_steer_drive.so" name="d">'
    "<leftFrontJoint>l0</leftFrontJoint><rightFrontJoint>r0</rightFrontJoint>"
    "<leftRearJoint>l1</leftRearJoint><rightRearJoint>r1</rightRearJoint>"
    "<wheelSeparation>0.45</wheelSeparation><wheelDiameter>0.1</wheelDiameter></plugin></gazebo>"
)


@pytest.mark.parametrize("xs", [(0.1, -0.1), (0.2, 0.05, -0.1)])
def test_skid_steering(urdf: Write, xs: tuple[float, ...]) -> None:
    robot_ = import_urdf(urdf(robot(many_wheels(*xs))))
    assert robot_.spec.wheels.separation == pytest.approx(0.30, abs=1e-9)
    said = f"{2 * len(xs)} wheels: taken for one axle in the middle of them; they skid in turns"
    assert any(w.startswith(said) and "pm01 identify" in w for w in robot_.warnings)
    # The body's 0.25 m to the front, seen from the middle of the wheels.
    x = np.array(robot_.spec.footprint.vertices)[:, 0]
    assert x.max() == pytest.approx(0.25 - np.mean(xs), abs=1e-4)


def test_the_plugin_knows_the_separation_that_skidding_takes(urdf: Write) -> None:
    robot_ = import_urdf(urdf(robot(many_wheels(0.1, -0.1), SKID)))
    assert robot_.spec.wheels.separation == 0.45
    assert "plugin of the drive" in robot_.notes["wheels.separation"]
    assert "wheels.separation: 0.3 m by the shapes, 0.45 m by the plugin" in robot_.warnings


def test_wheels_by_the_plugin_come_first(urdf: Write) -> None:
    # Left and right are exchanged, and revolute joints with limits far away turn as well.
    plugin = (
        '<gazebo><plugin filename="libgazebo_ros_diff_drive.so" name="d"><leftJoint>r0</leftJoint>'
        "<rightJoint>l0</rightJoint></plugin></gazebo>"
    )
    parts = many_wheels(0.1, -0.1).replace('type="continuous"', 'type="revolute"')
    limit = '<limit lower="-1e16" upper="1e16" effort="1" velocity="1"/></joint>'
    parts = parts.replace("</joint>", limit)
    robot_ = import_urdf(urdf(robot(parts, plugin)))
    assert robot_.notes["wheels.separation"] == "between r0 and l0"
    assert robot_.spec.wheels.separation == pytest.approx(0.30, abs=1e-9)
    assert any("lies at (0.1, 0) m" in warning for warning in robot_.warnings)
    assert len(import_urdf(urdf(robot(parts))).notes["wheels.separation"].split(" and ")) == 4


def plugin(filename: str) -> str:
    return f'<gazebo><plugin filename="{filename}" name="p"/></gazebo>'


def steered(name: str, limit: str = LIMIT) -> str:
    return "".join(
        joint(f"{s}_{name}", kind="revolute", xyz=f"0.2 {y} 0", axis="0 0 1", more=limit)
        + wheel(f"{s}_front_wheel", f"{s}_{name}")
        for s, y in SIDES
    )


FDIR = "".join(
    f'<gazebo reference="{s}{i}"><collision><surface><friction><ode><fdir1>1 {way} 0</fdir1></ode>'
    "</friction></surface></collision></gazebo>"
    for s, i, way in (("l", 0, 1), ("r", 0, -1), ("l", 1, -1), ("r", 1, 1))
)
OMNI, CAR = "an omnidirectional robot", r"a car-like robot \(Ackermann steering\)"


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([plugin("libgazebo_ros_planar_move.so")], OMNI),
        ([plugin("gz-sim-mecanum-drive-system")], OMNI),
        ([plugin("libgazebo_ros_planar_move.so"), plugin("gz-sim-diff-drive-system")], OMNI),
        ([plugin("gz-sim-ackermann-steering-system")], CAR),
        (["<gazebo><parameters>/a/mecanum_drive_controller.yaml</parameters></gazebo>"], OMNI),
        ([steered("knuckle")], rf"{CAR}: joint 'l_knuckle' steers"),
        ([steered("steering", "")], rf"{CAR}: joint 'l_steering' steers"),
    ],
)
def test_other_drives_are_named(urdf: Write, parts: list[str], message: str) -> None:
    path = urdf(robot(many_wheels(0.1, -0.1), *parts))
    with pytest.raises(InputError, match=message) as error:
        import_urdf(path)
    assert "--wheels LEFT RIGHT takes it for one" in str(error.value)
    assert "\n" not in str(error.value)
    assert import_urdf(path, wheels=("l1", "r1")).spec.wheels.separation == pytest.approx(0.3)


def test_oblique_friction_alone_is_doubted(urdf: Write) -> None:
    robot_ = import_urdf(urdf(robot(many_wheels(0.1, -0.1), FDIR)))
    assert any("as mecanum wheels do: taken for plain ones" in w for w in robot_.warnings)


def test_mecanum_by_the_names_of_wheels(urdf: Write) -> None:
    text = robot(many_wheels(0.1, -0.1))
    text = re.sub(r'"([lr]\d)"', r'"\1_mecanum"', text)
    with pytest.raises(InputError, match=rf"{OMNI} \(mecanum wheels\)"):
        import_urdf(urdf(text))
    # Where nothing turns, as in models that slide.
    with pytest.raises(InputError, match=OMNI):
        import_urdf(
            urdf(robot(many_wheels(0.1).replace("continuous", "fixed"), plugin("planar_move")))
        )
