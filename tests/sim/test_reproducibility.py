# SPDX-License-Identifier: Apache-2.0
"""A trajectory depends on its seed and commands alone, and the random numbers are good ones."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.robot import full_circle
from pm01_nav.sim import random
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.pool import WorldPool, generate_pool
from pm01_nav.worlds.suites import suites

NUM_STEPS = 120
LOOKED_AT = ("pose", "twist", "goal", "goal_polar", "ranges", "clearance", "contact", "world")


def config() -> TaskConfig:
    """Return a task with noise and with episodes so short that several fit into a test."""
    lidar = full_circle(36) | {"noise_std": 0.01}
    return task_config("static").model_copy(
        update={"robot_changes": {"lidar": lidar}, "time_limit_s": 3.5}
    )


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return generate_pool(suites()["static"].generator, range(5), radius=0.27)


@pytest.fixture
def threads() -> Iterator[None]:
    before = numba.get_num_threads()
    yield
    numba.set_num_threads(before)


def actions(count: int) -> NDArray[np.float64]:
    """Return actions for environments 0 to 7, shape (NUM_STEPS, 8, 2), cut to ``count`` of them."""
    drawn = np.random.default_rng(0).uniform(-1.2, 1.2, (NUM_STEPS, 8, 2))
    drawn[:, :, 0] += 0.5  # Mostly forwards, so that collisions happen too.
    return drawn[:, :count]


def record(batch: NavigationBatch, steps: NDArray[np.float64]) -> dict[str, NDArray]:
    """Return everything of every step, each array (num_steps, num_envs, ...)."""
    rows: dict[str, list[NDArray]] = {}
    for action in steps:
        result = batch.step(action)
        row = {name: getattr(batch.simulator.state, name) for name in LOOKED_AT}
        row |= {"observation": result.observation, "reward": result.reward}
        row |= {"terminated": result.terminated, "truncated": result.truncated}
        for name, value in row.items():
            rows.setdefault(name, []).append(value.copy())
    return {name: np.array(values) for name, values in rows.items()}


def rollout(pool: WorldPool, num_envs: int, first_seed: int, first_action: int = 0) -> dict:
    """Reset with seeds first_seed, first_seed + 1, ... and record."""
    batch = NavigationBatch(config(), pool, num_envs)
    batch.reset(first_seed + np.arange(num_envs))
    return record(batch, actions(8)[:, first_action : first_action + num_envs])


def assert_bit_equal(one: dict[str, NDArray], two: dict[str, NDArray]) -> None:
    for name in one:
        assert one[name].tobytes() == two[name].tobytes(), name


def test_same_seed_same_trajectory_other_seed_another(pool: WorldPool) -> None:
    one, two, other = (rollout(pool, 8, seed) for seed in (11, 11, 500))
    assert_bit_equal(one, two)
    assert not np.array_equal(one["pose"], other["pose"])
    # The test would be hollow without episodes that end, in more than one way.
    assert one["truncated"].sum() >= 8
    assert one["terminated"].sum() >= 1


@pytest.mark.parametrize("i", [0, 3, 7])
def test_environment_of_a_batch_equals_a_batch_of_one(pool: WorldPool, i: int) -> None:
    batch, alone = rollout(pool, 8, 20), rollout(pool, 1, 20 + i, first_action=i)
    assert_bit_equal({name: value[:, [i]].copy() for name, value in batch.items()}, alone)
    ended = alone["terminated"] | alone["truncated"]
    assert ended.sum() >= 3


def test_number_of_threads_does_not_matter(pool: WorldPool, threads: None) -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("numba has one thread only")
    numba.set_num_threads(1)
    one = rollout(pool, 8, 30)
    numba.set_num_threads(2)
    assert_bit_equal(one, rollout(pool, 8, 30))


def test_interleaved_batches_do_not_influence_each_other(pool: WorldPool) -> None:
    alone = rollout(pool, 4, 40)
    one, two = (NavigationBatch(config(), pool, 4) for _ in range(2))
    one.reset(40 + np.arange(4))
    two.reset(90 + np.arange(4))
    rows = []
    for action in actions(4):
        rows.append(record(one, action[None]))
        two.step(-action)
    together = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    assert_bit_equal(alone, together)


def test_reset_without_seeds_goes_on_with_the_stream(pool: WorldPool) -> None:
    one, two = (NavigationBatch(config(), pool, 4) for _ in range(2))
    first = [batch.reset([1, 2, 3, 4]) for batch in (one, two)]
    second = [batch.reset() for batch in (one, two)]
    assert (first[0] == first[1]).all()
    assert (second[0] == second[1]).all()
    assert (first[0] != second[0]).any(axis=1).all()


def test_saved_state_goes_on_as_if_it_had_never_stopped(pool: WorldPool) -> None:
    one, two = (NavigationBatch(config(), pool, 8) for _ in range(2))
    one.reset(np.arange(8))
    two.reset(100 + np.arange(8))
    half = NUM_STEPS // 2
    record(one, actions(8)[:half])
    two.load_state_dict(one.state_dict())
    assert_bit_equal(record(one, actions(8)[half:]), record(two, actions(8)[half:]))


@pytest.mark.parametrize("errors", [False, True])
def test_an_episode_finds_all_as_the_first_one_did(errors: bool) -> None:
    # Worlds with and without movers, large and small; with trail, frames and ways.
    task = task_config("mixed").model_copy(update={"num_worlds": 8})
    if errors:
        task = task.model_copy(update={"randomization": default_randomization()})
    pool = world_pool(task, "train", 8)
    assert len(set(np.diff(pool.arrays.mover_begin))) > 2
    used, fresh = (NavigationBatch(task, pool, 8) for _ in range(2))
    used.reset(np.arange(8))
    used.simulator.state.path_distance[:] = 99.0
    record(used, actions(8)[:40])
    again = [batch.reset(100 + np.arange(8)) for batch in (used, fresh)]
    assert (again[0] == again[1]).all()
    before, now = fresh.state_dict(), used.state_dict()
    # Memories of which nothing is read that was written before: beyond the noted places, the
    # world's movers and its cells, and a ring that may begin anywhere.
    rest = {"trail", "path_field", "frame_now"} | {
        f"mover_{name}" for name in ("position", "radius", "target", "clock", "leg")
    }
    assert_bit_equal(*({n: a for n, a in s.items() if n not in rest} for s in (before, now)))
    there = np.arange(now["mover_radius"].shape[1]) < now["mover_count"][:, None]
    for name in ("mover_position", "mover_radius", "mover_target", "mover_clock", "mover_leg"):
        assert (before[name][there] == now[name][there]).all()


def draws(seeds: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Return ``count`` numbers of each seed's stream, shape (num_seeds, count)."""
    key, counter = random.stream_keys(seeds), np.zeros(len(seeds), dtype=np.uint64)
    rows = [[random.uniform(key, counter, i) for _ in range(count)] for i in range(len(seeds))]
    return np.array(rows)


def test_uniform_draws_are_uniform() -> None:
    numbers = draws(np.arange(20), 1000)
    assert ((numbers >= 0.0) & (numbers < 1.0)).all()
    # 20 000 draws of U[0, 1): mean 1/2 with deviation sqrt(1/12 / n); variance 1/12 with deviation
    # sqrt((1/80 - 1/144) / n) = sqrt(1/180 / n).
    n = numbers.size
    assert numbers.mean() == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / n))
    assert numbers.var() == pytest.approx(1 / 12, abs=4 * np.sqrt(1 / 180 / n))
    # Each tenth holds 2000 +- 42.4.
    counts, _ = np.histogram(numbers, bins=10, range=(0.0, 1.0))
    assert (np.abs(counts - n / 10) < 4 * np.sqrt(n * 0.1 * 0.9)).all()


def test_normal_values_are_normal() -> None:
    values = random.normal_values().astype(np.float64)
    # The moments of N(0, 1); the fourth one lacks a little beyond the outermost value.
    assert values.mean() == pytest.approx(0.0, abs=1e-6)
    assert values.var() == pytest.approx(1.0, abs=1e-6)
    assert (values**4).mean() == pytest.approx(3.0, abs=0.01)
    # Tables of the normal distribution: 84.134 % lie below 1, 97.725 % below 2.
    assert (values < 1.0).mean() == pytest.approx(0.84134, abs=1e-4)
    assert (values < 2.0).mean() == pytest.approx(0.97725, abs=1e-4)


def test_neighbours_are_unrelated() -> None:
    numbers = draws(np.arange(41), 500)
    bound = 4 / np.sqrt(40 * 500)
    # Neighbouring seeds, and neighbouring draws of one seed.
    assert abs(np.corrcoef(numbers[:-1].ravel(), numbers[1:].ravel())[0, 1]) < bound
    assert abs(np.corrcoef(numbers[:, :-1].ravel(), numbers[:, 1:].ravel())[0, 1]) < bound
    # The first draws of neighbouring seeds, from which worlds are chosen.
    first = draws(np.arange(4001), 1)[:, 0]
    assert abs(np.corrcoef(first[:-1], first[1:])[0, 1]) < 4 / np.sqrt(4000)


def test_streams_of_many_seeds_differ() -> None:
    seeds = np.concatenate([np.arange(50_000), (7 << 32) + np.arange(50_000), [-1, -2]])
    assert len(np.unique(random.stream_keys(seeds))) == len(seeds)
