# SPDX-License-Identifier: Apache-2.0
"""The task on an engine: episodes, faults, refusals, pictures."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import pm01_nav.backends
import pm01_nav.envs
from pm01_nav.backends.engine import Motion
from pm01_nav.backends.physics import DIVERGED, PhysicsSimulator
from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.config import validate
from pm01_nav.errors import InputError
from pm01_nav.planners import make_planner
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool


def task_on(backend: str, name: str = "static") -> TaskConfig:
    data = task_config(name).model_dump() | {"backend": backend}
    return validate(TaskConfig, data, "test")


def batch_on(backend: str, num_envs: int) -> NavigationBatch:
    task = task_on(backend)
    batch = NavigationBatch(task, world_pool(task, "train", 4), num_envs)
    batch.reset(np.arange(num_envs))
    return batch


def lose(batch: NavigationBatch, robot: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the engine lose a robot in the next step, and in that alone."""
    assert isinstance(batch.simulator, PhysicsSimulator)
    engine = batch.simulator._engine
    step = engine.step

    def diverge(speeds: np.ndarray, movers: np.ndarray, motion: Motion, ranges: np.ndarray) -> None:
        step(speeds, movers, motion, ranges)
        motion.pose[robot] = np.nan
        monkeypatch.setattr(engine, "step", step)

    monkeypatch.setattr(engine, "step", diverge)


def test_episodes_begin_as_in_the_plane(engine: str) -> None:
    plane, body = batch_on("planar", 4), batch_on(engine, 4)
    assert (body.simulator.state.pose == plane.simulator.state.pose).all()
    assert (body.simulator.state.goal == plane.simulator.state.goal).all()
    assert body.observe() == pytest.approx(plane.observe(), abs=0.05)


def test_a_lost_robot_ends_its_episode_only(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    batch = batch_on(engine, 3)
    batch.step(np.zeros((3, 2)))
    lose(batch, 1, monkeypatch)
    result = batch.step(np.ones((3, 2)))
    assert result.truncated.tolist() == [False, True, False]
    assert not result.terminated.any()
    assert result.episodes is not None
    assert result.episodes.faults == {1: DIVERGED}
    assert np.isfinite(result.observation).all()
    assert np.isfinite(result.episodes.final_observation).all()
    # The others went on, and a new episode began for it.
    after = batch.step(np.ones((3, 2)))
    assert not after.truncated.any()
    assert np.isfinite(after.observation).all()


def test_mujoco_itself_diverges(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_spec("mujoco") is None:
        pytest.skip("needs mujoco (extra physics)")
    monkeypatch.chdir(tmp_path)
    batch = batch_on("mujoco", 2)
    assert isinstance(batch.simulator, PhysicsSimulator)
    batch.simulator._engine._state[0, -1] = np.nan
    result = batch.step(np.zeros((2, 2)))
    assert result.episodes is not None
    assert result.episodes.faults == {0: DIVERGED}
    # MuJoCo left no log behind.
    assert not list(tmp_path.iterdir())


def test_an_evaluation_says_why_it_lost_an_episode(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluator = Evaluator(task_on(engine), 2, seed=1)
    begin = evaluator.begin

    def begin_badly(numbers: np.ndarray) -> NavigationBatch:
        batch = begin(numbers)
        lose(batch, 0, monkeypatch)
        return batch

    monkeypatch.setattr(evaluator, "begin", begin_badly)
    task = task_on(engine)
    results, _ = evaluator.run(make_planner("pure_pursuit", task.robot_spec(), task.control_dt))
    assert results.failure.tolist() == [DIVERGED, ""]
    assert results.success.tolist() == [False, True]


@pytest.mark.parametrize(("backend", "extra"), [("mujoco", "physics"), ("pybullet", "pybullet")])
def test_an_engine_that_is_missing_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, backend: str, extra: str
) -> None:
    monkeypatch.setattr(pm01_nav.backends, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=rf"not installed; pip install 'pm01-nav\[{extra}\]'"):
        batch_on(backend, 1)


def test_unknown_backends_and_perturbed_robots_are_refused() -> None:
    with pytest.raises(InputError, match="backend"):
        task_on("bullet")
    data = task_config("static").model_dump() | {"backend": "mujoco", "randomization": {}}
    with pytest.raises(InputError, match="randomization: only the backend planar has it"):
        validate(TaskConfig, data, "test")


def test_a_batch_goes_on_from_its_state(engine: str) -> None:
    batch = batch_on(engine, 2)
    for _ in range(5):
        batch.step(np.ones((2, 2)))
    stored = batch.state_dict()
    other = batch_on(engine, 2)
    other.load_state_dict(stored)
    assert (other.simulator.state.pose == stored["pose"]).all()
    other.step(np.zeros((2, 2)))
    moved = np.linalg.norm(other.simulator.state.pose[:, :2] - stored["pose"][:, :2], axis=1)
    assert (moved < 0.05).all()


def test_environment(engine: str) -> None:
    env = gymnasium.make("PM01Nav-v1", backend=engine)
    first, _ = env.reset(seed=3)
    total = 0.0
    for _ in range(5):
        observation, reward, *_ = env.step(np.array([1.0, 0.2], dtype=np.float32))
        assert env.observation_space.contains(observation)
        total += float(reward)
    again, _ = env.reset(seed=3)
    assert (first == again).all()
    assert np.isfinite(total)


def test_pictures(engine: str) -> None:
    simulator = batch_on(engine, 1).simulator
    assert isinstance(simulator, PhysicsSimulator)
    simulator.state.goal[0] = simulator.state.pose[0, :2] + [0.5, 0.0]
    try:
        picture = simulator.picture(0, np.array([-1.0, 0.0, 1.5]), (160, 120))
    except InputError as error:
        pytest.skip(str(error))
    assert picture.shape == (120, 160, 3)
    red, green, blue = picture.astype(np.int64).reshape(-1, 3).T
    # The robot's blue, and the goal's green in the upper half, since it lies ahead.
    assert ((blue > red + 30) & (blue > green + 15)).sum() > 50
    is_green = (green > red + 30) & (green > blue + 15)
    assert is_green.sum() > 20
    assert np.flatnonzero(is_green).mean() // 160 < 60


def test_suites_on_engines_have_names_and_hashes_of_their_own() -> None:
    plane, body = read_suite("static", 1), read_suite("static", 1, backend="mujoco")
    assert (plane.name, body.name) == ("static", "static+mujoco")
    assert plane.hash != body.hash

    def heavier(backend: str | None) -> str:
        suite = read_suite("static", 1, backend=backend)
        changes = {"robot_changes": {"body": {"mass": 9.0}}}
        return type(suite)(suite.name, suite.task.model_copy(update=changes), 1).hash

    # The plane knows no mass.
    assert heavier(None) == plane.hash
    assert heavier("mujoco") != body.hash
