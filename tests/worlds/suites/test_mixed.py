# SPDX-License-Identifier: Apache-2.0
"""The mixture follows its weights."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.suites.mixed import WEIGHTS, mixed


def test_weights_are_probabilities_of_suites() -> None:
    assert sum(WEIGHTS.values()) == pytest.approx(1.0)
    assert set(WEIGHTS) < {suite.generator for suite in suites().values()}


def test_suites_are_drawn_by_their_weights() -> None:
    count = 500
    drawn = Counter(mixed(np.random.default_rng(seed)).name for seed in range(count))
    assert set(drawn) == {suite.__name__ for suite in WEIGHTS}
    for suite, weight in WEIGHTS.items():
        deviation = np.sqrt(count * weight * (1.0 - weight))
        assert abs(drawn[suite.__name__] - count * weight) < 4 * deviation
