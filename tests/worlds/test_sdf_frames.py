# SPDX-License-Identifier: Apache-2.0
"""Frames of SDF: what poses are relative to, in nested, included and merged models."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.errors import InputError
from tests.worlds.sdf_text import centres, model, read, sdf, solid

FRAMES = """
<frame name='dock'><pose>2 1 0 0 0 0.5</pose></frame>
<frame name='berth' attached_to='dock'><pose>1 0 0 0 0 0.1</pose></frame>
<frame name='rel'><pose relative_to='berth'>0 1 0 0 0 0</pose></frame>
<model name='a'><pose relative_to='rel'>0.5 0.5 0.5 0 0 0.2</pose>
 <link name='l'>SOLID</link>
 <link name='k'><pose relative_to='l'>1 0 0 0 0 0.7</pose><collision name='c'>
  <pose relative_to='l'>0 2 0 0 0 0.1</pose><geometry>BOX</geometry></collision></link>
 <joint name='j' type='fixed'><pose>0.1 0.2 0 0 0 0.3</pose>
  <parent>l</parent><child>k</child></joint>
 <frame name='f' attached_to='j'><pose>0 0.3 0 0 0 0</pose></frame>
 <link name='m'><pose relative_to='f'>0.4 0 0 0 0 0</pose>SOLID</link>
 <model name='in'><pose relative_to='m'>1 1 0 0 0 0.4</pose>
  <link name='x'><pose>0.3 0 0 0 0 0</pose>SOLID</link></model>
 <link name='n'><pose relative_to='in::x'>0.5 0.5 0 0 0 0</pose>SOLID</link>
</model>
<model name='b' placement_frame='tip'><pose relative_to='a::in::x'>3 0 0 0 0 0</pose>
 <link name='l'><pose>0 1 0 0 0 0.2</pose>SOLID</link>
 <frame name='tip' attached_to='l'><pose>1 0 0 0 0 0</pose></frame></model>
"""
INCLUDES = """
<include><uri>model://post</uri><name>p0</name></include>
<include><uri>model://post</uri><name>p1</name>
 <pose relative_to='dock'>5 0 0 0 0 0.1</pose></include>
<include><uri>model://plain</uri><name>p2</name><pose>-5 0 0 0 0 0.1</pose>
 <placement_frame>foot</placement_frame></include>
<include><uri>model://plain</uri><name>p3</name></include>
<include><uri>model://post</uri><name>p4</name><pose>-5 4 0 0 0 0.1</pose>
 <placement_frame>l</placement_frame></include>
<model name='host'><pose>-8 0 0 0 0 1</pose>
 <include merge='true'><uri>model://plain</uri><pose>1 2 0 0 0 0.2</pose></include>
 <link name='on'><pose relative_to='foot'>0 0 0.5 0 0 0</pose>SOLID</link>
</model>
"""
POST = """<sdf version='1.9'><model name='post'{anchor}><pose>0.3 0.1 0 0 0 0.2</pose>
<link name='l'><pose>0.5 0 0.5 0 0 0.3</pose>{solid}</link>
<frame name='foot' attached_to='l'><pose>0.2 0.1 -0.5 0 0 0.4</pose></frame></model></sdf>"""
# x, y and yaw of the collisions by libsdformat 12.3.0: SemanticPose::Resolve from the collision up
# to the world.
RESOLVED = [
    (2.443287, 2.99975, 0.8),
    (1.008574, 4.393164, 0.9),
    (2.564533, 4.152382, 1.8),
    (0.488434, 5.251574, 2.2),
    (1.186933, 5.141576, 2.2),
    (0.009931, 6.758569, 2.2),
    (0.08412, 0.041727, -0.2),
    (6.211766, 3.259387, 0.2),
    (-5.220619, -0.03643, -0.3),
    (0.790033, 0.199335, 0.5),
    (-5.0, 4.0, 0.1),
    (-8.961461, 2.388095, 1.5),
    (-9.047063, 2.594668, 1.9),
]
BOX = "<box><size>0.4 0.2 1</size></box>"


def filled(text: str) -> str:
    return text.replace("SOLID", solid(BOX)).replace("BOX", BOX)


def test_poses_are_those_of_libsdformat(tmp_path: Path) -> None:
    for name, anchor in (("post", " placement_frame='foot'"), ("plain", "")):
        (tmp_path / name).mkdir()
        text = POST.format(anchor=anchor, solid=solid(BOX))
        (tmp_path / name / "model.sdf").write_text(text)
    polygons = read(tmp_path, sdf(filled(FRAMES + INCLUDES))).world.polygons
    assert len(polygons) == len(RESOLVED)
    corners = np.array([[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.2, 0.1]])
    for x, y, yaw in RESOLVED:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        expected = corners @ turn.T + (x, y)
        # The figures have six digits; 0.3 m off is another one.
        assert min(np.abs(polygon - expected).max() for polygon in polygons) < 2e-6


OLD = sdf(
    "<model name='a'><pose frame=''>1 2 0 0 0 0.5</pose><link name='l'><pose>0 0 0.5 0 0 0</pose>"
    f"{solid()}</link><model name='in'><pose>2 0 0 0 0 0.3</pose><link name='l'>"
    f"<pose frame='__model__'>0 1 0.5 0 0 0</pose>{solid()}</link></model></model>",
    version="1.5",
)


@pytest.mark.skipif(not (shutil.which("gz") or shutil.which("ign")), reason="needs gz or ign")
@pytest.mark.parametrize("text", [OLD, sdf(filled(FRAMES))])
def test_world_as_gazebo_prints_it_is_the_same(tmp_path: Path, text: str) -> None:
    expected = read(tmp_path, text).world.polygons
    tool = "gz" if shutil.which("gz") else "ign"
    command = [tool, "sdf", "-p", str(tmp_path / "hall.sdf")]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = read(tmp_path, printed[printed.index("<sdf") :]).world.polygons
    assert np.concatenate(found) == pytest.approx(np.concatenate(expected), abs=1e-9)


def test_unknown_frame_of_an_old_file_is_the_usual_one(tmp_path: Path) -> None:
    posed = f"<model name='m'><pose frame='map'>1 2 0.5 0 0 0</pose><link name='l'>{solid()}</link>"
    text = sdf(f"{posed}</model>", version="1.6")
    reading = read(tmp_path, text)
    assert centres(reading) == [[1.0, 2.0]]
    assert reading.notes == ("unknown frames, taken for the usual ones: 'map' in 'the world'",)
    with pytest.raises(InputError, match=r"hall\.sdf: pose: relative_to = 'map': no such frame"):
        read(tmp_path, text.replace("1.6", "1.7"))


@pytest.mark.parametrize(
    "frames",
    [
        "<frame name='a' attached_to='b'/><frame name='b' attached_to='a'/>",
        "<frame name='a' attached_to='a'/>",
        "".join(
            f"<frame name='{c}' attached_to='{d}'/>" for c, d in zip("abc", "bca", strict=True)
        ),
        # 150 frames in a row that end nowhere; a long row must not overflow Python's stack.
        "<frame name='a' attached_to='0'/>"
        + "".join(f"<frame name='{k}' attached_to='{k + 1}'/>" for k in range(150)),
    ],
)
def test_frames_in_a_ring(tmp_path: Path, frames: str) -> None:
    text = sdf(frames, model(solid()).replace("<pose>", "<pose relative_to='a'>", 1))
    with pytest.raises(InputError, match="frames must not be relative in a ring"):
        read(tmp_path, text)


def test_models_of_one_name_stand_where_each_says(tmp_path: Path) -> None:
    text = sdf(model(solid(), "1 0 0.5 0 0 0"), model(solid(), "3 0 0.5 0 0 0"))
    assert centres(read(tmp_path, text)) == [[1.0, 0.0], [3.0, 0.0]]


def test_numbers_that_gazebo_reads_as_two(tmp_path: Path) -> None:
    # A sign begins the next number of a stream.
    assert centres(read(tmp_path, sdf(model(solid(), "0.5 41.5-0.1 0 -0 0")))) == [[0.5, 41.5]]
