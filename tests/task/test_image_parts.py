# SPDX-License-Identifier: Apache-2.0
"""An image as a part: a grid around the robot, flat and in a ``Dict``; only this file knows it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3 import PPO

from pm01_nav.config import validate
from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.envs.spaces import observation_space
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.policy.export import export_policy, greedy_policy, policy_metadata
from pm01_nav.task.config import TaskConfig, observation_layout
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.observation import ObservationLayout, Observer
from pm01_nav.task.parts import PARTS, Elapsed, Memory, ObservationPart, Seen, observation_part
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.checkpoint import load_checkpoint
from pm01_nav.training.config import RunConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet

SIDE = 24


@dataclass(frozen=True)
class LocalMap(ObservationPart):
    """Where the lidar sees something: row by x, column by y of its frame, 1 where a return is."""

    name = "local_map"

    cell: float = 0.25

    @property
    def shape(self) -> tuple[int, ...]:
        return (1, SIDE, SIDE)

    @property
    def bounds(self) -> tuple[float, float]:
        return 0.0, 1.0

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        lidar = self.lidar
        angle = lidar.angle_min + lidar.angle_increment * np.arange(lidar.num_beams)
        hit = np.isfinite(seen.ranges)
        ranges = np.where(hit, seen.ranges, 0.0)[..., None]
        ahead = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        at = np.floor(ranges * ahead / self.cell).astype(int) + SIDE // 2
        robot, beam = np.nonzero(hit & ((at >= 0) & (at < SIDE)).all(axis=-1))
        grid = np.zeros((len(ranges), *self.shape), dtype=np.float32)
        row, column = at[robot, beam].T
        grid[robot, 0, row, column] = 1.0
        return (grid,)


@pytest.fixture(autouse=True)
def own_part() -> Iterator[None]:
    observation_part(LocalMap)
    yield
    del PARTS["local_map"]


def with_map(space: str) -> TaskConfig:
    config = task_config("static").model_dump() | {"num_worlds": 4}
    config["observation"] |= {"parts": {"local_map": {}}, "space": space}
    return TaskConfig.model_validate(config)


def layout_of(space: str) -> ObservationLayout:
    config = with_map(space)
    return observation_layout(config, config.robot_spec())


def test_pixels_of_one_scan() -> None:
    layout = layout_of("dict")
    ranges = np.full((2, 360), np.inf, dtype=np.float32)
    # Beam k looks to k - 180 degrees; the robot stands in the corner of the cells 11 and 12.
    ranges[1, 210] = 1.6  # 30: x = 1.386 is 5.5 cells ahead, y = 0.8 is 3.2 to the left
    ranges[1, 60] = 2.1  # -120: x = -1.05 is 4.2 cells behind, y = -1.819 is 7.3 to the right
    ranges[1, 5] = 3.3  # beyond the map, which ends at 3 m
    zeros = np.zeros((2, 2))
    seen = Seen(ranges, zeros, zeros, zeros, Elapsed(0.1))
    observation = Observer(layout, lambda part: Memory()).show(seen)
    expected = np.zeros((2, 1, 24, 24))
    expected[1, 0, 17, 15] = expected[1, 0, 7, 4] = 1.0
    parts = layout.split(observation)
    assert np.array_equal(parts["local_map"], expected)
    # Flat it lies row by row at the end: 43 numbers come before.
    assert np.flatnonzero(observation[1, 43:]).tolist() == [7 * 24 + 4, 17 * 24 + 15]
    assert observation.shape == (2, 43 + 576)


def test_spaces() -> None:
    flat, parts = (observation_space(layout_of(space)) for space in ("flat", "dict"))
    assert isinstance(parts, spaces.Dict)
    shapes = {name: box.shape for name, box in parts.items()}
    assert shapes == {
        "scan": (36,),
        "goal_distance": (1,),
        "goal_sin_cos": (2,),
        "linear_velocity": (1,),
        "angular_velocity": (1,),
        "previous_action": (2,),
        "local_map": (1, 24, 24),
    }
    assert spaces.flatten_space(parts) == flat
    # The slowest speed of the robot is -0.2 m/s, the fastest 0.5 m/s, by which it is divided.
    speed = parts["linear_velocity"]
    assert isinstance(speed, spaces.Box)
    assert (speed.low[0], speed.high[0]) == pytest.approx((-0.4, 1.0))


def commands(config: TaskConfig, policies: list[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what two policies command, the first of which drives: (steps, robots, 2) each."""
    batch = NavigationBatch(config, world_pool(config, "train", 4), 5, autoreset=False)
    batch.reset(np.arange(5))
    answers: list[list[Any]] = [[], []]
    for _ in range(8):
        sim = batch.simulator
        polar = sim.measured_goal
        goal = polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=-1)
        for policy, given in zip(policies, answers, strict=True):
            given.append(policy.act(sim.scan, goal, sim.measured_twist))
        batch.step(batch.layout.drive.to_action(answers[0][-1]))
    return np.array(answers[0]), np.array(answers[1])


def check_file(config: TaskConfig, path: Path, greedy: Any) -> None:
    """The file takes one array, commands as torch does, and looks at the map."""
    exported = OnnxPolicy(path, config.robot_spec())
    assert exported.layout.space == "flat"
    ours, theirs = commands(config, [exported, greedy])
    assert np.ptp(ours, axis=0).max() > 1e-4
    assert ours == pytest.approx(theirs, abs=1e-5)
    rows = np.zeros((2, exported.layout.size), dtype=np.float32)
    rows[1, exported.layout.places["local_map"]] = 1.0
    if exported.memory_size:
        answer, _ = exported._network(rows, np.zeros((2, exported.memory_size), dtype=np.float32))
    else:
        answer = exported._network(rows)
    without, full = answer
    assert abs(without - full).max() > 1e-4


def run_config(space: str, algo: str = "ppo", steps: int = 512, **more: Any) -> RunConfig:
    ppo = {"n_envs": 4, "n_steps": 32, "batch_size": 64, "n_epochs": 1, "net_arch": (8, 8)}
    options = {"steps": steps, "eval_every": 256, "eval_episodes": 4, "threads": 1}
    options |= {"algo": algo, algo: ppo | more}
    return validate(RunConfig, {"task": with_map(space).model_dump(), "train": options}, "run")


@pytest.mark.parametrize(
    ("space", "algo", "more"),
    [
        ("flat", "ppo", {}),
        ("dict", "ppo", {"norm_reward": True}),
        ("dict", "ppo_lstm", {"lstm_hidden_size": 8, "features_extractor": "circular_conv"}),
    ],
)
def test_ppo_trains_on_it_and_the_file_does_the_same(
    tmp_path: Path, space: str, algo: str, more: dict[str, Any]
) -> None:
    folder = RunFolder(tmp_path / "run")
    # A checkpoint of dicts is gone on with; flat ones are elsewhere.
    for steps in (256, 512) if space == "dict" else (512,):
        run = run_config(space, algo, steps, **more)
        resume = folder.last.exists()
        result = train(run, folder, Quiet(), started_at=time.perf_counter(), resume=resume)
        assert result.steps == steps
    chosen, layout = run.train.hyperparameters, layout_of(space)
    policy = chosen.implementation().make_policy(chosen, layout)
    # By default only a Dict's images go through convolutions.
    assert any("images" in name for name in policy.state_dict()) == (space == "dict")
    policy.load_state_dict(load_checkpoint(folder.best)["policy"])
    check_file(run.task, folder.policy, greedy_policy(policy, layout, run.task.control_dt))


def test_sb3s_own_policy_for_dicts_is_exported(tmp_path: Path) -> None:
    config, layout = with_map("dict"), layout_of("dict")
    env = NavVecEnv(NavigationBatch(config, world_pool(config, "train", 4), 4))
    model = PPO("MultiInputPolicy", env, n_steps=32, batch_size=64, n_epochs=1, seed=0)
    model.learn(256)
    metadata = policy_metadata(layout, config.robot_spec(), config.control_dt, {})
    export_policy(model.policy, layout, metadata, tmp_path / "own.onnx")
    check_file(config, tmp_path / "own.onnx", greedy_policy(model.policy, layout, 0.1))


@pytest.mark.parametrize(
    ("train_settings", "key"),
    [
        ({"algo": "sac"}, "algo = sac"),
        ({"learner": "rsl_rl"}, "learner = rsl_rl"),
        ({"workers": 2}, "workers"),
        ({"icm": {}}, "icm"),
        ({"rnd": {}}, "rnd"),
        ({"ppo": {"norm_obs": True}}, "ppo.norm_obs"),
        ({"ppo": {"asymmetric_critic": True}}, "ppo.asymmetric_critic"),
    ],
)
def test_what_cannot_read_dicts_says_so(train_settings: dict[str, Any], key: str) -> None:
    for space in ("flat", "dict"):
        data = {"task": with_map(space).model_dump(), "train": {"steps": 1} | train_settings}
        if space == "flat":
            validate(RunConfig, data, "run")
            continue
        with pytest.raises(InputError, match=f"train.{key}: needs task.observation.space = flat"):
            validate(RunConfig, data, "run")
