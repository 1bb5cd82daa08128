# SPDX-License-Identifier: Apache-2.0
"""Scans of other lidars, shown as a policy's own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.scan_fitting import ScanFitter
from pm01_nav.errors import InputError
from pm01_nav.task.scans import ScanGeometry

FOUR = ScanGeometry(4, -math.pi, math.pi / 2, 0.1, 5.0)
"""Behind, right, ahead, left."""
INF = np.float32(np.inf)


def scan(ranges, angle_min, increment) -> Scan:
    return Scan(0.0, angle_min, increment, 0.1, 8.0, np.array(ranges, dtype=np.float32))


def test_the_same_beams_go_through():
    ranges = [1.0, math.inf, -math.inf, 2.0]
    assert ScanFitter(FOUR).fit(scan(ranges, -math.pi, math.pi / 2)).tolist() == ranges


def test_a_lidar_that_begins_ahead():
    fitted = ScanFitter(FOUR).fit(scan([1.0, 2.0, 3.0, 4.0], 0.0, math.pi / 2))
    # Its beams look ahead, left, behind, right.
    assert fitted.tolist() == [3.0, 4.0, 1.0, 2.0]


def test_a_lidar_mounted_upside_down_counts_clockwise():
    fitted = ScanFitter(FOUR).fit(scan([1.0, 2.0, 3.0, 4.0], 0.0, -math.pi / 2))
    assert fitted.tolist() == [3.0, 2.0, 1.0, 4.0]


def test_of_more_beams_the_nearest_counts():
    # Eight beams from behind on, 45 deg apart, those between two of ours at either.
    fitted = ScanFitter(FOUR).fit(scan([8, 7, 6, 5, 4, 3, 2, 1], -math.pi, math.pi / 4))
    # Ours see at least their own beams: 8, 6, 4, 2; those between belong to one neighbour each.
    assert (fitted <= [8, 6, 4, 2]).all()
    assert fitted.min() == 1.0


def test_of_fewer_beams_the_closest_serves():
    two = scan([1.0, 2.0], -math.pi, math.pi)
    fitted = ScanFitter(FOUR).fit(two)
    assert fitted[0] == 1.0
    assert fitted[2] == 2.0
    assert set(fitted.tolist()) == {1.0, 2.0}


def test_what_the_driver_calls_invalid_hides_nothing():
    eight = scan([3, 0.0, 3, math.nan, 3, 9.0, 3, 3], -math.pi, math.pi / 4)
    assert ScanFitter(FOUR).fit(eight).tolist() == [3.0, 3.0, 3.0, 3.0]


def test_a_lidar_that_looks_elsewhere_is_refused():
    half = scan(np.ones(181), -math.pi / 2, math.pi / 180)
    with pytest.raises(InputError, match="no beam looks towards -180"):
        ScanFitter(FOUR).fit(half)


@pytest.mark.parametrize("increment", [0.0, math.nan])
def test_unusable_angles_are_refused(increment):
    with pytest.raises(InputError, match="unusable"):
        ScanFitter(FOUR).fit(scan([1.0, 1.0], 0.0, increment))


def test_a_policy_for_half_a_circle_takes_a_whole_one():
    half = ScanGeometry(3, -math.pi / 2, math.pi / 2, 0.1, 5.0)
    whole = scan([1.0, 2.0, 3.0, 4.0], -math.pi, math.pi / 2)
    assert ScanFitter(half).fit(whole).tolist() == [2.0, 3.0, 4.0]
