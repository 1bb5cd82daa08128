# SPDX-License-Identifier: Apache-2.0
"""Robots: what comes with the package, and what cannot be one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pm01_nav.config import merge, validate
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec, full_circle, load_robot, robot_names

NAN, INF = float("nan"), float("inf")
SQUARE = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]


def change(**changes: Any) -> RobotSpec:
    return validate(RobotSpec, merge(load_robot("pm01").model_dump(), changes), "robot.yaml")


@pytest.mark.parametrize("name", robot_names())
def test_bundled_robot_loads(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert 0.0 < robot.footprint.inscribed_radius <= robot.footprint.circumscribed_radius
    assert len(robot.lidar.angles) == robot.lidar.num_beams
    assert robot.lidar.angles[-1] == pytest.approx(robot.lidar.angle_max, abs=1e-9)


def test_all_robots_are_there() -> None:
    expected = {"pm01", "jackal", "turtlebot3_burger", "turtlebot3_waffle"}
    assert expected <= set(robot_names())


def test_turtlebots_are_as_published() -> None:
    burger, waffle = load_robot("turtlebot3_burger"), load_robot("turtlebot3_waffle")
    # The maker's data sheet: 178 mm and 306 mm wide.
    for robot, width in ((burger, 0.178), (waffle, 0.306)):
        y = np.array(robot.footprint.vertices)[:, 1]
        assert np.ptp(y) == pytest.approx(width, abs=1e-9)
        # Both wheels, 18 mm wide, lie within.
        assert robot.wheels.separation / 2 + 0.009 <= width / 2 + 1e-9
        # 360 beams from straight ahead, a degree apart.
        assert robot.lidar.angles[0] == 0.0
        assert robot.lidar.angle_increment == pytest.approx(np.pi / 180, abs=1e-12)
    assert (burger.limits.linear_max, burger.limits.angular_max) == (0.22, 2.84)
    assert (waffle.limits.linear_max, waffle.limits.angular_max) == (0.26, 1.82)


def test_radii_of_a_box() -> None:
    footprint = load_robot("jackal").footprint
    # 0.458 m x 0.416 m: half the lesser side, and half the diagonal: sqrt(0.229^2 + 0.208^2).
    assert footprint.inscribed_radius == pytest.approx(0.208, abs=1e-12)
    assert footprint.circumscribed_radius == pytest.approx(0.309362, abs=1e-6)


def test_full_circle_does_not_repeat_a_beam() -> None:
    robot = change(lidar=full_circle(4))
    assert robot.lidar.angles == pytest.approx([-np.pi, -np.pi / 2, 0.0, np.pi / 2])
    assert change(lidar=full_circle(1)).lidar.angles == pytest.approx([-np.pi])


@pytest.mark.parametrize(
    ("angle_min", "angle_max", "clipped"),
    [
        (-3.1416, 3.1416, (-np.pi, np.pi)),
        (-3.142, 3.142, (-np.pi, np.pi)),  # 8.1e-4 rad too much
        (0.0, 6.2832, (0.0, 2 * np.pi)),
        (0, 6.284, (0.0, 2 * np.pi)),
        (-3.14159, 3.14159, (-3.14159, 3.14159)),  # Nothing to clip.
    ],
)
def test_pi_with_few_digits(angle_min: float, angle_max: float, clipped) -> None:
    lidar = change(lidar={"angle_min": angle_min, "angle_max": angle_max}).lidar
    assert (lidar.angle_min, lidar.angle_max) == pytest.approx(clipped, abs=1e-12)
    assert change(lidar=lidar.model_dump()).lidar == lidar


def test_more_than_a_full_circle_is_refused() -> None:
    # 6.2852 - 2 pi = 2.0e-3
    with pytest.raises(InputError, match="lidar: angle_max - angle_min must not exceed a full"):
        change(lidar={"angle_min": -3.1426, "angle_max": 3.1426})


def test_own_robot_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(change(name="mine").model_dump(mode="json")))
    assert load_robot(path) == change(name="mine")


def test_unknown_robot_is_refused() -> None:
    with pytest.raises(InputError, match="'r2d2': unknown; allowed: jackal, omni_disc, pm01,"):
        load_robot("r2d2")


def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_robot(tmp_path / "none.yaml")
    path = tmp_path / "text.yaml"
    for content in ("just words", "- 1", "", "a: [", "a: \t b: c"):
        path.write_text(content)
        with pytest.raises(InputError, match=r"text\.yaml"):
            load_robot(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"text\.yaml"):
        load_robot(path)


@pytest.mark.parametrize(
    "footprint",
    [
        {"radius": 0.0},
        {"radius": -0.1},
        {"radius": NAN},
        {"radius": INF},
        {"shape": "ellipse"},
        {"vertices": SQUARE},  # A circle with corners.
        {"shape": "polygon", "vertices": []},
        {"shape": "polygon", "vertices": SQUARE[:2]},
        {"shape": "polygon", "vertices": SQUARE[::-1]},
        {"shape": "polygon", "vertices": [[x + 1.0, y] for x, y in SQUARE]},
        {"shape": "polygon", "vertices": [*SQUARE[:3], [0.05, 0.0]]},
        {"shape": "polygon", "vertices": [*SQUARE[:3], [NAN, 0.1]]},
        {"shape": "polygon", "vertices": [[0.0], [1.0], [2.0]]},
    ],
)
def test_impossible_footprint_is_refused(footprint: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^robot\.yaml: footprint[^\n]*$"):
        change(footprint=footprint)


@pytest.mark.parametrize("value", [NAN, INF, -INF, "fast", None, [1.0]])
@pytest.mark.parametrize(
    ("group", "key"),
    [
        ("limits", "linear_max"),
        ("limits", "linear_min"),
        ("limits", "angular_max"),
        ("limits", "linear_acceleration"),
        ("limits", "angular_acceleration"),
        ("actuator", "lag_s"),
        ("wheels", "radius"),
        ("lidar", "range_max"),
        ("lidar", "noise_std"),
        ("lidar", "x"),
        ("lidar", "angle_min"),
    ],
)
def test_what_is_no_number_is_refused(group: str, key: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^robot\.yaml: {group}\.{key}[^\n]*$"):
        change(**{group: {key: value}})


@pytest.mark.parametrize(
    ("group", "key", "value"),
    [
        ("limits", "linear_max", 0.0),
        ("limits", "linear_max", -0.5),
        ("limits", "linear_min", 0.1),
        ("limits", "angular_max", -1.0),
        ("limits", "linear_acceleration", 0.0),
        ("limits", "angular_acceleration", -1.0),
        ("actuator", "lag_s", -0.1),
        ("wheels", "separation", 0.0),
        ("lidar", "num_beams", 0),
        ("lidar", "num_beams", -4),
        ("lidar", "num_beams", 3.5),
        ("lidar", "num_beams", 10**9),
        ("lidar", "range_min", -0.1),
        ("lidar", "range_min", 3.5),  # Not below range_max.
        ("lidar", "range_max", 0.0),
        ("lidar", "noise_std", -0.1),
        ("lidar", "angle_min", 4.0),  # Above angle_max.
        ("lidar", "angle_max", 7.0),
        ("lidar", "angle_min", -6.0),  # More than a full circle.
    ],
)
def test_value_out_of_its_range_is_refused(group: str, key: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"^robot\.yaml: {group}[^\n]*$"):
        change(**{group: {key: value}})


def test_unknown_key_names_those_allowed() -> None:
    with pytest.raises(InputError, match=r"lidar\.beams: unknown key; allowed here: num_beams, "):
        change(lidar={"beams": 7})
    with pytest.raises(InputError, match=r"robot\.yaml: colour: unknown key; allowed here: name, "):
        change(colour="red")


def test_missing_key_is_named() -> None:
    data = load_robot("pm01").model_dump()
    del data["limits"]["linear_max"]
    with pytest.raises(InputError, match=r"robot\.yaml: limits\.linear_max: is missing"):
        validate(RobotSpec, data, "robot.yaml")


@pytest.mark.parametrize("name", ["", "PM01", "a b", "../x", "1st"])
def test_name_is_a_plain_identifier(name: str) -> None:
    with pytest.raises(InputError, match=r"robot\.yaml: name"):
        change(name=name)
