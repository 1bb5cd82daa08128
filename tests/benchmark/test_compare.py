# SPDX-License-Identifier: Apache-2.0
"""Paired comparisons, by hand and against the normal approximation."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.benchmark.compare import compare, paired_bootstrap
from pm01_nav.benchmark.merge import Score
from pm01_nav.benchmark.store import ResultsFolder


@pytest.fixture
def score(make_results, tmp_path):
    """Return a function that makes a score of outcomes."""

    def make(entry: str, outcomes: str, first: int = 0, **arrays) -> Score:
        episode = first + np.arange(len(outcomes))
        results = make_results(outcomes, **({"world": episode} | arrays))
        return Score("static", entry, episode, results, None, ResultsFolder(tmp_path))

    return make


def test_difference_by_hand(score) -> None:
    found = compare(score("a", "sssst"), score("b", "scsct"), 0.1)
    assert found.success_difference == pytest.approx(2 / 5)
    assert (found.first, found.second, found.episodes) == ("a", "b", 5)
    # Resampled means of 0, 1, 0, 1, 0 lie within them.
    assert 0.0 <= found.success_ci95[0] < 0.4 < found.success_ci95[1] <= 1.0


def test_only_episodes_that_both_have_driven_count(score) -> None:
    found = compare(score("a", "ssss"), score("b", "ccs", first=2), 0.1)
    assert found.episodes == 2
    assert found.success_difference == 1.0


def test_time_where_both_reached_the_goal(score) -> None:
    one = score("a", "sst", steps=np.array([100, 120, 500]))
    other = score("b", "sss", steps=np.array([110, 160, 90]))
    # 1 s and 4 s sooner.
    assert compare(one, other, 0.1).time_difference_s == pytest.approx(-2.5)
    assert compare(score("a", "t"), other, 0.1).time_difference_s is None


def test_equal_entries_differ_in_nothing(score) -> None:
    found = compare(score("a", "sstc"), score("b", "sstc"), 0.1)
    assert found.success_ci95 == (0.0, 0.0)
    assert not found.significant


def test_interval_of_many_worlds_is_the_normal_one() -> None:
    # 30 of 400 worlds won by one only, 10 by the other only: the mean is 0.05, and its variance
    # a 400th of 0.1 less the mean squared.
    difference = np.repeat([1.0, -1.0, 0.0], [30, 10, 360])
    mean, (low, high) = paired_bootstrap(difference, np.arange(400))
    half = 1.96 * np.sqrt((0.1 - 0.0025) / 400)
    assert mean == pytest.approx(0.05)
    assert low == pytest.approx(0.05 - half, abs=0.004)
    assert high == pytest.approx(0.05 + half, abs=0.004)


def test_runs_of_one_world_are_not_independent() -> None:
    # 20 worlds, 10 runs each, all runs of a world alike: no more is known than of 20 runs.
    worlds = np.repeat(np.arange(20), 10)
    difference = np.repeat(np.repeat([1.0, 0.0], 10), 10)
    _, (low, high) = paired_bootstrap(difference, worlds)
    half = 1.96 * np.sqrt(0.25 / 20)
    assert high - low == pytest.approx(2 * half, abs=0.05)


def test_worlds_count_alike_however_many_runs_they_have() -> None:
    mean, _ = paired_bootstrap(np.array([1.0, 1.0, 1.0, 0.0]), np.array([0, 0, 0, 1]))
    assert mean == 0.5


def test_one_world_says_nothing_of_the_spread() -> None:
    assert paired_bootstrap(np.array([1.0, 0.0]), np.array([4, 4])) == (0.5, (0.5, 0.5))
