# SPDX-License-Identifier: Apache-2.0
"""What every environment must do, whatever its task."""

from __future__ import annotations

import os
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from pm01_nav.backends.gazebo.config import what_is_missing
from pm01_nav.envs import ENVIRONMENTS
from pm01_nav.envs.nav_env import NavEnv
from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.envs.vector_env import NavVectorEnv
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.tasks import TASKS, task_config
from pm01_nav.task.worlds import world_pool

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
FROM_FILES = ("map", "barn", "dynabarn")
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in TASKS if name not in FROM_FILES},
    "mixed with errors": ("mixed", {"randomization": default_randomization()}),
    "static for omni_disc": ("static", {"robot": "omni_disc"}),
    "static as dict": ("static", {"observation": {"space": "dict"}}),
    "crowd with errors for omni_disc": (
        "crowd",
        {"robot": "omni_disc", "randomization": default_randomization()},
    ),
}
"""Every task that needs no files, and what else must not matter: a task and changes to it."""
FEW = {"num_worlds": 8}
STEPS = 125


def short(case: str) -> TaskConfig:
    """Return a task with few worlds and episodes of at most 40 steps."""
    task, changes = CASES[case]
    return resolve_task(task, FEW | {"time_limit_s": 4.0} | changes)


def random_actions(
    num_steps: int, num_envs: int, axes: int = 2, seed: int = 0
) -> NDArray[np.float32]:
    """Return actions (num_steps, num_envs, axes), more often forwards than back."""
    rng, low = np.random.default_rng(seed), np.full(axes, -1.0)
    low[0] = -0.4
    return rng.uniform(low, 1.0, (num_steps, num_envs, axes)).astype(np.float32)


def flat(space: gym.Space[Any], observation: Any) -> NDArray[np.float32]:
    """Return one observation, or a batch of them, as one array, whatever the space is."""
    if not isinstance(space, gym.spaces.Dict):
        return observation
    parts = []
    for name, box in space.items():
        part = observation[name]
        parts.append(part.reshape(*part.shape[: part.ndim - len(box.shape)], -1))
    return np.concatenate(parts, axis=-1)


def share_memory(one: Any, two: Any) -> bool:
    if isinstance(one, dict):
        return any(share_memory(one[name], two[name]) for name in one)
    return np.shares_memory(one, two)


def make_sb3(config: TaskConfig, num_envs: int, **arguments: Any) -> NavVecEnv:
    pool = world_pool(config, "train", config.num_worlds)
    return NavVecEnv(NavigationBatch(config, pool, num_envs), **arguments)


def test_registered_tasks() -> None:
    assert ENVIRONMENTS["PM01Nav-v0"] == {"task": "article"}
    assert ENVIRONMENTS["PM01Nav-v1"] == {"task": "static"}


MISSING = what_is_missing()
GAZEBO = pytest.param(
    "PM01NavGazebo-v0",
    marks=[pytest.mark.gazebo, pytest.mark.skipif(bool(MISSING), reason=f"Gazebo: {MISSING}")],
)
IDS = [*(name for name in ENVIRONMENTS if "Gazebo" not in name), GAZEBO]


@pytest.mark.parametrize("id_", IDS)
def test_checkers_have_nothing_to_say(id_: str) -> None:
    check(id_)


@pytest.mark.parametrize("case", CASES)
def test_checkers_have_nothing_to_say_about_a_task(case: str) -> None:
    check("PM01Nav-v1", task=short(case))


def check(id_: str, **arguments: Any) -> None:
    """Let the checkers of Gymnasium and SB3 look at an environment; warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Gymnasium holds a lower version for a superseded one; v0 stays, it is the article's task.
        warnings.filterwarnings("ignore", message=".*PM01Nav-v0 is out of date.*")
        env = gym.make(id_, **arguments, **FEW)
        check_env(env.unwrapped, skip_render_check=True)
        if not env.unwrapped.batch.config.observation.normalize:
            # Physical units are what v0 is for; SB3 would rather see them normalised.
            warnings.filterwarnings("ignore", message=".*normalize.*", category=UserWarning)
        check_env_of_sb3(env.unwrapped, skip_render_check=True)
        env.close()


def test_checker_fails_on_a_broken_copy() -> None:
    class Broken(NavEnv):
        def step(self, action):
            observation, *rest = super().step(action)
            return observation + 100.0, *rest

    with pytest.raises(AssertionError):
        check_env_of_sb3(Broken("empty"), warn=False, skip_render_check=True)


@pytest.mark.filterwarnings("ignore:.*PM01Nav-v0 is out of date")
@pytest.mark.parametrize("id_", IDS)
def test_make_vec(id_: str) -> None:
    env = gym.make_vec(id_, num_envs=3, vectorization_mode="vector_entry_point", **FEW)
    assert isinstance(env.unwrapped, NavVectorEnv)
    assert env.num_envs == 3
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observation, infos = env.reset(seed=0)
    assert infos == {}
    assert env.observation_space.contains(observation)
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert reward.shape == terminated.shape == truncated.shape == (3,)
    assert terminated.dtype == truncated.dtype == np.bool_
    env.close()


@pytest.mark.parametrize("case", CASES)
def test_vector_environment_equals_single_ones(case: str) -> None:
    config, num_envs, seed = short(case), 3, 123
    many = NavVectorEnv(num_envs, config)
    singles = [NavEnv(config) for _ in range(num_envs)]
    space = many.single_observation_space
    observations = flat(space, many.reset(seed=seed)[0])
    for i, single in enumerate(singles):
        assert single.observation_space == space
        assert (flat(space, single.reset(seed=seed + i)[0]) == observations[i]).all()
    ended = np.zeros(num_envs, dtype=int)
    for actions in random_actions(STEPS, num_envs, many.single_action_space.shape[0]):
        batch, rewards, terminated, truncated, infos = many.step(actions)
        assert many.observation_space.contains(batch)
        observations = flat(space, batch)
        for i, single in enumerate(singles):
            observation, reward, over, late, info = single.step(actions[i])
            assert (reward, over, late) == (rewards[i], terminated[i], truncated[i])
            if over or late:
                ended[i] += 1
                assert infos["_final_obs"][i]
                last = infos["final_obs"][i]
                assert space.contains(last)
                assert (flat(space, last) == flat(space, observation)).all()
                assert infos["final_info"]["is_success"][i] == info["is_success"]
                assert infos["final_info"]["is_collision"][i] == info["is_collision"]
                observation, _ = single.reset()
            assert (flat(space, observation) == observations[i]).all()
    assert (ended >= 3).all()


@pytest.mark.parametrize("case", CASES)
def test_observations_are_alive_and_in_the_space(case: str) -> None:
    env = NavVectorEnv(8, short(case))
    space = env.single_observation_space
    before = env.reset(seed=0)[0]
    seen = [flat(space, before)]
    ends = 0
    for actions in random_actions(STEPS, 8, env.single_action_space.shape[0]):
        observation, _, terminated, truncated, _ = env.step(actions)
        assert not (terminated & truncated).any()
        assert not share_memory(observation, before)
        ends += int((terminated | truncated).sum())
        before = observation
        seen.append(flat(space, observation))
    assert ends >= 16
    everything = np.array(seen)
    assert everything.dtype == np.float32
    assert np.isfinite(everything).all()
    one_box = gym.spaces.flatten_space(space)
    assert ((everything >= one_box.low) & (everything <= one_box.high)).all()
    rows = everything.reshape(-1, everything.shape[-1])
    alive = rows.max(axis=0) > rows.min(axis=0)
    places = env.batch.layout.places
    if "trail" in places:
        # It shows places left long ago, for which these episodes are too short.
        alive[places["trail"]] = trail_is_alive(case)
    still = {name for name, place in places.items() if not alive[place].all()}
    # Its goals lie beyond the 10 m up to which distances are told.
    assert still == ({"goal_distance"} if case == "dynabarn_like" else set())


def trail_is_alive(case: str) -> NDArray[np.bool_]:
    """Drive figures of eight where there is room; return which numbers of the trail change."""
    task, changes = CASES[case]
    room = FEW | {"time_limit_s": 50.0, "suite": "empty"}
    env = NavVectorEnv(8, resolve_task(task, room | changes))
    rows = [env.reset(seed=0)[0]]
    drive = env.batch.layout.drive
    for step in range(400):
        # A circle of 0.45 m / s and 1 rad / s to the left, then one to the right.
        turn = 1.0 if step // 63 % 2 == 0 else -1.0
        command = drive.from_unicycle(np.tile([0.45, turn], (8, 1)))
        rows.append(env.step(drive.to_action(command))[0])
    seen = np.concatenate(rows)[:, env.batch.layout.places["trail"]]
    return seen.max(axis=0) > seen.min(axis=0)


@pytest.mark.parametrize("case", CASES)
def test_single_observations_share_no_memory(case: str) -> None:
    env = NavEnv(short(case))
    before, _ = env.reset(seed=0)
    space = env.observation_space
    copy = flat(space, before).copy()
    for action in random_actions(3, 1, env.action_space.shape[0])[:, 0]:
        after, *_ = env.step(action)
        assert not share_memory(before, after)
    assert (flat(space, before) == copy).all()
    assert not share_memory(before, env.reset()[0])


@pytest.mark.parametrize("task", ["static", "empty", "article"])
def test_two_resets_differ(task: str) -> None:
    env = NavEnv(short(task))
    first, _ = env.reset(seed=0)
    second, _ = env.reset()
    again, _ = env.reset(seed=0)
    assert (first != second).any()
    assert (first == again).all()


def test_unseeded_environments_differ() -> None:
    one, two = NavEnv(short("static")), NavEnv(short("static"))
    assert (one.reset()[0] != two.reset()[0]).any()


@pytest.mark.parametrize("case", CASES)
def test_actions_beyond_the_space_count_as_its_ends(case: str) -> None:
    one, two = NavEnv(short(case)), NavEnv(short(case))
    one.reset(seed=0)
    two.reset(seed=0)
    for _ in range(3):
        utmost = np.resize([1.0, -1.0], one.action_space.shape)
        first, second = one.step(9.0 * utmost), two.step(utmost)
        space = one.observation_space
        assert (flat(space, first[0]) == flat(space, second[0])).all()
        assert first[1] == second[1]


@pytest.mark.parametrize("case", CASES)
def test_terminal_observation_is_that_before_the_reset(case: str) -> None:
    config, n = short(case), 4
    env = make_sb3(config, n, seed=7)
    space = env.observation_space
    # A twin that is never reset shows each first episode's end as it was.
    pool = world_pool(config, "train", config.num_worlds)
    twin = NavigationBatch(config, pool, n, autoreset=False)
    assert (flat(space, env.reset()) == twin.reset(7 + np.arange(n))).all()
    running = np.ones(n, dtype=bool)
    returns = np.zeros(n)
    steps = random_actions(41, n, env.action_space.shape[0])
    for count, actions in enumerate(steps, start=1):
        observation, rewards, dones, infos = env.step(actions)
        observation = flat(space, observation)
        expected = twin.step(actions.astype(np.float64))
        returns += expected.reward
        for i in np.flatnonzero(running):
            assert bool(dones[i]) == bool(expected.terminated[i] | expected.truncated[i])
            assert rewards[i] == pytest.approx(expected.reward[i], rel=1e-6)
            if not dones[i]:
                assert infos[i] == {}
                assert (observation[i] == expected.observation[i]).all()
                continue
            running[i] = False
            last = infos[i]["terminal_observation"]
            assert space.contains(last)
            assert (flat(space, last) == expected.observation[i]).all()
            assert (observation[i] != expected.observation[i]).any()
            assert infos[i]["TimeLimit.truncated"] is bool(expected.truncated[i])
            assert infos[i]["episode"]["l"] == count
            assert infos[i]["episode"]["r"] == pytest.approx(returns[i], abs=1e-6)
    assert not running.any()


def test_sb3_infos_tell_how_episodes_ended() -> None:
    config = resolve_task("empty", {"time_limit_s": 6.0, "goal_distance": (0.5, 4.0)})
    env = make_sb3(config, 64, seed=0)
    observation = env.reset()
    seen = set()
    for actions in random_actions(200, 64):
        # Half of the robots know where they go.
        actions[:32] = go_to_goal(env.batch.layout, observation[:32])
        observation, rewards, dones, infos = env.step(actions)
        for i in np.flatnonzero(dones):
            info = infos[i]
            late, won = info["TimeLimit.truncated"], info["is_success"]
            # A goal and a collision each count 50 or more, all else in a step less than 10.
            assert (rewards[i] > 10.0) == won
            assert late == (info["episode"]["l"] == 60 and abs(rewards[i]) < 10.0)
            seen.add((late, won))
    # A truncation, a success and a collision.
    assert seen == {(True, False), (False, True), (False, False)}


def test_sb3_reward_scale() -> None:
    plain, scaled = (make_sb3(short("static"), 4, seed=1, reward_scale=s) for s in (1.0, 0.02))
    plain.reset()
    scaled.reset()
    for actions in random_actions(60, 4):
        rewards, infos = plain.step(actions)[1::2]
        fewer, same = scaled.step(actions)[1::2]
        assert fewer == pytest.approx(0.02 * rewards, rel=1e-6)
        assert [i.get("episode") for i in infos] == [i.get("episode") for i in same]


def test_sb3_seeds_make_environment_i_the_single_one() -> None:
    env = make_sb3(short("static"), 3, seed=50)
    first = env.reset()
    assert (env.reset() != first).any()
    env.seed(50)
    assert (env.reset() == first).all()
    assert (NavEnv(short("static")).reset(seed=52)[0] == first[2]).all()


def go_to_goal(layout, observation: NDArray[np.float32]) -> NDArray[np.float64]:
    """Turn towards the goal, then drive; only what the observation tells is used."""
    at = {}
    begin = 0
    for part in layout.parts:
        at[part.name] = slice(begin, begin + part.size)
        begin += part.size
    sin, cos = observation[:, at["goal_sin_cos"]].T
    bearing = np.arctan2(sin, cos)
    limits = layout.drive
    stop = -limits.linear_min * 2 / (limits.linear_max - limits.linear_min) - 1.0
    linear = np.where(np.abs(bearing) < 0.4, 1.0, stop)
    return np.stack([linear, np.clip(2.0 * bearing / limits.angular_max, -1, 1)], axis=-1)


def test_empty_rooms_are_solved_by_driving_at_the_goal() -> None:
    env = NavVectorEnv(64, "empty")
    observation, _ = env.reset(seed=0)
    first_end = np.full(64, -1)
    for _ in range(500):
        action = go_to_goal(env.batch.layout, observation)
        observation, _, terminated, truncated, infos = env.step(action)
        for i in np.flatnonzero(terminated | truncated):
            if first_end[i] < 0:
                first_end[i] = infos["final_info"]["is_success"][i]
        if (first_end >= 0).all():
            break
    assert first_end.mean() >= 0.95


@pytest.mark.parametrize("task", ["static", "barn_like"])
def test_pictures_have_a_shape_and_change(task: str) -> None:
    env = NavEnv(task, render_mode="rgb_array", num_worlds=2)
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step(np.array([1.0, 0.5]))
    second = env.render()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert min(first.shape[:2]) > 200
    assert first.shape == second.shape
    assert (first != second).any()
    env.close()


def test_pictures_of_a_vector_environment() -> None:
    env = NavVectorEnv(2, "static", render_mode="rgb_array", num_worlds=2)
    env.reset(seed=0)
    pictures = env.render()
    assert len(pictures) == 2
    assert (pictures[0] != pictures[1]).any()
    env.close()


def test_without_render_mode_there_is_no_picture() -> None:
    env = NavEnv("empty")
    env.reset(seed=0)
    assert env.render() is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "fly"}, "task = 'fly': unknown; allowed: "),
        ({"goal_radios": 1.0}, "goal_radios: unknown key"),
        ({"goal_radius": -1.0}, "goal_radius"),
        ({"render_mode": "ascii"}, "render_mode = 'ascii': allowed: human, rgb_array"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        NavEnv(**({"task": "empty"} | arguments))


def test_play_keeps_the_observation_layout() -> None:
    # Changing what only concerns playing must not change what a policy sees.
    plain = NavEnv("static", num_worlds=2)
    shown = NavEnv("static", num_worlds=2, time_limit_s=5.0, render_mode="rgb_array")
    assert plain.batch.layout == shown.batch.layout
    assert plain.observation_space == shown.observation_space
    assert task_config("static").observation == plain.batch.config.observation
