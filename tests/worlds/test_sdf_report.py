# SPDX-License-Identifier: Apache-2.0
"""What is left out of an SDF world, by which rule, and what is said of it."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds.reading import tell
from tests.worlds.sdf_text import centres, model, read, sdf, solid

CRATE = model(solid(), "2 2 0.5 0 0 0", "crate")


def box(size: str) -> str:
    return solid(f"<box><size>{size}</size></box>")


@pytest.mark.parametrize(
    ("size", "pose", "is_floor"),
    [
        ("20 20 0.1", "0 0 0 0 0 0", True),  # A slab whose top is 5 cm up.
        ("20 20 0.1", "0 0 0.1 0 0 0", True),  # Its top is 15 cm up, at the lidar's plane.
        ("20 20 0.1", "0 0 0.101 0 0 0", False),  # 15.1 cm: an obstacle that is warned of.
        ("1.5 9 0.28", "0 0 0 0 0 0.3", True),  # 1.5 m wide.
        ("1.49 9 0.28", "0 0 0 0 0 0.3", False),  # Narrower: a step, a pallet.
        ("0.2 0.2 0.06", "0 0 0 0 0 0", True),  # 3 cm up: a sill.
        ("0.2 0.2 0.062", "0 0 0 0 0 0", False),
        ("3 2 0.02", "0 0 0.06 0 0.05 0", True),  # A ramp, up to 0.06 + 1.5 sin 0.05 + 0.01 m.
        ("3 2 0.02", "0 0 0.2 0 0.1 0", False),  # A ramp to 0.2 + 0.15 + 0.01 m.
    ],
)
def test_floors(tmp_path: Path, size: str, pose: str, is_floor: bool) -> None:
    reading = read(tmp_path, sdf(model(box(size), pose, "low"), model(solid(), "50 0 0.5 0 0 0")))
    assert ([50.0, 0.0] in centres(reading)) is True
    assert len(reading.world.polygons) == 2 - is_floor
    assert (reading.notes == ("floor, left out: low/c",)) is is_floor
    assert reading.summary == "hall.sdf: read 2 of 2 shapes"


def test_shape_on_most_of_the_bounds_is_warned_of(tmp_path: Path) -> None:
    # 10 m x 10 m of bounds that reach 1 m further: 100 of 144 square metres.
    (note,) = read(tmp_path, sdf(model(box("10 10 1")))).notes
    assert note.startswith("one shape covers 69 % of the bounds")


DRIVE = "<plugin name='d' filename='libgazebo_ros_diff_drive.so'/>"
GZ_DRIVE = "<plugin filename='gz-sim-diff-drive-system' name='gz::sim::systems::DiffDrive'/>"


def robot(content: str, static: str = "") -> str:
    return model(solid(), "0 0 0.5 0 0 0", "bot").replace("</model>", f"{static}{content}</model>")


def test_own_robot_is_left_out(tmp_path: Path) -> None:
    reading = read(tmp_path, sdf(CRATE, robot(DRIVE)))
    assert centres(reading) == [[2.0, 2.0]]
    assert reading.notes == ("robot, left out: 'bot' (plugin libgazebo_ros_diff_drive.so)",)
    assert reading.summary == "hall.sdf: read 1 of 1 shapes"
    wheels = "".join(f"<joint name='{k}' type='revolute'/>" for k in range(2))
    sensor = "<link name='s'><sensor name='scan' type='gpu_lidar'/></link>"
    inside = f"<model name='base'>{GZ_DRIVE}</model>"
    for content in (GZ_DRIVE, wheels + sensor, inside):
        assert centres(read(tmp_path, sdf(CRATE, robot(content)))) == [[2.0, 2.0]]
    # What cannot drive is none: a static one, one without wheels, one that only says where it is.
    publisher = "<plugin name='p' filename='libgazebo_ros_p3d.so'/>"
    for content in (f"<static>1</static>{DRIVE}", sensor, publisher):
        reading = read(tmp_path, sdf(CRATE, robot(content)))
        assert (len(reading.world.polygons), reading.notes) == (2, ())


def test_what_a_plugin_may_move_is_named(tmp_path: Path) -> None:
    text = sdf(robot("<plugin name='o' filename='libobstacles.so'/>"))
    what = "taken where they begin, though a plugin may move them"
    assert read(tmp_path, text).notes == (f"{what}: 'bot' (libobstacles.so)",)


LOST = model(solid("<heightmap/>"), name="hills")


def test_what_is_lost_is_said_first_and_above_half_refused(tmp_path: Path) -> None:
    reading = read(tmp_path, sdf(CRATE, LOST))
    assert reading.summary == "hall.sdf: read 1 of 2 shapes"
    assert reading.notes == ("lost: heightmap (model 'hills': link 'link')",)
    text = sdf(CRATE, LOST, LOST)
    with pytest.raises(InputError, match=r"read 1 of 3 shapes; lost: heightmap .*: --partial"):
        read(tmp_path, text)
    assert len(read(tmp_path, text, partial=True).world.polygons) == 1
    with pytest.raises(InputError, match=r"holds no obstacle .*\(read 0 of 1 shapes; lost: height"):
        read(tmp_path, sdf(LOST), partial=True)


def test_missing_model_is_refused_or_counts_as_one_shape(tmp_path: Path) -> None:
    text = sdf(CRATE, "<include><uri>model://table</uri></include>" * 3)
    with pytest.raises(InputError, match=r"'model://table' \(3 times\): no such model .*--models"):
        read(tmp_path, text)
    reading = read(tmp_path, text, partial=True)
    assert reading.summary == "hall.sdf: read 1 of 4 shapes"
    assert reading.notes == ("missing models: include 'model://table' (3 times)",)


def test_lights_roads_and_planes_are_no_shapes_and_populations_are_named(tmp_path: Path) -> None:
    plane = model(solid("<plane><normal>0 0 1</normal></plane>"), "0 0 0 0 0 0", "ground")
    extras = "<light name='sun' type='directional'/><road name='r'><point>0 0 0</point></road>"
    crowd = f"<population name='trees'>{CRATE}</population>"
    reading = read(tmp_path, sdf(CRATE, plane, extras, crowd))
    assert reading.summary == "hall.sdf: read 1 of 1 shapes"
    assert reading.notes == ("not supported: population 'trees'",)


def test_notes_are_logged_as_warnings_behind_the_share(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "pm01_nav.worlds"):
        tell(read(tmp_path, sdf(CRATE)))
        tell(read(tmp_path, sdf(CRATE, LOST)))
    assert [(r.levelname, r.getMessage().split(":")[0]) for r in caplog.records] == [
        ("INFO", "hall.sdf"),
        ("INFO", "hall.sdf"),
        ("WARNING", "lost"),
    ]
