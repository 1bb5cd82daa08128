# SPDX-License-Identifier: Apache-2.0
"""What a trail shows, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.task.trail import Trail, TrailLayout, familiarity, visited_sectors

FOUR = TrailLayout(sectors=4, interval_s=0.2, capacity=3, reach=2.0, near=0.5)


def see(places, pose=(0.0, 0.0, 0.0)):
    places = np.array(places, dtype=float).reshape(1, -1, 2)
    return visited_sectors(FOUR, places, np.array([pose]))[0]


def test_a_place_in_the_middle_of_a_sector() -> None:
    # Four sectors from behind: their middles look to -135, -45, 45 and 135 degrees. A place 1 m
    # away weighs 1 - 1 / 2 = 0.5, shown as 0.5 / 1.5.
    half = np.sqrt(0.5)
    assert see([(half, half)]) == pytest.approx([0, 0, 1 / 3, 0], abs=1e-6)
    assert see([(-half, -half)]) == pytest.approx([1 / 3, 0, 0, 0], abs=1e-6)


def test_a_place_between_two_sectors_is_shared() -> None:
    # Straight ahead, and straight behind, where the last sector meets the first.
    assert see([(1.0, 0.0)]) == pytest.approx([0, 0.2, 0.2, 0], abs=1e-6)
    assert see([(-1.0, 0.0)]) == pytest.approx([0.2, 0, 0, 0.2], abs=1e-6)


def test_the_robot_turns_beneath_its_trail() -> None:
    # A place to the east, seen while looking north, lies to the right.
    assert see([(1.0, 0.0)], pose=(0.0, 0.0, np.pi / 2)) == pytest.approx([0.2, 0.2, 0, 0])


def test_far_near_and_no_places() -> None:
    half = np.sqrt(0.5)
    assert see([(3.0, 3.0)]) == pytest.approx([0, 0, 0, 0])
    # At 0.25 m: 0.25 / 0.5 x (1 - 0.125) = 0.4375.
    assert see([(0.25 * half, 0.25 * half)])[2] == pytest.approx(0.4375 / 1.4375)
    assert see([(0.0, 0.0)]) == pytest.approx([0, 0, 0, 0])
    assert see([]) == pytest.approx([0, 0, 0, 0])


def test_sums_saturate() -> None:
    half = np.sqrt(0.5)
    # Three places of weight 0.5 sum up to 1.5, shown as 1.5 / 2.5.
    assert see([(half, half)] * 3)[2] == pytest.approx(0.6)


def test_dead_reckoning() -> None:
    trail = Trail(FOUR, 0.1, 2)
    # One robot drives straight at 0.5 m/s, the other one turns on the spot; 20 steps of 0.1 s.
    velocity = np.array([[0.5, 0.0], [0.0, 1.0]])
    for _ in range(21):
        seen = trail.follow(velocity)
    # Places at steps 16, 18 and 20 are left: 0.2, 0.1 and 0 m behind the first robot. They weigh
    # 0.4 x 0.9 and 0.2 x 0.95, shared by the two sectors behind: 0.275 each.
    assert seen[0] == pytest.approx([0.275 / 1.275, 0, 0, 0.275 / 1.275, 0], abs=1e-6)
    assert seen[1] == pytest.approx([0, 0, 0, 0, 0], abs=1e-6)


def test_dead_reckoning_on_an_arc() -> None:
    trail = Trail(TrailLayout(sectors=4, interval_s=10.0, capacity=2, reach=4.0), 0.1, 1)
    for _ in range(32):
        seen = trail.follow([[0.5, np.pi / 3.1]])
    # Half a circle of radius 0.5 x 3.1 / pi in 3.1 s: the start lies one diameter, 0.98676 m, to
    # the left, between the two left sectors. It weighs 1 - 0.98676 / 4 = 0.75331.
    part = 0.5 * 0.75331
    assert seen[0] == pytest.approx([0, 0, part / (1 + part), part / (1 + part), 0], abs=1e-4)


def test_a_place_is_familiar_near_one_that_was_left() -> None:
    places, pose = np.array([[(0.3, 0.4), (1.0, 0.0)]]), np.zeros((1, 3))
    layout = TrailLayout(near=2.0)
    # 1 - 0.5 / 2 by the first one, 1 - 1 / 2 by the second.
    for left, expected in ((places, 0.75), (places[:, 1:], 0.5), (places[:, 2:], 0.0)):
        assert familiarity(layout, left, pose) == pytest.approx([expected])


def test_one_that_goes_there_and_back_comes_to_familiar_places() -> None:
    # A place is noted at each step and settled after 3; 8 steps of 0.1 m ahead, then back.
    layout = TrailLayout(interval_s=0.1, capacity=8, near=0.25, settled_places=3)
    trail = Trail(layout, 0.1, 1)
    velocities = [(0.0, 0.0), *[(1.0, 0.0)] * 8, *[(-1.0, 0.0)] * 8]
    here = [float(trail.follow([velocity])[0, -1]) for velocity in velocities]
    # Each step is the mean of the speeds at its ends: 0.05 m at first, 0 m at the turn. Ahead, the
    # last settled place lies three steps, 0.3 m, behind.
    assert here[:9] == pytest.approx([0.0] * 9)
    # Places: 0, 0.05, 0.15, ..., 0.75 (8th step), 0.75 (9th), then 0.65, ... At the 11th step, at
    # 0.55 m, the place 0.55 m of the 6th step has five behind it; at the 16th, at 0.05 m, the
    # eight latest places are 0.75 ... 0.05 m on the way back: of the settled ones 0.35 m is next.
    assert here[11] == pytest.approx(1.0)
    assert here[16] == pytest.approx(0.0)


@pytest.mark.parametrize("wrong", [{"sectors": 0}, {"reach": -1.0}, {"near": float("nan")}])
def test_impossible_layouts_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError, match=f"trail.{next(iter(wrong))}"):
        TrailLayout(**wrong)
