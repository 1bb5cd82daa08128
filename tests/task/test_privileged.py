# SPDX-License-Identifier: Apache-2.0
"""What a critic sees and no robot does: true numbers, by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.privileged import Privileged
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool


def one_robot(**changes):
    """A robot at (1, 2) that looks along +y, with three movers of which two are near."""
    state = {
        "pose": np.array([[1.0, 2.0, math.pi / 2]]),
        "heading": np.array([[0.0, 1.0]]),
        "twist": np.array([[0.5, -1.0]]),
        "goal_polar": np.array([[2.5, math.pi / 6]]),
        "clearance": np.array([0.1]),
        "mover_position": np.array([[[1.0, 5.0], [0.0, 2.0], [50.0, 0.0], [1.0, 2.1]]]),
        "mover_velocity": np.array([[[1.0, 0.0], [0.0, -2.0], [9.0, 9.0], [5.0, 5.0]]]),
        "mover_radius": np.array([[0.25, 0.3, 0.2, 0.9]]),
        # The fourth row is left over from another world.
        "mover_count": np.array([3]),
    }
    return SimpleNamespace(**(state | changes))


def test_numbers_by_hand():
    shown = Privileged(movers=3).observe(one_robot())[0]
    assert len(shown) == Privileged(movers=3).size == 21
    # (0.3 - 0.1) / (0.3 + 0.1); 2.5 m of 5; sin and cos of 30 degrees; speeds over 5.
    own = [0.5, 0.5, 0.5, math.sqrt(3) / 2, 0.1, -0.2]
    # One metre to the left (world -x), driving back along the robot's own axis at 2 m/s.
    left = [0.0, 0.2, -0.4, 0.0, 0.3]
    # Three metres ahead, walking to the right (world +x) at 1 m/s.
    ahead = [0.6, 0.0, 0.0, -0.2, 0.25]
    assert shown == pytest.approx([*own, *left, *ahead, 0, 0, 0, 0, 0], abs=1e-6)


def test_contact_is_the_greatest_nearness():
    assert Privileged().observe(one_robot(clearance=np.array([-0.01])))[0, 0] == 1.0


@pytest.mark.parametrize("suite", ["static", "crowd"])
def test_follows_the_observation_of_the_batch(suite):
    config = task_config(suite).model_copy(update={"num_worlds": 2})
    pool = world_pool(config, "train", 2)
    plain, more = (NavigationBatch(config, pool, 5, privileged=p) for p in (None, Privileged()))
    seeds = np.arange(5)
    seen, with_more = plain.reset(seeds), more.reset(seeds)
    rng = np.random.default_rng(0)
    for _ in range(30):
        assert np.array_equal(with_more[:, : plain.layout.size], seen)
        assert with_more.shape == (5, plain.layout.size + Privileged().size)
        assert with_more.dtype == np.float32
        assert np.isfinite(with_more).all()
        action = rng.uniform(-1, 1, (5, 2))
        one, two = plain.step(action), more.step(action)
        seen, with_more = one.observation, two.observation
        if two.episodes is not None:
            assert two.episodes.final_observation.shape[1] == with_more.shape[1]
    assert with_more[:, plain.layout.size + 6 :].any() == (suite == "crowd")
