# SPDX-License-Identifier: Apache-2.0
"""What Gymnasium and SB3 promise of any environment, against their own batches of single ones."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers.vector import (
    DictInfoToList,
    FlattenObservation,
    NormalizeObservation,
    NormalizeReward,
    RecordEpisodeStatistics,
)
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv

from pm01_nav.envs.nav_env import NavEnv
from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.envs.vector_env import NavVectorEnv
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.worlds import world_pool

ID = "pm01_nav.envs:PM01Nav-v1"
FEW = {"num_worlds": 4, "time_limit_s": 1.2}
NEXT_STEP, SAME_STEP, DISABLED = (
    AutoresetMode.NEXT_STEP,
    AutoresetMode.SAME_STEP,
    AutoresetMode.DISABLED,
)
MODES = (NEXT_STEP, SAME_STEP, DISABLED)
NUM_ENVS, STEPS = 3, 45


def actions(seed: int = 0) -> NDArray[np.float32]:
    """Return actions (STEPS, NUM_ENVS, 2), more often forwards than back."""
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.4, -1.0], [1.0, 1.0], (STEPS, NUM_ENVS, 2)).astype(np.float32)


def everything() -> TaskConfig:
    """Return a task with all that an episode may leave behind: movers, errors, memories, ways."""
    return resolve_task("mixed", FEW | {"randomization": default_randomization().model_dump()})


def as_dict() -> TaskConfig:
    """Return a task whose observations come by parts, one of them of two dimensions."""
    observation = {"space": "dict", "frames": {"count": 1}}
    return resolve_task("static", FEW | {"observation": observation})


def pair(mode: AutoresetMode, task: str | TaskConfig = "static") -> tuple[VectorEnv, VectorEnv]:
    """Return our batch and Gymnasium's batch of single environments."""
    ours = NavVectorEnv(NUM_ENVS, task, autoreset_mode=mode, **FEW)
    singles = [lambda: NavEnv(task, **FEW)] * NUM_ENVS
    return ours, SyncVectorEnv(singles, autoreset_mode=mode)


def assert_same(ours: Any, theirs: Any, where: str = "") -> None:
    """Compare arrays bit by bit, dictionaries key by key; ``theirs`` may have rows of None."""
    if isinstance(theirs, dict):
        assert set(ours) == set(theirs), where
        for key in theirs:
            assert_same(ours[key], theirs[key], f"{where}/{key}")
    elif theirs.dtype == object:
        for i, row in enumerate(theirs):
            if isinstance(row, dict):
                assert_same(ours[i], row, where)
            else:
                assert row is None or np.array_equal(ours[i], row), where
    else:
        assert ours.dtype == theirs.dtype, where
        assert np.array_equal(ours, theirs, equal_nan=True), where


def drive(ours: VectorEnv, theirs: VectorEnv, seed: Any) -> NDArray[np.int64]:
    """Reset and step both alike and compare; return how many episodes of each ended."""
    mode, ended = theirs.metadata["autoreset_mode"], np.zeros(NUM_ENVS, dtype=np.int64)
    for one, two in zip(ours.reset(seed=seed), theirs.reset(seed=seed), strict=True):
        assert_same(one, two, "reset")
    for k, action in enumerate(actions()):
        results = ours.step(action), theirs.step(action)
        for n, (one, two) in enumerate(zip(*results, strict=True)):
            assert_same(one, two, f"step {k}, part {n}")
        over = results[1][2] | results[1][3]
        ended += over
        if mode is DISABLED and over.any():
            resets = [env.reset(options={"reset_mask": over.copy()}) for env in (ours, theirs)]
            for one, two in zip(*resets, strict=True):
                assert_same(one, two, f"reset after step {k}")
    return ended


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task", ["static", "everything", "dict"])
def test_modes_equal_gymnasiums_batch_of_single_ones(mode: AutoresetMode, task: str) -> None:
    others = {"everything": everything, "dict": as_dict}
    ours, theirs = pair(mode, others[task]() if task in others else task)
    assert ours.metadata["autoreset_mode"] is mode
    assert (drive(ours, theirs, [11, 5, 300]) >= 2).all()
    # Again, from where all of them are: without a seed, and with one for some.
    assert (drive(ours, theirs, None) >= 2).all()
    assert (drive(ours, theirs, [None, 5, None]) >= 2).all()


def test_a_mask_resets_some_and_seeds_count_there_only() -> None:
    for mode in MODES:
        ours, theirs = pair(mode)
        drive(ours, theirs, 3)
        mask = np.array([True, False, True])
        resets = [
            env.reset(seed=[8, 9, None], options={"reset_mask": mask.copy()})
            for env in (ours, theirs)
        ]
        assert_same(resets[0][0], resets[1][0])
        # The mask in the caller's options stays where it is.
        options = {"reset_mask": mask}
        ours.reset(options=options)
        assert options["reset_mask"] is mask


@pytest.mark.parametrize(
    ("wrapper", "modes"),
    [
        (NormalizeObservation, [NEXT_STEP]),
        (FlattenObservation, [NEXT_STEP, DISABLED]),
        (NormalizeReward, MODES),
        (RecordEpisodeStatistics, [NEXT_STEP, SAME_STEP]),
        (DictInfoToList, MODES),
    ],
)
def test_gymnasiums_wrappers_do_the_same_as_over_its_own(wrapper: Any, modes: Any) -> None:
    for mode in modes:
        ours, theirs = (wrapper(env) for env in pair(mode))
        ours.reset(seed=1), theirs.reset(seed=1)
        for action in actions():
            one, two = ours.step(action), theirs.step(action)
            assert_same(one[0], two[0])
            assert_same(one[1], two[1])
            if wrapper is DictInfoToList:
                assert [sorted(info) for info in one[4]] == [sorted(info) for info in two[4]]
            elif "episode" in two[4]:
                for key in ("r", "l"):
                    assert_same(one[4]["episode"][key], two[4]["episode"][key])
            over = two[2] | two[3]
            if mode is DISABLED and over.any():
                for env in (ours, theirs):
                    env.reset(options={"reset_mask": over.copy()})


def test_statistics_of_masked_resets_are_of_the_masked_ones() -> None:
    env = RecordEpisodeStatistics(NavVectorEnv(2, "empty", autoreset_mode="Disabled", **FEW))
    env.reset(seed=0)
    still = np.full((2, 2), -0.4)
    for _ in range(5):
        env.step(still)
    env.reset(options={"reset_mask": np.array([True, False])})
    lengths = []
    for _ in range(7):
        infos = env.step(still)[4]
        lengths.append(infos.get("episode", {}).get("l"))
    # The second one is 12 steps old when the first one is 7.
    assert lengths[:-1] == [None] * 6
    assert lengths[-1].tolist() == [0, 12]


def test_disabled_refuses_to_go_on_after_the_end() -> None:
    env = NavVectorEnv(2, "empty", autoreset_mode="Disabled", num_worlds=1, max_episode_steps=1)
    env.reset(seed=0)
    _, _, terminated, truncated, infos = env.step(np.zeros((2, 2)))
    assert (terminated | truncated).all()
    assert "final_obs" not in infos
    with pytest.raises(ResetNeeded, match=r"\[0, 1\] are over"):
        env.step(np.zeros((2, 2)))
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match=r"\[1\] are over"):
        env.step(np.zeros((2, 2)))


def test_lists_of_seeds_by_gymnasiums_rules() -> None:
    env, single = NavVectorEnv(3, "static", **FEW), NavEnv("static", **FEW)
    first, _ = env.reset(seed=[1, 2, 3])
    for i, seed in enumerate((1, 2, 3)):
        assert (single.reset(seed=seed)[0] == first[i]).all()
    # Without a seed each goes on with its own numbers, which are those of the single one.
    second, _ = env.reset()
    assert (single.reset()[0] == second[2]).all()
    assert (second != first).any(axis=1).all()
    env.reset(seed=(1, 2, 3))
    assert (env.reset()[0] == second).all()
    # None goes on, too; a number beside it begins anew.
    env.reset(seed=np.array([1, 2, 3]))
    mixed, _ = env.reset(seed=[None, 2, None])
    assert (mixed == np.stack([second[0], first[1], second[2]])).all()
    # Seeds have no upper end.
    huge = 2**70 + 5
    assert (env.reset(seed=[huge, 0, 0])[0][0] == single.reset(seed=huge)[0]).all()


def test_environments_that_never_had_a_seed_draw_one() -> None:
    one, two = NavVectorEnv(2, "static", **FEW), NavVectorEnv(2, "static", **FEW)
    first, other = (env.reset(seed=[None, 4])[0] for env in (one, two))
    assert (first[0] != other[0]).any()
    assert (first[1] == other[1]).all()
    # Looking at the generator is no seed.
    singles = NavEnv("static", **FEW), NavEnv("static", **FEW)
    for single in singles:
        assert single.np_random is not None
    assert (singles[0].reset()[0] != singles[1].reset()[0]).any()


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"seed": [7]}, "seed: a list of 1, needs one for each of 3"),
        ({"seed": [1, 2, 3, 4]}, "a list of 4"),
        ({"seed": [1, -2, 3]}, "seed = -2: must be"),
        ({"seed": 1.5}, "seed = 1.5: must be"),
        ({"options": {"reset_mask": np.ones(2, dtype=bool)}}, r"shape \(2,\), needs bool \(3,\)"),
        ({"options": {"reset_mask": np.ones(3)}}, "float64 of shape"),
        ({"options": {"reset_mask": np.zeros(3, dtype=bool)}}, "must be True somewhere"),
    ],
)
def test_wrong_resets_are_refused(how: dict[str, Any], message: str) -> None:
    env = NavVectorEnv(3, "empty", **FEW)
    with pytest.raises(InputError, match=message):
        env.reset(**how)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((3, 2)))
    with pytest.raises(InputError, match="the first reset is one of all"):
        env.reset(options={"reset_mask": np.array([True, False, True])})


def batch(config: TaskConfig, num_envs: int) -> NavigationBatch:
    return NavigationBatch(config, world_pool(config, "train", config.num_worlds), num_envs)


def test_actions_may_be_lists_and_of_any_number() -> None:
    config = resolve_task("static", FEW)
    given = [np.float32([1.0, 0.0]), np.float32([0.0, -1.0])]
    for same in (given, [[1, 0], [0, -1]], np.array(given, dtype=np.int64), ((1.0, 0), (0, -1))):
        rows = []
        for actions_ in (same, np.array(given)):
            sb3, gymnasium = NavVecEnv(batch(config, 2), seed=5), NavVectorEnv(2, config)
            sb3.reset(), gymnasium.reset(seed=5)
            rows.append((sb3.step(actions_)[0], gymnasium.step(actions_)[0]))
        assert all((row == rows[1][0]).all() for row in (*rows[0], *rows[1]))
    singles = NavEnv(config), NavEnv(config)
    observations = []
    for single, action in zip(singles, ([1, 0], np.float64([1.0, 0.0])), strict=True):
        single.reset(seed=5)
        observations.append(single.step(action)[0])
    assert (observations[0] == observations[1]).all()
    assert (observations[0] == rows[0][0][0]).all()


@pytest.mark.parametrize(
    "wrong", [[0.0], [[0.0, 0.0]], np.zeros((3, 2)), [[0.0], [0.0, 1.0]], "ahead", None]
)
def test_actions_of_another_shape_are_refused_in_one_line(wrong: Any) -> None:
    config = resolve_task("empty", FEW)
    for env in (NavVecEnv(batch(config, 2)), NavVectorEnv(2, config), NavEnv(config)):
        env.reset()
        with pytest.raises(InputError, match=r"^actions: .*needs (shape )?\((2, )?2,?\)$"):
            env.step(wrong)


def test_steps_before_a_reset_are_refused() -> None:
    with pytest.raises(ResetNeeded, match="call reset"):
        NavEnv("empty", **FEW).step([0.0, 0.0])
    with pytest.raises(ResetNeeded, match="call reset"):
        NavVectorEnv(2, "empty", render_mode="rgb_array", **FEW).render()


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
def test_max_episode_steps_is_the_time_limit(mode: str) -> None:
    env = gym.make_vec(ID, 2, mode, num_worlds=4, task="empty", max_episode_steps=5)
    env.reset(seed=0)
    for count in range(1, 6):
        *_, truncated, infos = env.step(np.full((2, 2), -0.4))
        assert truncated.tolist() == [count == 5] * 2
    ours = infos["final_info"] if mode == "vector_entry_point" else infos
    assert ours["is_success"].tolist() == [False, False]


def test_max_episode_steps_and_other_names() -> None:
    assert NavVectorEnv(1, "empty", max_episode_steps=900).batch.config.time_limit_s == 90.0
    for own in (None, -1):
        config = NavVectorEnv(1, "empty", max_episode_steps=own).batch.config
        assert config.time_limit_s == 50.0
    with pytest.raises(InputError, match="two names of one thing"):
        NavVectorEnv(1, "empty", max_episode_steps=9, time_limit_s=0.8)
    with pytest.raises(InputError, match="max_episode_steps = 0: must be a whole number"):
        NavVectorEnv(1, "empty", max_episode_steps=0)
    with pytest.raises(InputError, match="autoreset_mode = 'Later': allowed: NextStep, SameStep"):
        NavVectorEnv(1, "empty", autoreset_mode="Later")
    with pytest.raises(InputError, match="num_envs = 0"):
        NavVectorEnv(0, "empty")
    assert (
        NavVectorEnv(1, "empty", autoreset_mode="NEXT_STEP").metadata["autoreset_mode"] is NEXT_STEP
    )
    assert NavEnv("empty", control_dt=0.05).metadata["render_fps"] == 20
    assert NavEnv.metadata["render_fps"] == 10


def test_sb3_equals_its_own_batch_of_single_ones() -> None:
    config = resolve_task("static", FEW)
    ours = NavVecEnv(batch(config, NUM_ENVS), seed=40)
    theirs = DummyVecEnv([lambda: NavEnv(config)] * NUM_ENVS)
    assert ours.seed(40) == theirs.seed(40)
    assert (ours.reset() == theirs.reset()).all()
    ends = 0
    for action in actions():
        one, two = ours.step(action), theirs.step(action)
        for mine, other in zip(one[:3], two[:3], strict=True):
            assert mine.dtype == other.dtype
            assert (mine == other).all()
        for mine, other in zip(one[3], two[3], strict=True):
            if mine:
                ends += 1
                assert (mine["terminal_observation"] == other["terminal_observation"]).all()
                for key in ("TimeLimit.truncated", "is_success"):
                    assert mine[key] == other[key]
            else:
                assert "terminal_observation" not in other
    assert ends >= 6
    assert ours.get_attr("reward_scale", [0, 2]) == [1.0, 1.0]
    with pytest.raises(InputError, match="share their attributes"):
        ours.set_attr("reward_scale", 0.5, indices=[0])
    ours.set_attr("reward_scale", 0.5)
    assert ours.reward_scale == 0.5


def test_sb3_renders_a_tile_for_each_robot() -> None:
    config = resolve_task("empty", FEW)
    env = NavVecEnv(batch(config, 4), render_mode="rgb_array")
    env.reset()
    first = env.render()
    tile = env.get_images()[0].shape
    assert first.shape == (2 * tile[0], 2 * tile[1], 3)
    env.step(np.ones((4, 2)))
    assert (env.render() != first).any()
    assert NavVecEnv(batch(config, 2)).get_images() == [None, None]
    with pytest.raises(InputError, match="render_mode = 'human': allowed"):
        NavVecEnv(batch(config, 1), render_mode="human")


@pytest.mark.parametrize(
    ("library", "context"),
    [
        ("gymnasium", "fork"),
        ("sb3", "fork"),
        pytest.param("gymnasium", "spawn", marks=pytest.mark.slow),
        pytest.param("sb3", "forkserver", marks=pytest.mark.slow),
    ],
)
def test_a_batch_of_one_starts_no_threads(library: str, context: str) -> None:
    script = Path(__file__).with_name("forked_envs.py")
    command = [sys.executable, str(script), library, context]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout.strip().splitlines()[-1])
    # 43 numbers at the reset, and 43 with a reward and two ends in each of 20 steps; SB3 has one.
    assert found["size"] == 43 + 20 * (46 if library == "gymnasium" else 45)
    assert found["apart"] == 0.0
