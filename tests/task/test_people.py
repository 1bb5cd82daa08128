# SPDX-License-Identifier: Apache-2.0
"""Gaps between robots and movers, worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from pm01_nav.task.people import mover_gaps, nearest_mover


def state(places: list[list[list[float]]], counts: list[int]) -> SimpleNamespace:
    """Return robots at (1, 2) m among movers of 0.2 m at ``places``, of which ``counts`` exist."""
    n = len(counts)
    position = np.array(places, dtype=np.float64).reshape(n, -1, 2)
    return SimpleNamespace(
        pose=np.tile([1.0, 2.0, 0.5], (n, 1)),
        clearance=np.zeros(n),
        mover_position=position,
        mover_radius=np.full(position.shape[:2], 0.2),
        mover_count=np.array(counts),
    )


def test_gap_is_the_distance_of_centres_less_both_radii() -> None:
    """A triangle of 3, 4 and 5 m; beside the robot; and one that is not there."""
    robots = state([[[4.0, 6.0], [1.5, 2.0]], [[4.0, 6.0], [1.5, 2.0]]], [2, 1])
    np.testing.assert_allclose(mover_gaps(robots, 0.3), [[4.5, 0.0], [4.5, np.inf]], atol=1e-12)
    np.testing.assert_allclose(nearest_mover(robots, 0.3), [0.0, 4.5], atol=1e-12)


def test_without_movers_they_are_infinitely_far() -> None:
    """Also where the arrays have no room for any."""
    np.testing.assert_array_equal(nearest_mover(state([[], []], [0, 0]), 0.3), [np.inf, np.inf])
