# SPDX-License-Identifier: Apache-2.0
"""Earlier scans: which ones are shown, and that environments and policies agree."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.policy.network_policy import NetworkPolicy
from pm01_nav.task.frames import FramesLayout, FrameStack
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import RandomizationConfig
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

ALL = slice(None)


def scans(*values: float) -> np.ndarray:
    """Return one number for each of two robots; the second robot's are ten times as large."""
    return np.array([[v, 10 * v] for v in values], dtype=np.float32)[:, :, None]


def test_earlier_scans_are_shown_newest_first() -> None:
    stack = FrameStack(FramesLayout(count=2, interval_s=0.2), 0.1, 2, 1)
    first, *others = scans(0, 1, 2, 3, 4, 5, 6, 7)
    stack.begin(ALL, first)
    shown = []
    for nearest in others:
        stack.push(nearest)
        shown.append([float(scan[0, 0]) for scan in stack.show(ALL)])
    # Before the first scan the robot has seen nothing else.
    assert shown[:3] == [[1, 0, 0], [2, 0, 0], [3, 1, 0]]
    assert shown[-1] == [7, 5, 3]
    assert [scan.tolist() for scan in stack.show(np.array([1]))] == [[[70]], [[50]], [[30]]]


def test_one_robot_begins_anew() -> None:
    stack = FrameStack(FramesLayout(count=1, interval_s=0.1), 0.1, 2, 1)
    for nearest in scans(1, 2):
        stack.push(nearest)
    stack.begin(np.array([1]), np.array([[5.0]], dtype=np.float32))
    assert [scan[:, 0].tolist() for scan in stack.show(ALL)] == [[2, 5], [1, 5]]


def test_kept_robots_drive_on_as_if_beside_the_others() -> None:
    # Perturbed robots in worlds with movers, and a policy that remembers scans and places.
    config = task_config("mixed").model_copy(update={"randomization": RandomizationConfig()})
    pool = world_pool(config, "train", 6)
    all_six, kept = (NavigationBatch(config, pool, 6, autoreset=False) for _ in range(2))
    some = np.array([4, 1, 2])
    rows, seen = {6: np.arange(6), 3: some}, {6: [], 3: []}

    def remember(shown: np.ndarray) -> np.ndarray:
        seen[len(shown)].append(shown)
        return (0.1 * rows[len(shown)][:, None] * [1.0, 1.0]).astype(np.float32)

    policies = [NetworkPolicy(kept.layout, remember, config.control_dt) for _ in range(2)]
    for batch in (all_six, kept):
        batch.reset(np.arange(6), np.arange(6))
    for step in range(30):
        if step == 14:
            kept.keep(some)
            policies[1].keep(some)
        for batch, policy in zip((all_six, kept), policies, strict=True):
            sim = batch.simulator
            batch.advance(policy.act(sim.scan, sim.measured_goal, sim.measured_twist))
    assert len(seen[3]) == 16
    for whole, part in zip(seen[6][-16:], seen[3], strict=True):
        assert np.array_equal(whole[some], part)
    for name, array in kept.simulator.arrays().items():
        assert np.array_equal(all_six.simulator.arrays()[name][some], array), name


@pytest.mark.parametrize("wrong", [{"count": 0}, {"interval_s": -1.0}])
def test_impossible_layouts_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError, match=f"frames.{next(iter(wrong))}"):
        FramesLayout(**wrong)


def test_environment_and_policy_show_the_same() -> None:
    task = task_config("crowd").model_dump()
    task["observation"] |= {"frames": {"count": 2, "interval_s": 0.3}, "normalize": False}
    config = type(task_config("crowd")).model_validate(task)
    batch = NavigationBatch(config, world_pool(config, "train", 4), 4)
    observation = batch.reset(np.arange(4))
    seen = []

    def remember(shown: np.ndarray) -> np.ndarray:
        seen.append(shown)
        return np.tile([0.3, 0.4], (len(shown), 1)).astype(np.float32)

    policy = NetworkPolicy(batch.layout, remember, config.control_dt)
    for _ in range(9):
        goal = batch.simulator.measured_goal
        forward, left = goal[:, 0] * np.cos(goal[:, 1]), goal[:, 0] * np.sin(goal[:, 1])
        command = policy.act(
            batch.simulator.scan, np.stack([forward, left], -1), batch.simulator.measured_twist
        )
        scan_parts = slice(0, batch.layout.part("scan").size)
        assert seen[-1][:, scan_parts] == pytest.approx(observation[:, scan_parts], abs=1e-6)
        result = batch.step(batch.layout.drive.to_action(command))
        assert result.episodes is None
        observation = result.observation
    assert not np.array_equal(observation[:, :36], observation[:, 36:72])


def test_the_memory_is_part_of_the_state() -> None:
    task = task_config("crowd").model_copy(
        update={
            "observation": task_config("crowd").observation.model_copy(
                update={"frames": FramesLayout()}
            )
        }
    )
    pool = world_pool(task, "train", 4)
    one, other = (NavigationBatch(task, pool, 4) for _ in range(2))
    for batch in (one, other):
        batch.reset(np.arange(4))
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 4, 2))
    for action in actions[:5]:
        one.step(action)
    other.load_state_dict(one.state_dict())
    for action in actions[5:]:
        assert np.array_equal(one.step(action).observation, other.step(action).observation)
