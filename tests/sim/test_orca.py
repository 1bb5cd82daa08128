# SPDX-License-Identifier: Apache-2.0
"""Velocity obstacles by hand and by their definition; the linear programs by trying everything."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.sim.orca import avoidance, choose_velocity
from tests.sim.reference_movers import reference_avoidance, reference_velocity

DT = 0.1


def test_side_of_a_velocity_obstacle_by_hand() -> None:
    # The other stands 2 m ahead, both radii together are 1 m: the obstacle's sides rise and fall
    # by 30 degrees, and its end is the disc around (1, 0), the way over 2 s, of radius 0.5. At
    # (1.5, 0) the sides are 1.5 sin(30) = 0.75 away. Straight ahead both are as near; the right
    # one is taken, whose outward normal points to -120 degrees.
    nx, ny, short = avoidance(2.0, 0.0, 1.5, 0.0, 1.0, DT)
    assert (nx, ny, short) == pytest.approx((-0.5, -np.sqrt(0.75), 0.75))
    # A little to the left it is the left one.
    assert avoidance(2.0, 0.0, 1.5, 1e-9, 1.0, DT)[1] == pytest.approx(np.sqrt(0.75))


def test_end_of_a_velocity_obstacle_by_hand() -> None:
    # At (0.7, 0) the end, at 0.5, is nearest: 0.2 back. At rest it is 0.5 away, from outside.
    assert avoidance(2.0, 0.0, 0.7, 0.0, 1.0, DT) == pytest.approx((-1.0, 0.0, 0.2))
    assert avoidance(2.0, 0.0, 0.0, 0.0, 1.0, DT) == pytest.approx((-1.0, 0.0, -0.5))


def test_what_overlaps_parts_within_a_step() -> None:
    # 0.2 m of overlap in 0.1 s: 2 m/s apart.
    assert avoidance(0.8, 0.0, 0.0, 0.0, 1.0, DT) == pytest.approx((-1.0, 0.0, 2.0))


def test_avoidance_equals_the_definition() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        reach, angle = rng.uniform(0.2, 1.0), rng.uniform(-np.pi, np.pi)
        way = rng.uniform(1.05, 6.0) * reach * np.array([np.cos(angle), np.sin(angle)])
        velocity = rng.uniform(-2.5, 2.5, 2)
        nx, ny, short = avoidance(*way, *velocity, reach, DT)
        normal, expected = reference_avoidance(way, velocity, reach, 2.0)
        assert short == pytest.approx(expected, abs=1e-6)
        assert (nx, ny) == pytest.approx(tuple(normal), abs=1e-3)


def random_planes(rng: np.random.Generator, count: int, tightest: float):
    """Draw half-planes at up to 1 m/s from standing still; shape (count, 3)."""
    angles = rng.uniform(-np.pi, np.pi, count)
    return np.column_stack([np.cos(angles), np.sin(angles), rng.uniform(-1.0, tightest, count)])


def choose(planes, num_fixed: int, wanted, speed_max: float):
    table = np.zeros((2, len(planes) + 1, 3))
    table[0, : len(planes)] = planes
    return choose_velocity(table, 0, num_fixed, len(planes), *wanted, speed_max)


@pytest.mark.parametrize("tightest", [0.0, 0.6])
def test_choice_equals_trying_everything(tightest: float) -> None:
    rng = np.random.default_rng(int(10 * tightest))
    given_up = 0
    for _ in range(200):
        count = int(rng.integers(1, 9))
        planes = random_planes(rng, count, tightest)
        num_fixed = int(rng.integers(0, count + 1)) if tightest == 0.0 else 0
        wanted = rng.uniform(-0.9, 0.9, 2)
        found = np.array(choose(planes, num_fixed, wanted, 1.3))
        expected, violation = reference_velocity(planes, num_fixed, wanted, 1.3)
        assert np.linalg.norm(found) <= 1.3 + 1e-9
        if violation == 0.0:
            assert found == pytest.approx(expected, abs=1e-6)
        else:
            given_up += 1
            assert (planes[:, 2] - planes[:, :2] @ found).max() == pytest.approx(
                violation, abs=1e-6
            )
    # With all limits at or below zero, standing still is allowed.
    assert (given_up > 20) == (tightest > 0.0)


def test_fixed_planes_are_kept_when_others_are_given_up() -> None:
    rng = np.random.default_rng(8)
    given_up = 0
    for _ in range(200):
        fixed, others = random_planes(rng, 3, 0.0), random_planes(rng, 5, 0.8)
        planes = np.concatenate([fixed, others])
        found = np.array(choose(planes, 3, rng.uniform(-0.9, 0.9, 2), 1.3))
        assert (fixed[:, :2] @ found >= fixed[:, 2] - 1e-9).all()
        _, violation = reference_velocity(planes, 3, np.zeros(2), 1.3)
        worst = max((others[:, 2] - others[:, :2] @ found).max(), 0.0)
        assert worst == pytest.approx(violation, abs=1e-6)
        given_up += violation > 0.0
    assert given_up > 50


def test_opposite_planes_are_violated_alike() -> None:
    # v_x >= 0.5 and v_x <= -0.3 at once: the middle is 0.1, each violated by 0.4.
    planes = np.array([[1.0, 0.0, 0.5], [-1.0, 0.0, 0.3]])
    x, _ = choose(planes, 0, (0.0, 0.0), 1.3)
    assert x == pytest.approx(0.1)
