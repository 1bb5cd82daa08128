# SPDX-License-Identifier: Apache-2.0
"""URDFs that cannot become a robot: one line each that says why."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pm01_nav.documents import MAX_BYTES
from pm01_nav.errors import InputError
from pm01_nav.robot_import import import_urdf

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
PLUGIN = (
    '<gazebo><plugin filename="gz-sim-diff-drive-system" name="gz::sim::systems::DiffDrive">'
    "{}</plugin></gazebo>"
)


def fixed(name: str, inside: str = "", xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return LINK.format(name, inside) + CHILD.format(name, xyz, rpy)


def zero(*keys: str) -> str:
    values = {"mass": "0.2", "ixx": "1", "iyy": "1", "izz": "1"} | dict.fromkeys(keys, "0")
    return (
        '<inertial><mass value="{mass}"/><inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" '
        'iyz="0" izz="{izz}"/></inertial>'
    ).format(**values)


def box(size: str) -> str:
    return f'<collision><geometry><box size="{size}"/></geometry></collision>'


def joint(parent: str, child: str, name: str = "j", kind: str = "fixed") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        "</joint>"
    )


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        ({"inertial": zero("ixx").replace('"0"', '"-1"')}, "must not be negative"),
        ({"inertial": zero("ixx").replace('"0"', '"nan"')}, "ixx = 'nan': must be 1 number"),
        ({"body": box("nan 1 1")}, "link 'base_link': collision: box: size = 'nan 1 1'"),
        ({"body": box("-1 1 1")}, "size = -1, 1, 1: must be above 0"),
        ({"body": box("0 1 1")}, "must be above 0"),
        ({"body": box("1 1")}, r"size = '1 1': must be 3 number\(s\) from -10000 to 10000"),
        ({"body": box("1e9 1 1")}, r"must be 3 number"),
        ({"body": box("a b c")}, r"size = 'a b c': must be 3 number"),
        ({"body": "<collision><geometry/></collision>"}, "must have one shape, not 0"),
        ({"body": "<collision><geometry><cone/></geometry></collision>"}, "<cone>: allowed: box"),
        ({"solid": WHEEL_OF.format("-0.1")}, "radius, length = -0.1, 0.1: must be above 0"),
        ({"solid": WHEEL_OF.format("inf")}, "radius = 'inf': must be 1 number"),
        ({"solid": box("0.1 0.1 0.1")}, "its shape is box, which tells no radius"),
        ({"more": joint("torso", "base_link")}, "joint 'j': parent 'torso': no such link"),
        ({"more": joint("base_link", "arm")}, "joint 'j': child 'arm': no such link"),
        ({"more": joint("right_wheel", "left_wheel")}, "'left_wheel': is the child of two joints"),
        ({"more": '<link name="a"/>'}, r"one link without a parent, not 2 \('a', 'base_link'\)"),
        (
            {"more": '<link name="a"/><link name="b"/>' + joint("a", "b") + joint("b", "a", "k")},
            "link 'a': its joints run in a circle",
        ),
        ({"more": '<link name="base_link"/>'}, "link 'base_link': stands twice"),
        ({"more": '<link name=""/>'}, "a link has no name"),
        ({"more": '<link name="a"/>' + joint("base_link", "a", kind="ball")}, "type = 'ball'"),
        ({"limit": '<limit velocity="fast"/>'}, "limit: velocity = 'fast': must be 1 number"),
        ({"body": box("0.1 0.1 0.1"), "x": "nan"}, "origin: xyz = 'nan 0.12 0'"),
        (
            {"more": fixed("eye") + SENSOR.format(kind="ray", device="ray").replace("8.0", "0")},
            "range",
        ),
        (
            {"more": fixed("eye") + SENSOR.format(kind="ray", device="ray").replace("180", "x")},
            "samples = 'x'",
        ),
        (
            {"more": PLUGIN.format("<max_linear_velocity>0</max_linear_velocity>")},
            r"limits\.linear_max = 0",
        ),
        (
            {"more": PLUGIN.format("<left_joint>l</left_joint><right_joint>r</right_joint>")},
            "plugin 'gz::sim::systems::DiffDrive': 'l': no such joint; there are: 'left_joint'",
        ),
        (
            {"body": box("0.1 0.4 0.1").replace("<geo", '<origin xyz="1 0 0"/><geo'), "solid": ""},
            "its shape is nothing",
        ),
    ],
)
def test_what_cannot_be_is_refused(urdf: Write, pieces: dict[str, Any], message: str) -> None:
    path = urdf(**pieces)
    with pytest.raises(InputError, match=message) as error:
        import_urdf(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("keys", [("mass",), ("iyy",), ("ixx", "iyy", "izz")])
def test_what_moves_without_mass_is_named(urdf: Write, keys: tuple[str, ...]) -> None:
    robot = import_urdf(urdf(inertial=zero(*keys)))
    said = "links that move without mass, which Gazebo drops: 'left_wheel', 'right_wheel'"
    assert said in robot.warnings


def test_axle_outside_of_the_shapes(urdf: Write) -> None:
    body = box("0.1 0.4 0.1").replace("<geo", '<origin xyz="1 0 0"/><geo')
    mesh = '<collision><geometry><mesh filename="package://a/b"/></geometry></collision>'
    with pytest.raises(InputError, match="middle of the axle lies outside of the footprint"):
        import_urdf(urdf(body=body, solid=mesh), wheel_radius=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a whole XML file"),
        ("<robot>", "is not a whole XML file"),
        ("<robot/>", "has no links"),
        ("<sdf/>", "its outermost element is <sdf>; a URDF has <robot>"),
        ('<robot><link name="base_link"/></robot>', "has no two driven wheels: .*no continuous"),
        (
            '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>',
            "must not hold a DOCTYPE",
        ),
        ("<robot>" + "<a>" * 100 + "</a>" * 100 + "</robot>", "is nested more than 64 deep"),
    ],
)
def test_what_is_no_urdf_is_refused(urdf: Write, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        import_urdf(urdf(text))


@pytest.mark.parametrize(
    ("tag", "count"), [("link", 2001), ("link/visual", 5001), ("link/collision", 5001)]
)
def test_too_many_parts_are_refused(urdf: Write, tag: str, count: int) -> None:
    part = tag.split("/")[-1]
    inside = f"<{part}/>" * count
    text = (
        inside.replace("/>", ' name="a"/>') if part == "link" else f'<link name="a">{inside}</link>'
    )
    with pytest.raises(InputError, match=f"has {count} {part}s; at most {count - 1} are allowed"):
        import_urdf(urdf(f"<robot>{text}</robot>"))


def test_a_long_chain_is_read(urdf: Write) -> None:
    chain, parent = "", "base_link"
    for index in range(1500):
        chain += (
            f'<link name="c{index}"/><joint name="k{index}" type="fixed"><parent link="{parent}"/>'
        )
        chain += f'<child link="c{index}"/><origin xyz="0 0 0.001"/></joint>'
        parent = f"c{index}"
    assert import_urdf(urdf(more=chain)).spec == import_urdf(urdf()).spec


def test_namespace_before_base_link(urdf: Write) -> None:
    base = (
        '<link name="{0}"/><joint name="foot" type="fixed"><parent link="{0}"/>'
        '<child link="{1}"/><origin xyz="0.5 0 0"/></joint>'
    )
    text = urdf().read_text()
    # An arm's base is not the robot's.
    named = text.replace("</robot>", base.format("arm_base_link", "base_link") + "</robot>")
    assert import_urdf(urdf(named)).spec == import_urdf(urdf(text)).spec
    spaced = text.replace("base_link", "r1/base_link")
    spaced = spaced.replace("</robot>", base.format("odd", "r1/base_link") + "</robot>")
    assert import_urdf(urdf(spaced)).spec == import_urdf(urdf(text)).spec


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0])
def test_options_must_be_sizes(urdf: Write, value: float) -> None:
    with pytest.raises(InputError, match=r"wheels\.radius"):
        import_urdf(urdf(), wheel_radius=value)
    with pytest.raises(InputError, match=r"bot\.urdf: footprint"):
        import_urdf(urdf(), footprint_radius=value)


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "large.urdf"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match=r"large\.urdf: has \d+ bytes; at most"):
        import_urdf(path)
