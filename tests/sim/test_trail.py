# SPDX-License-Identifier: Apache-2.0
"""The trail in the simulator: what is noted when, and that it equals the policy's own."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from pm01_nav.robot import load_robot
from pm01_nav.sim.settings import Features, TrailParams
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.trail import Trail, TrailLayout, familiarity, visited_sectors
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

LAYOUT = TrailLayout(sectors=8, interval_s=0.5, capacity=6, reach=3.0, near=0.5, settled_places=3)


@pytest.fixture
def sim() -> PlanarSimulator:
    pool = build_pool([World("open", (-20.0, -20.0, 20.0, 20.0))], radius=0.27)
    in_steps = asdict(LAYOUT) | {"interval_steps": 5}
    del in_steps["interval_s"]
    features = Features(trail=TrailParams(**in_steps))
    sim = PlanarSimulator(load_robot("pm01"), pool, 5, features=features)
    sim.seed(np.arange(5))
    sim.reset()
    return sim


def drive(sim: PlanarSimulator, steps: int):
    commands = np.random.default_rng(3).uniform([-0.1, -1.0], [0.5, 1.0], (steps, 5, 2))
    for command in commands:
        sim.step(command)
        yield


def test_places_are_noted_every_interval(sim: PlanarSimulator) -> None:
    start = sim.state.pose[:, :2].copy()
    assert (sim.state.trail_length == 1).all()
    assert (sim.state.trail[:, 0] == start).all()
    seen = [start]
    for step, _ in enumerate(drive(sim, 40), start=1):
        if step % 5 == 0:
            seen.append(sim.state.pose[:, :2].copy())
    # 9 places in a ring of 6: the last three lie where the first three were.
    assert (sim.state.trail_length == 9).all()
    for slot, place in enumerate([6, 7, 8, 3, 4, 5]):
        assert (sim.state.trail[:, slot] == seen[place]).all()


def test_a_reset_forgets(sim: PlanarSimulator) -> None:
    for _ in drive(sim, 12):
        pass
    sim.reset(np.array([2]))
    assert sim.state.trail_length.tolist() == [3, 3, 1, 3, 3]
    assert (sim.state.visited[2] == 0.0).all()


def test_simulator_and_policy_agree(sim: PlanarSimulator) -> None:
    trail, familiar = Trail(LAYOUT, 0.1, 5), 0.0
    trail.follow(sim.state.twist)
    for _ in drive(sim, 60):
        (length,) = set(sim.state.trail_length.tolist())  # None of them begins anew.
        places = sim.state.trail[:, :length]
        exact = visited_sectors(LAYOUT, places, sim.state.pose)
        # The last slot written is that of the latest place; before it lie the earlier ones.
        later = (length - 1 - np.arange(places.shape[1])) % 6
        here = familiarity(LAYOUT, places[:, later >= 3], sim.state.pose)
        exact = np.concatenate([exact, here[:, None]], axis=1)
        # The kernel takes directions that may be 1e-4 rad off: a share of 1.3e-4 of each place.
        assert sim.state.visited == pytest.approx(exact, abs=1e-3)
        # Dead reckoning takes the mean of the speeds at both ends of a step.
        assert trail.follow(sim.state.twist) == pytest.approx(exact, abs=0.05)
        familiar = max(familiar, here.max())
    assert sim.state.visited[:, :8].max() > 0.3
    assert familiar > 0.3
