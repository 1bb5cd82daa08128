# SPDX-License-Identifier: Apache-2.0
"""Whatever a URDF holds, the importer returns a robot that loads or raises an ``InputError``."""

from __future__ import annotations

import os
import re
from collections import Counter
from datetime import timedelta
from pathlib import Path

import numpy as np
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.config import validate
from pm01_nav.errors import InputError
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
<box size="0.3 0.2 0.1"/></geometry></collision><visual><geometry><mesh filename="package://a/b"/>
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
    *('xyz="0 0 1"', 'rpy="1 2 3"', '<link name="laser2"/>', "<pose>1</pose>", "package://"),
)


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """The whole file with one to four changes."""
    text = URDF
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


def check(folder: Path, seen: Counter[tuple[str, str]], content: bytes) -> None:
    path = folder / "bot.urdf"
    path.write_bytes(content)
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
    text = robot_text(robot.spec, robot.notes)
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
    path.write_text(URDF)
    robot = import_urdf(path).spec
    assert robot.limits.linear_max == 0.7
    # 0.5 + 0.1 rad, seen from base_link, whatever base_footprint is turned by.
    assert robot.lidar.yaw == 0.6
