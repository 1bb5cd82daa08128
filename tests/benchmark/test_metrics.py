# SPDX-License-Identifier: Apache-2.0
"""Figures of merit at values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.benchmark.metrics import barn_score, spl, wilson_interval

Z = 1.959963984540054


@pytest.mark.parametrize(
    ("successes", "trials", "expected"),
    [
        # z = 1.96, z^2 = 3.8415: centre (8 + 1.9207) / 13.8415 = 0.71674; half width
        # 1.96 / 13.8415 x sqrt(8 x 2 / 10 + 3.8415 / 4) = 0.14160 x 1.60046 = 0.22663.
        (8, 10, (0.49016, 0.94332)),
        # All or none of n: n / (n + z^2), or z^2 / (n + z^2).
        (10, 10, (10 / (10 + Z**2), 1.0)),
        (0, 10, (0.0, Z**2 / (10 + Z**2))),
        # 0.5 +- 1.96 / (2 sqrt(100 + 3.8415)) = 0.5 +- 0.09617.
        (50, 100, (0.40383, 0.59617)),
        (0, 0, (0.0, 1.0)),
    ],
)
def test_wilson_interval(successes: int, trials: int, expected: tuple[float, float]) -> None:
    # The numbers above are rounded to five digits.
    assert wilson_interval(successes, trials) == pytest.approx(expected, abs=1e-5)


def test_spl() -> None:
    success = np.array([True, True, False, True])
    shortest = np.array([4.0, 4.0, 4.0, 4.0])
    travelled = np.array([4.0, 8.0, 4.0, 3.9])
    # 1, one half, nothing for a failure, and not more than 1 for a shortcut.
    assert spl(success, shortest, travelled) == pytest.approx((1.0 + 0.5 + 0.0 + 1.0) / 4)


def test_spl_of_a_start_at_the_goal_is_finite() -> None:
    assert np.isfinite(spl(np.array([True]), np.array([0.0]), np.array([0.0])))


@pytest.mark.parametrize(
    ("clip", "times", "expected"),
    [
        # 10 m take 5 s at 2 m/s. Since 2024 the time counts from 2 to 8 times that, 10 to 40 s.
        (
            (2.0, 8.0),
            [1.0, 9.99, 10.0, 20.0, 40.0, 41.0, 99.0],
            [0.5, 0.5, 0.5, 0.25, 0.125, 0.125, 0.125],
        ),
        # Before, from 4 to 8 times: 20 to 40 s.
        ((4.0, 8.0), [1.0, 10.0, 20.0, 25.0, 40.0, 99.0], [0.25, 0.25, 0.25, 0.2, 0.125, 0.125]),
    ],
)
def test_barn_score(clip: tuple[float, float], times: list[float], expected: list[float]) -> None:
    n = len(times)
    success, length = np.ones(n, dtype=bool), np.full(n, 10.0)
    assert barn_score(success, length, np.array(times), clip) == pytest.approx(expected)
    assert (barn_score(~success, length, np.array(times), clip) == 0.0).all()
