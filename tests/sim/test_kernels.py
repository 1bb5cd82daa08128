# SPDX-License-Identifier: Apache-2.0
"""Kernels have only the code that a batch needs; perturbed robots as a whole.

Without errors these are as any other, padded, true, and reproducible.
"""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.analysis import dead_branch_prune, rewrite_semantic_constants
from numba.core.compiler import run_frontend
from numba.core.ir import Assign, Global
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

from pm01_nav.robot import full_circle
from pm01_nav.sim import kernels
from pm01_nav.sim.kernels import ABSENT
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import RandomizationConfig, default_randomization
from pm01_nav.task.tasks import task_config
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import WorldPool, generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.world import World

STEPS = 60
AT_ONCE = {
    "limits": {"linear_acceleration": 1e9, "angular_acceleration": 1e9},
    "actuator": {"lag_s": 0.0},
}
WALL = World("wall", (-5.0, -5.0, 5.0, 5.0), segments=np.array([[1.0, -9.0, 1.0, 9.0]]))


def config(suite: str, randomization: RandomizationConfig | None, **lidar: float) -> TaskConfig:
    changes = {"lidar": full_circle(72) | lidar}
    update = {"robot_changes": changes, "time_limit_s": 2.5, "randomization": randomization}
    return task_config(suite).model_copy(update=update)


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return generate_pool(suites()["static"].generator, range(5), radius=0.3)


def actions(count: int) -> NDArray[np.float64]:
    drawn = np.random.default_rng(0).uniform(-1.2, 1.2, (STEPS, 8, 2))
    drawn[:, :, 0] += 0.5
    return drawn[:, :count]


def rollout(batch: NavigationBatch, steps: NDArray[np.float64]) -> dict[str, NDArray]:
    rows: dict[str, list[NDArray]] = {}
    for action in steps:
        result = batch.step(action)
        row = dict(batch.simulator.arrays()) | {"observation": result.observation}
        row |= {"reward": result.reward, "ended": result.terminated | result.truncated}
        for name, value in row.items():
            rows.setdefault(name, []).append(value.copy())
    return {name: np.array(values) for name, values in rows.items()}


def started(pool: WorldPool, num_envs: int, seed: int) -> NavigationBatch:
    batch = NavigationBatch(config("static", default_randomization()), pool, num_envs)
    batch.reset(seed + np.arange(num_envs))
    return batch


def assert_bit_equal(one: dict[str, NDArray], two: dict[str, NDArray]) -> None:
    for name in one:
        assert one[name].tobytes() == two[name].tobytes(), name


class Something(NamedTuple):
    value: float


def called(kernel: Any, **absent: tuple[()]) -> set[str]:
    """Return which of our compiled functions a kernel calls, once numba has left out the rest.

    All of its arguments are named tuples with something in them but for the ``absent``.
    """
    names = inspect.signature(kernel.py_func).parameters
    types = [numba.typeof(absent.get(name, Something(1.0))) for name in names]
    code = run_frontend(kernel.py_func)
    rewrite_semantic_constants(code, types)
    dead_branch_prune(code, types)
    values = [line.value for block in code.blocks.values() for line in block.find_insts(Assign)]
    found = [value.value for value in values if isinstance(value, Global)]
    return {f.py_func.__name__ for f in found if isinstance(f, CPUDispatcher)}


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("wrong", [False, True])
def test_kernels_have_code_for_what_a_batch_has_only(moves: bool, wrong: bool) -> None:
    errors = {} if wrong else {"errors": ABSENT}
    crowd = {} if moves else {"crowd": ABSENT}
    step = "step_among_movers" if moves else "step_some"
    assert called(kernels.step_batch, **errors, **crowd) == {step}
    observe = {"observe_wrongly"} if wrong else {"observe"}
    assert called(kernels.step_some, **errors, **crowd) == {"advance"} | observe
    assert called(kernels.begin, **errors) == {"begin_episode"} | observe
    wrongly = {"drive", "true_time", "true_crowd", "true_base", "advance_odometry"}
    expected = {"move_movers", "move"} | (wrongly if wrong else set())
    assert called(kernels.advance, **errors, **crowd) == expected
    assert called(kernels.move_movers, **crowd) == ({"step_movers"} if moves else set())
    placed = {"choose_world", "place", "place_start" if moves else "draw_start"}
    placed |= {"draw_errors"} if wrong else set()
    assert called(kernels.place_anew, **errors, **crowd) == placed
    begun = {"begin_commands", "begin_odometry"} if wrong else set()
    assert called(kernels.begin_episode, **errors) == {"begin_trail", "spread_distance"} | begun


@pytest.mark.parametrize("suite", ["static", "warehouse", "barn_like"])
def test_without_errors_robots_are_as_described(suite: str) -> None:
    pool = generate_pool(suites()[suite].generator, range(4), radius=0.4)
    batches = [
        NavigationBatch(config(suite, r, noise_std=0.0), pool, 8, autoreset=False)
        for r in (None, RandomizationConfig())
    ]
    for batch in batches:
        batch.reset(np.arange(8))
    for action in actions(8)[:24]:
        nominal, perturbed = (batch.step(action) for batch in batches)
        assert perturbed.observation == pytest.approx(nominal.observation, abs=1e-5)
        assert perturbed.reward == pytest.approx(nominal.reward, abs=1e-9)
        states = [batch.simulator.state for batch in batches]
        # The same sums, but for exp(-dt / lag), which two libraries round.
        assert states[1].pose == pytest.approx(states[0].pose, abs=1e-12)
        assert (states[1].contact == states[0].contact).all()


@pytest.mark.parametrize("padding", [0.0, 0.05])
def test_padded_footprint_touches_earlier(make_robot, simulate, padding: float) -> None:
    sim = simulate(make_robot(**AT_ONCE), WALL, [0.0, 0.0, 0.0], {"footprint_padding": padding})
    assert sim.state.clearance[0] == pytest.approx(1.0 - 0.17 - padding)
    sim.state.twist[0, 0] = 0.5  # Already under way.
    while not sim.state.contact[0]:
        sim.step(np.array([[0.5, 0.0]]))
    # Steps of 0.025 m up to the last free place before 0.83 m, or 0.78 m with 5 cm around.
    assert sim.state.pose[0, 0] == pytest.approx(0.825 - padding)


def test_padded_polygon_keeps_round_corners(make_robot, simulate) -> None:
    # The corner of the Jackal at (0.229, 0.208) is 0.5 m away from a disc along the diagonal.
    disc = [0.229 + 0.6 * np.sqrt(0.5), 0.208 + 0.6 * np.sqrt(0.5), 0.1]
    world = World("disc", (-5.0, -5.0, 5.0, 5.0), discs=np.array([disc]))
    robot = make_robot("jackal")
    sim = simulate(robot, world, [0.0, 0.0, 0.0], {"footprint_padding": 0.1})
    assert sim.state.clearance[0] == pytest.approx(0.4)


@pytest.mark.parametrize("base", ["pm01", "jackal"])
def test_padded_footprint_meets_movers_earlier(make_robot, simulate, base: str) -> None:
    ahead = Mover("bounce", 0.3, np.array([[2.0, 0.0]]), speed=1.0, heading=np.pi)
    world = World("flyer", (-5.0, -5.0, 5.0, 5.0), movers=(ahead,))
    front = 0.17 if base == "pm01" else 0.229
    sim = simulate(make_robot(base), world, [0.0, 0.0, 0.0], {"footprint_padding": 0.05})
    assert sim.state.clearance[0] == pytest.approx(1.7 - front - 0.05)


def test_movers_and_robot_share_a_jittering_clock(make_robot, simulate) -> None:
    aside = Mover("bounce", 0.1, np.array([[0.0, 3.0]]), speed=0.4, heading=0.0)
    world = World("flyer", (-5.0, -5.0, 5.0, 5.0), movers=(aside,))
    sim = simulate(make_robot(**AT_ONCE), world, np.zeros((20, 3)), {"control_jitter": 0.3})
    before = sim.state.mover_position[:, 0, 0].copy()
    sim.state.twist[:, 0] = 0.5  # Already under way.
    sim.step(np.tile([0.5, 0.0], (20, 1)))
    flown = sim.state.mover_position[:, 0, 0] - before
    assert flown == pytest.approx(0.4 / 0.5 * sim.state.pose[:, 0])
    assert np.ptp(flown) > 0.005


def test_policy_sees_what_is_measured_and_rewards_what_is_true(pool: WorldPool) -> None:
    wrong = RandomizationConfig(
        goal_error=(0.5, 0.5), odometry_scale=(0.8, 0.8), lidar_dropout=(1.0, 1.0)
    )
    batch = NavigationBatch(config("static", wrong), pool, 8)
    observation = batch.reset(np.arange(8))
    simulator = batch.simulator
    # No beam returns anything; the goal is told wrongly by up to half a metre.
    assert observation[:, 0] == pytest.approx((0.3 - 3.5) / (0.3 + 3.5))
    sectors = batch.layout.part("scan").sectors
    assert 10.0 * observation[:, sectors] == pytest.approx(simulator.measured_goal[:, 0], abs=1e-5)
    step = batch.advance(np.tile([0.4, 0.0], (8, 1)))
    away = np.linalg.norm(simulator.state.goal - simulator.state.pose[:, :2], axis=1)
    assert step.goal_distance == pytest.approx(away)
    assert np.abs(simulator.measured_goal[:, 0] - away).max() > 0.05
    assert (step.twist == simulator.state.twist).all()
    assert simulator.measured_twist[:, 0] == pytest.approx(0.8 * step.twist[:, 0])
    assert np.isfinite(step.scan).any()
    assert np.isinf(simulator.scan).all()


def test_collision_by_scan_is_judged_by_the_true_scan(pool: WorldPool) -> None:
    blind = RandomizationConfig(lidar_dropout=(1.0, 1.0))
    task = task_config("article").model_copy(update={"randomization": blind})
    batch = NavigationBatch(task, pool, 8, autoreset=False)
    batch.reset(np.arange(8))
    collided = np.zeros(8, dtype=bool)
    for _ in range(200):
        step = batch.advance(np.tile([0.5, 0.0], (8, 1)))
        collided |= step.collided
    assert collided.any()


def test_environment_of_a_batch_equals_a_batch_of_one(pool: WorldPool) -> None:
    together = rollout(started(pool, 8, 20), actions(8))
    for i in (0, 5):
        alone = rollout(started(pool, 1, 20 + i), actions(8)[:, [i]])
        assert_bit_equal({name: value[:, [i]].copy() for name, value in together.items()}, alone)
        assert alone["ended"].sum() >= 2


def test_number_of_threads_does_not_matter(pool: WorldPool) -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("numba has one thread only")
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = rollout(started(pool, 8, 30), actions(8))
        numba.set_num_threads(2)
        assert_bit_equal(one, rollout(started(pool, 8, 30), actions(8)))
    finally:
        numba.set_num_threads(before)


def test_saved_state_goes_on_as_if_it_had_never_stopped(pool: WorldPool) -> None:
    one, two = started(pool, 8, 0), started(pool, 8, 100)
    half = STEPS // 2
    rollout(one, actions(8)[:half])
    two.load_state_dict(one.state_dict())
    assert_bit_equal(rollout(one, actions(8)[half:]), rollout(two, actions(8)[half:]))


def test_saved_state_holds_every_array(pool: WorldPool) -> None:
    simulator = started(pool, 2, 0).simulator
    parts = (simulator.state, simulator.errors, simulator.drawn)
    # No name stands for two arrays.
    assert len(simulator.arrays()) == sum(len(part) for part in parts)


def test_state_of_robots_without_errors_does_not_fit(pool: WorldPool) -> None:
    nominal = NavigationBatch(config("static", None), pool, 8)
    with pytest.raises(ValueError, match="state has"):
        started(pool, 8, 0).load_state_dict(nominal.state_dict())
