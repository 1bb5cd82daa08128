# SPDX-License-Identifier: Apache-2.0
"""The picture of a robot: everything stands where the description says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pm01_nav.config import merge, validate
from pm01_nav.rendering.canvas import INK, LIDAR
from pm01_nav.rendering.robot_sheet import BODY, SIZE, draw_robot, summary
from pm01_nav.robot import RobotSpec, full_circle, load_robot


def change(**changes: Any) -> RobotSpec:
    return validate(RobotSpec, merge(load_robot("pm01").model_dump(), changes), "robot.yaml")


def where(robot: RobotSpec, color: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the pixels that are nearly of a colour, caption left out."""
    pixels = np.asarray(draw_robot(robot).convert("RGB"))[:SIZE].astype(int)
    return np.argwhere(np.abs(pixels - color).max(axis=2) < 12)


def test_wheels_and_body_are_to_scale() -> None:
    robot = load_robot("pm01")
    wheels, body = where(robot, INK), where(robot, BODY)
    # Outermost: wheels of radius 0.05 m, 0.34 * 0.05 m thick, 0.28 m apart; the circle 0.17 m.
    per_metre = np.ptp(body[:, 1]) / 0.34
    assert np.ptp(wheels[:, 1]) / per_metre == pytest.approx(0.1, abs=0.01)
    assert np.ptp(wheels[:, 0]) / per_metre == pytest.approx(0.28 + 0.017, abs=0.01)
    assert wheels.mean(axis=0) == pytest.approx([SIZE / 2, SIZE / 2], abs=2)


def test_beam_zero_points_where_the_lidar_begins() -> None:
    ahead = change(lidar={"angle_min": 0.0, "angle_max": 6.2})
    behind = load_robot("pm01")
    assert where(ahead, LIDAR)[:, 1].max() > SIZE * 0.9
    assert where(behind, LIDAR)[:, 1].min() < SIZE * 0.1


@pytest.mark.parametrize(
    "changes",
    [
        {"lidar": {"num_beams": 1}},
        {"lidar": {"num_beams": 16384}},
        {"lidar": {"range_min": 50.0, "range_max": 60.0}},
        {"lidar": {"range_min": 0.0, "range_max": 0.01}},
        {"lidar": {"x": 40.0}},
        {"wheels": {"separation": 30.0}},
        {"wheels": {"radius": 1e-3}},
        {"footprint": {"radius": 1e-3}},
        {"footprint": {"radius": 5e3}},
    ],
)
def test_odd_robots_are_drawn(changes: dict[str, Any]) -> None:
    assert draw_robot(change(**changes)).size[0] == SIZE


def test_summary() -> None:
    assert summary(load_robot("pm01")) == "up to 0.5 m/s and 1.5 rad/s, 360 beams over 360\u00b0"
    half = change(lidar={**full_circle(4), "angle_max": 0.0})
    assert summary(half).endswith("4 beams over 180\u00b0")
