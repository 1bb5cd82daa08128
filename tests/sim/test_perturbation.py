# SPDX-License-Identifier: Apache-2.0
"""What is wrong with each robot: the law of each draw, and that episodes leave no trace."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.robot import full_circle, load_robot
from pm01_nav.sim.settings import Perturbation
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.randomization import default_randomization
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

N = 10_000
PM01 = load_robot("pm01")
ROBOT = PM01.model_copy(update={"lidar": PM01.lidar.model_copy(update=full_circle(1))})
OPEN = World("open", (-5.0, -5.0, 5.0, 5.0))
RANGES = default_randomization().model_copy(update={"scan_delay_s": (0.0, 0.2)})
LIMITS = RANGES.ranges(ROBOT, 0.1)
QUANTITIES = list(Perturbation._fields)


def fleet(count: int) -> PlanarSimulator:
    """Return robots that have drawn their first errors."""
    simulator = PlanarSimulator(ROBOT, build_pool([OPEN], radius=0.01), count)
    simulator.perturb(LIMITS)
    simulator.seed(np.arange(count))
    simulator.reset()
    return simulator


@pytest.fixture(scope="module")
def drawn() -> list[Perturbation]:
    """Return what 10 000 robots drew in their first and in their 30th episode."""
    simulator = fleet(N)
    assert simulator.drawn is not None
    first = Perturbation(*(values.copy() for values in simulator.drawn))
    for _ in range(29):
        simulator.reset()
    return [first, simulator.drawn]


@pytest.mark.parametrize("episode", [0, 1])
@pytest.mark.parametrize("name", QUANTITIES)
def test_law_of_each_draw(drawn: list[Perturbation], name: str, episode: int) -> None:
    low, high = getattr(LIMITS, name)
    values = getattr(drawn[episode], name)
    assert low <= values.min()
    assert values.max() <= high
    # U(low, high): mean (low + high) / 2, variance (high - low)^2 / 12. Scans are late by U(0, 2)
    # steps, rounded: 0, 1, 2 with probability 1/4, 1/2, 1/4, variance 1/2.
    variance = (high - low) ** 2 / 12
    if name == "scan_delay":
        assert set(values) == {0.0, 1.0, 2.0}
        variance = 0.5
    assert values.mean() == pytest.approx((low + high) / 2, abs=4 * np.sqrt(variance / N))
    # The fourth moment of a uniform law is 1.8 variances squared, that of this discrete one 2, so
    # the sample variance has a deviation of at most variance x sqrt(1 / N).
    assert values.var() == pytest.approx(variance, abs=4 * variance * np.sqrt(1.0 / N))


def test_robots_and_quantities_are_independent(drawn: list[Perturbation]) -> None:
    for name in set(QUANTITIES) - {"scan_delay"}:
        assert len(np.unique(getattr(drawn[0], name))) == N
    # A correlation of independent quantities has a deviation of 1 / sqrt(N) = 0.01; the greatest
    # of 300 pairs, and of each robot with its neighbour and its own last episode, stays below 5.
    table = np.array(drawn[0])
    correlations = np.corrcoef(table) - np.eye(len(table))
    assert np.abs(correlations).max() < 0.05
    for others in (np.roll(table, 1, axis=1), np.array(drawn[1])):
        pairs = zip(table, others, strict=True)
        assert max(abs(np.corrcoef(a, b)[0, 1]) for a, b in pairs) < 0.05


def test_reset_of_some_leaves_the_others_alone() -> None:
    simulator = fleet(6)
    before = np.array(simulator.drawn)
    simulator.reset(np.array([1, 4]))
    changed = (np.array(simulator.drawn) != before).any(axis=0)
    assert changed.tolist() == [False, True, False, False, True, False]


def test_first_episode_is_that_of_a_robot_without_errors() -> None:
    # World, start, goal and heading are drawn first, so that both can be compared.
    perturbed = fleet(20)
    nominal = PlanarSimulator(ROBOT, build_pool([OPEN], radius=0.01), 20)
    nominal.seed(np.arange(20))
    nominal.reset()
    assert (perturbed.state.pose == nominal.state.pose).all()
    assert (perturbed.state.goal == nominal.state.goal).all()
