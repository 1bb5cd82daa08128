# SPDX-License-Identifier: Apache-2.0
"""Means over episodes, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.benchmark.summary import summarize
from pm01_nav.task.tasks import task_config


def test_who_takes_long_is_close_to_people_for_longer(make_results):
    """A tenth of 100 steps, half of 40, and a world without pedestrians; a step takes 0.1 s."""
    results = make_results(
        "scs", steps=np.array([100, 40, 70]), intrusion=np.array([0.1, 0.5, np.nan])
    )
    summary = summarize(results, task_config("crowd"))
    assert summary["personal_space_intrusion"] == pytest.approx((0.1 + 0.5) / 2)
    assert summary["personal_space_time_s"] == pytest.approx((1.0 + 2.0) / 2)


def test_without_pedestrians_nothing_is_said_of_them(make_results):
    summary = summarize(make_results("s"), task_config("static"))
    assert summary["personal_space_time_s"] is None


@pytest.mark.parametrize(
    ("backend", "label"),
    [("planar", "pm01 planar simulator, not"), ("mujoco", "pm01 backend mujoco, not")],
)
def test_barn_scores_say_what_moved_the_robots(make_results, backend, label):
    config = task_config("barn").model_copy(update={"backend": backend})
    summary = summarize(make_results("s", reference_path=np.array([10.0])), config)
    assert summary["backend"] == backend
    assert summary["barn_evaluated_in"] == f"{label} the official BARN evaluation"
