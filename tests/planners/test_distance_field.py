# SPDX-License-Identifier: Apache-2.0
"""Distance fields against distances computed one by one."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.planners.distance_field import (
    DistanceFields,
    clearance_at,
    covering_discs,
    distance_at,
)
from pm01_nav.planners.scan_planner import clean_ranges
from pm01_nav.robot import full_circle, load_robot
from pm01_nav.task.scans import scan_geometry


def robot(**lidar):
    spec = load_robot("pm01")
    changed = spec.lidar.model_copy(update=full_circle(36) | lidar)
    return spec.model_copy(update={"lidar": changed})


def test_distances_by_brute_force() -> None:
    rng = np.random.default_rng(0)
    spec = robot(x=0.1, y=-0.05, yaw=0.3)
    fields_of = DistanceFields(spec, 1.5)
    scan = rng.uniform(0.2, 2.5, (3, 36))
    scan[:, ::5] = np.inf
    scan[:, 1::7] = np.nan
    scan[0, 2] = -np.inf  # too close: as near as the lidar can see
    fields = fields_of(clean_ranges(scan.astype(np.float32), scan_geometry(spec.lidar)))
    angles = spec.lidar.angles + 0.3
    for i, ranges in enumerate(scan.astype(np.float32).astype(float)):
        ranges = np.where(ranges < 0, spec.lidar.range_min, ranges)
        x, y = 0.1 + ranges * np.cos(angles), -0.05 + ranges * np.sin(angles)
        inside = (np.abs(x) < 1.5) & (np.abs(y) < 1.5)
        for px, py in rng.uniform(-1.4, 1.4, (200, 2)):
            nearest = np.hypot(x - px, y - py)[inside].min()
            found = distance_at(fields, i, px, py)
            # Never too short. The return is chosen by cells: its own centre and that of the place
            # are each up to 3.54 cm off, which may favour another one by twice both.
            assert nearest - 1e-9 <= found <= nearest + 4 * 0.0354


def test_a_millimetre_changes_the_distance() -> None:
    # One wall of returns at x = 0.5 m; a place at 0.301 m, in the middle of its cell or not.
    spec = robot(x=0.0, y=0.0)
    ranges = 0.5 / np.maximum(np.cos(spec.lidar.angles), 1e-3)
    scan = np.where(ranges < 1.0, ranges, np.inf)[None, :]
    fields = DistanceFields(spec, 1.5)(scan)
    for x in (0.3, 0.301, 0.302):
        assert distance_at(fields, 0, x, 0.0) == pytest.approx(0.5 - x, abs=1e-6)


def test_empty_scans_leave_everything_far() -> None:
    fields = DistanceFields(robot(), 1.0)(np.full((1, 36), np.inf))
    assert distance_at(fields, 0, 0.3, -0.2) == np.inf


def test_beyond_the_field_everything_is_far() -> None:
    fields = DistanceFields(robot(), 1.0)(np.full((1, 36), 0.5))
    assert distance_at(fields, 0, 1.2, 0.0) == np.inf


def test_discs_cover_the_footprint_and_little_else() -> None:
    assert covering_discs(load_robot("pm01").footprint).tolist() == [[0.0, 0.0, 0.17]]
    discs = covering_discs(load_robot("jackal").footprint)
    # Quarters of 0.229 m x 0.208 m: half their diagonal is 0.155 m.
    assert discs[:, 2] == pytest.approx(0.5 * np.hypot(0.229, 0.208))
    for x in np.linspace(-0.229, 0.229, 21):
        for y in np.linspace(-0.208, 0.208, 21):
            assert (np.hypot(discs[:, 0] - x, discs[:, 1] - y) <= discs[:, 2] + 1e-9).any()


@pytest.mark.parametrize(("heading", "expected"), [(0.0, 0.1121), (np.pi / 4, 0.0360)])
def test_room_beside_a_turned_jackal(heading: float, expected: float) -> None:
    # A return 0.345 m to the left. Straight, the nearest discs stand at (+-0.1145, 0.104):
    # sqrt(0.1145^2 + 0.241^2) - 0.1547 = 0.2668 - 0.1547 = 0.1121 m. Turned by 45 degrees, that of
    # a corner, 0.1547 m from the middle at 42.2 + 45 degrees, is nearly below the return:
    # 0.345 - 0.1547 - 0.1547 = 0.0356 m, and 0.3 mm more for the 2.8 degrees.
    spec = load_robot("jackal")
    lidar = spec.lidar.model_copy(update={"x": 0.0, "y": 0.0} | full_circle(36))
    spec = spec.model_copy(update={"lidar": lidar})
    scan = np.full((1, 36), np.inf)
    scan[0, 27] = 0.345
    fields = DistanceFields(spec, 1.0)(scan)
    discs = covering_discs(spec.footprint)
    room = clearance_at(fields, discs, 0, 0.0, 0.0, np.cos(heading), np.sin(heading))
    assert room == pytest.approx(expected, abs=1e-3)
