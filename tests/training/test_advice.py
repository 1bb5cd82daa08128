# SPDX-License-Identifier: Apache-2.0
"""Warnings of a run: each for the history that it is about, and none for a good one."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.training.advice import findings

ROWS = 80


def history(**columns):
    """A run that learns: success from 0 to 95 %, the return follows it."""
    success = np.linspace(0.0, 0.95, ROWS)
    base = {
        "success_rate": success,
        "timeout_rate": 0.3 * (1 - success),
        "return": 150 * success - 50,
        "reward/goal": 100 * success,
        "reward/progress": 50 * success,
        "reward/collision": np.full(ROWS, -50.0),
        "spinning": np.full(ROWS, 0.01),
    }
    return {name: list(values) for name, values in (base | columns).items()}


def test_good_run_and_short_run_are_left_alone():
    assert findings(history()) == {}
    assert findings({}) == {}
    short = {name: values[:39] for name, values in history(spinning=np.ones(ROWS)).items()}
    assert findings(short) == {}


def test_return_up_and_success_flat_is_reward_hacking():
    noise = np.random.default_rng(0).normal(0, 1, ROWS)
    rising = np.linspace(0, 80, ROWS)
    said = findings(
        history(
            success_rate=np.full(ROWS, 0.2),
            **{
                "return": rising + noise - 20.0,
                "reward/goal": np.full(ROWS, 20.0),
                "reward/progress": np.full(ROWS, 10.0),
                "reward/heading": rising,
            },
        )
    )
    assert set(said) == {"reward_hacking"}
    assert "heading" in said["reward_hacking"]
    assert "success stayed at 20%" in said["reward_hacking"]


@pytest.mark.parametrize("level", [0.2, 0.95])
def test_noise_is_no_reward_hacking(level):
    noise = np.random.default_rng(1).normal(0, 5, ROWS)
    assert findings(history(success_rate=np.full(ROWS, level), **{"return": noise})) == {}


def test_spinning():
    said = findings(history(spinning=np.full(ROWS, 0.4)))
    assert set(said) == {"spinning"}
    assert "40% of their time turning on the spot" in said["spinning"]


def test_run_without_a_spin_meter_is_judged_all_the_same():
    columns = history()
    del columns["spinning"]
    assert findings(columns) == {}


def test_standing_still():
    said = findings(
        history(
            success_rate=np.full(ROWS, 0.1),
            timeout_rate=np.full(ROWS, 0.85),
            **{"return": np.full(ROWS, -20.0)},
        )
    )
    assert set(said) == {"standing_still"}
    assert "85% of the episodes" in said["standing_still"]


def test_forgetting():
    success = np.concatenate([np.linspace(0, 0.9, ROWS // 2), np.linspace(0.9, 0.3, ROWS // 2)])
    said = findings(history(success_rate=success, **{"return": 150 * success - 50}))
    assert set(said) == {"forgetting"}


def test_unknown_rates_at_the_beginning_are_left_out():
    success = np.linspace(0.0, 0.95, ROWS)
    success[:3] = np.nan
    assert findings(history(success_rate=success)) == {}
