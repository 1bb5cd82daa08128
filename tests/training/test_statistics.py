# SPDX-License-Identifier: Apache-2.0
"""Interquartile means, their intervals, and times to a level, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.training.statistics import curves_at, iqm_with_interval, time_to


def test_iqm_is_the_mean_of_the_middle_half():
    # Of eight scores the two least and the two greatest are left out: (3 + 4 + 5 + 6) / 4.
    scores = np.array([[100.0], [1.0], [6.0], [3.0], [4.0], [-50.0], [5.0], [90.0]])
    assert iqm_with_interval(scores)["iqm"] == pytest.approx(4.5)


def test_interval_shrinks_with_runs_and_holds_the_iqm():
    rng = np.random.default_rng(0)
    widths = []
    for runs in (8, 80):
        found = iqm_with_interval(rng.normal(0.9, 0.05, (runs, 1)))
        low, high = found["ci95"]
        assert low <= found["iqm"] <= high
        widths.append(high - low)
    assert widths[0] > widths[1]
    # The IQM of a normal sample has about 1.1 times the standard error of its mean.
    assert widths[1] == pytest.approx(2 * 1.96 * 1.1 * 0.05 / np.sqrt(80), rel=0.35)


def test_runs_are_drawn_within_each_task():
    # Tasks differ, runs do not: drawn within tasks nothing varies.
    scores = np.tile([0.1, 0.5, 0.9], (6, 1))
    found = iqm_with_interval(scores)
    assert found["ci95"] == [found["iqm"], found["iqm"]]
    assert found["iqm"] == pytest.approx(0.5)
    # Drawn from all scores alike the interval would be wide; here one run deviates a little.
    scores[0] += 0.01
    low, high = iqm_with_interval(scores)["ci95"]
    assert high - low < 0.02


def test_one_run_has_no_interval():
    assert iqm_with_interval(np.array([[0.7]])) == {"iqm": pytest.approx(0.7), "ci95": None}


def test_time_to_a_level_is_that_of_the_first_evaluation_there():
    success, seconds = [0.5, 0.96, 0.94, 0.991], [10.0, 20.0, 30.0, 40.0]
    assert time_to(success, seconds, 0.95) == 20.0
    assert time_to(success, seconds, 0.99) == 40.0
    assert time_to(success, seconds, 0.999) is None


def test_curves_at_common_times():
    rows = curves_at(np.array([0.0, 1.0, 2.0, 9.0]), [([1.0, 3.0], [0.0, 1.0]), ([], [])])
    assert rows[0, 1:].tolist() == [0.0, 0.5, 1.0]
    assert np.isnan(rows[0, 0])
    assert np.isnan(rows[1]).all()
