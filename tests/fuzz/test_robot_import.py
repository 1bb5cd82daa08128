# SPDX-License-Identifier: Apache-2.0
"""Whatever a URDF holds, the importer returns a robot that loads or raises an ``InputError``."""

from __future__ import annotations

import os
import re
from collections import Counter
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.config import validate
from pm01_nav.errors import InputError
from pm01_nav.meshes import LARGEST, load_mesh
from pm01_nav.robot import RobotSpec
from pm01_nav.robot_import import import_urdf, robot_text

EXAMPLES = int(os.environ.get("PM01_FUZZ_EXAMPLES", "60"))
fuzz = settings(
    max_examples=EXAMPLES,
    deadline=timedelta(seconds=20),
    suppress_health_check=list(HealthCheck),
)

WHEEL = """<link name="{0}"><inertial><mass value="0.2"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/>
</inertial><collision><origin xyz="0 0 0" rpy="1.5708 0 0"/><geometry>
<cylinder radius="0.05" length="0.02"/></geometry></collision></link>
<joint name="{0}_joint" type="continuous"><parent link="base_link"/><child link="{0}"/>
<origin xyz="0.01 {1} 0"/><axis xyz="0 1 0"/><limit effort="1" velocity="12"/></joint>"""
URDF = f"""<?xml version="1.0"?><robot name="bot"><link name="base_footprint"/>
<joint name="base" type="fixed"><parent link="base_footprint"/><child link="base_link"/>
<origin xyz="0 0 0.05" rpy="0 0 0.1"/></joint><link name="base_link"><collision><geometry>
<box size="0.3 0.2 0.1"/></geometry></collision><collision><geometry><mesh filename="b.stl"
scale="0.1 0.2 0.1"/></geometry></collision><visual><geometry><mesh filename="package://a/b.dae"/>
</geometry></visual></link>{WHEEL.format("left", 0.12)}{WHEEL.format("right", -0.12)}
<link name="caster"><collision><geometry><sphere radius="0.03"/></geometry></collision></link>
<joint name="c" type="fixed"><parent link="base_link"/><child link="caster"/>
<origin xyz="-0.12 0 -0.02"/></joint><link name="laser"/><joint name="l" type="fixed">
<parent link="base_link"/><child link="laser"/><origin xyz="0.1 0 0.1" rpy="0 0 0.5"/></joint>
<gazebo reference="laser"><sensor name="s" type="gpu_lidar"><pose>0 0 0 0 0 0.1</pose><lidar><scan>
<horizontal><samples>180</samples><min_angle>-1.5</min_angle><max_angle>1.5</max_angle></horizontal>
</scan><range><min>0.1</min><max>8</max></range></lidar></sensor></gazebo><gazebo>
<plugin filename="gz-sim-diff-drive-system" name="d"><left_joint>left_joint</left_joint>
<right_joint>right_joint</right_joint><wheel_radius>0.05</wheel_radius>
<max_linear_velocity>0.7</max_linear_velocity></plugin></gazebo></robot>"""
# The same on springs, with an arm and with sensors that are no lidar, and without the plugin.
HARD = URDF.replace(
    '<parent link="base_link"/><child link="left"/>', '<parent link="s"/><child link="left"/>'
)
HARD = (
    HARD[: HARD.index("<gazebo>\n<plugin")]
    + """<link name="s"/><joint name="s" type="prismatic">
<parent link="base_link"/><child link="s"/><axis xyz="0 0 1"/><mimic joint="arm" offset="0.004"/>
<limit lower="-0.1" upper="0.1"/></joint><link name="arm"><collision><geometry><box size="1 1 1"/>
</geometry></collision></link><joint name="arm" type="revolute"><parent link="base_link"/>
<child link="arm"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
<gazebo reference="laser"><sensor name="cliff" type="ray"><pose>0 0 0 0 1.57 0</pose>
<ray><scan><horizontal><samples>5
</samples><resolution>1</resolution></horizontal><vertical><samples>3</samples></vertical></scan>
</ray></sensor></gazebo><sensor name="own"><parent link="laser"/><origin rpy="3.1416 0 0"/><ray>
<horizontal samples="90" min_angle="-1" max_angle="1"/></ray></sensor><transmission><joint
name="left_joint"><hardwareInterface>VelocityJointInterface</hardwareInterface></joint>
</transmission><ros2_control><joint name="right_joint"><command_interface name="velocity"/></joint>
</ros2_control></robot>"""
)
STL = (
    b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 1 0.5\n"
    b"endloop\nendfacet\nendsolid a\n"
)
OBJ = (
    b"o a\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n"
    b"f -1 -2 -3\n"
)
DAE = b"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>
<unit meter="0.01"/></asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array
id="pa" count="12">0 0 0 2 0 0 2 1 0 0 1 0</float_array><technique_common><accessor source="#pa"
count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z"
type="float"/></accessor></technique_common></source><vertices id="v"><input semantic="POSITION"
source="#p"/></vertices><polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist></mesh></geometry></library_geometries><library_nodes>
<node id="n"><rotate>0 0 1 90</rotate><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node><matrix>1 0 0 1 0 1 0 1 0 0 1 1 0 0 0 1</matrix>
<instance_node url="#n"/><node><scale>1 2 3</scale><instance_geometry url="#g"/></node></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
MESHES = {".stl": STL, ".obj": OBJ, ".dae": DAE}
NASTY = (
    *("", "0", "-1", "nan", "inf", "1e999", "-1e300", "1e-320", "9" * 400, "0x10", "1_0", "true"),
    *(
        "<",
        ">",
        "</link>",
        "<link>",
        "<!DOCTYPE a>",
        "&lt;",
        "&#10;",
        "&#x2028;",
        "<![CDATA[",
        "--",
    ),
    *('"', "'", "<mesh filename='x.stl'/>", "<mesh/>", "<sphere radius='0'/>", "<xacro:if/>"),
    *("base_link", "left", "right_joint", "fixed", "continuous", "floating", "<a>" * 100),
    *("<inertial/>", "<collision/>", "<geometry/>", "<gazebo/>", "<sensor type='ray'/>", "\x00"),
    *('type="revolute"', 'type="prismatic"', '<mimic joint="left" offset="1"/>', "caster", "steer"),
    *(
        "<vertical><samples>9</samples></vertical>",
        "mecanum",
        "planar_move",
        "laser",
    ),
    *('xyz="0 0 1"', 'rpy="1 2 3"', '<link name="laser2"/>', "<pose>1</pose>", "package://"),
)


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """One of the files with one to four changes."""
    text = draw(st.sampled_from([URDF, HARD]))
    for _ in range(draw(st.integers(1, 4))):
        if draw(st.booleans()):
            places = [match.span() for match in re.finditer(r"-?[0-9]+(\.[0-9]+)?", text)]
            start, end = draw(st.sampled_from(places)) if places else (0, 0)
            patch = repr(draw(st.floats(-3, 3) | st.integers(-3, 9) | st.floats()))
        else:
            start = draw(st.integers(0, max(len(text) - 1, 0)))
            end = start + draw(st.sampled_from([0, 0, 1, 3, 8, 40, 200]))
            patch = draw(
                st.sampled_from(NASTY) | st.text(max_size=3) | st.just(text[end : end + 80])
            )
        text = text[:start] + patch + text[end:]
    return text.encode("utf-8", "surrogateescape")


@st.composite
def mutated_mesh(draw: st.DrawFn) -> tuple[str, bytes]:
    """A mesh with one to four changes, and its suffix."""
    suffix = draw(st.sampled_from(sorted(MESHES)))
    content = MESHES[suffix]
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = start + draw(st.sampled_from([0, 0, 1, 3, 8, 40, 200]))
        patch = draw(
            st.sampled_from([b"", b"9", b"-1", b"nan", b"1e30", b"<p>", b"#n", b"f 1 1 9\n"])
            | st.binary(max_size=4)
            | st.just(content[end : end + 80])
        )
        content = content[:start] + patch + content[end:]
    return suffix, content


@fuzz
@given(mesh=mutated_mesh())
def test_mesh(tmp_path: Path, seen: Counter[tuple[str, str]], mesh: tuple[str, bytes]) -> None:
    pytest.importorskip("trimesh", reason="needs trimesh (extra meshes)")
    suffix, content = mesh
    path = tmp_path / f"mesh{suffix}"
    path.write_bytes(content)
    try:
        triangles = load_mesh(path)
    except InputError as error:
        problem = str(error)
    else:
        problem = ""
    seen["mesh", "refused" if problem else "world"] += 1
    assert "\n" not in problem
    if problem:
        return
    assert triangles.shape[1:] == (3, 3)
    assert len(triangles)
    assert np.abs(triangles).max() <= LARGEST


def check(folder: Path, seen: Counter[tuple[str, str]], content: bytes) -> None:
    path = folder / "bot.urdf"
    path.write_bytes(content)
    (folder / "b.stl").write_bytes(STL)
    try:
        robot = import_urdf(path)
    except InputError as error:
        problem = str(error)
    else:
        problem = ""
    if problem:
        assert "\n" not in problem
        seen["URDF", "refused"] += 1
        return
    seen["URDF", "world"] += 1
    text = robot_text(robot.spec, robot.notes, "\n".join(robot.warnings))
    assert validate(RobotSpec, yaml.safe_load(text), "written") == robot.spec
    assert all("\n" not in warning for warning in robot.warnings)
    assert np.isfinite(robot.spec.footprint.circumscribed_radius)
    assert robot.spec.footprint.inscribed_radius > 0


@fuzz
@given(content=mutated() | st.binary(max_size=300))
def test_urdf(tmp_path: Path, seen: Counter[tuple[str, str]], content: bytes) -> None:
    check(tmp_path, seen, content)


def test_unchanged_it_is_a_robot(tmp_path: Path, seen: Counter[tuple[str, str]]) -> None:
    path = tmp_path / "bot.urdf"
    path.write_text(HARD)
    (tmp_path / "b.stl").write_bytes(STL)
    robot = import_urdf(path).spec
    # The level lidar, not the one that hangs under it and sees less.
    assert (robot.lidar.num_beams, robot.limits.linear_max) == (180, 0.6)
    path.write_text(URDF)
    robot = import_urdf(path).spec
    assert robot.limits.linear_max == 0.7
    # 0.5 + 0.1 rad, seen from base_link, whatever base_footprint is turned by.
    assert robot.lidar.yaw == 0.6
