# SPDX-License-Identifier: Apache-2.0
"""Distance fields against distances computed one by one."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.planners.distance_field import RESOLUTION, DistanceFields
from pm01_nav.planners.scan_planner import clean_ranges
from pm01_nav.robot import full_circle, load_robot
from pm01_nav.task.observation import scan_geometry


def robot(**lidar):
    spec = load_robot("pm01")
    changed = spec.lidar.model_copy(update=full_circle(36) | lidar)
    return spec.model_copy(update={"lidar": changed})


def test_every_cell_by_brute_force() -> None:
    rng = np.random.default_rng(0)
    spec = robot(x=0.1, y=-0.05, yaw=0.3)
    fields = DistanceFields(spec, 1.5)
    scan = rng.uniform(0.2, 2.5, (3, 36))
    scan[:, ::5] = np.inf
    scan[:, 1::7] = np.nan
    scan[0, 2] = -np.inf  # too close: as near as the lidar can see
    clean = clean_ranges(scan.astype(np.float32), scan_geometry(spec.lidar))
    found = fields(clean)
    half = fields.half
    centres = (np.arange(2 * half) + 0.5 - half) * RESOLUTION
    angles = spec.lidar.angles + 0.3
    for field, ranges in zip(found, scan.astype(np.float32).astype(float), strict=True):
        ranges = np.where(ranges < 0, spec.lidar.range_min, ranges)
        x, y = 0.1 + ranges * np.cos(angles), -0.05 + ranges * np.sin(angles)
        cells = np.floor(np.stack([x, y]) / RESOLUTION)[:, np.isfinite(ranges)]
        cells = cells[:, (np.abs(cells + 0.5) < half).all(axis=0)]
        hits = (cells + 0.5) * RESOLUTION
        away = np.hypot(centres[None, :, None] - hits[0], centres[:, None, None] - hits[1]).min(
            axis=-1
        )
        assert field == pytest.approx(away, abs=1e-5)


def test_empty_scans_leave_everything_far() -> None:
    fields = DistanceFields(robot(), 1.0)
    assert fields(np.full((1, 36), np.inf)).min() >= 1.0
