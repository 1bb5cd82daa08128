# SPDX-License-Identifier: Apache-2.0
"""How episodes end: by hand, by script, and one way at a time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pm01_nav.robot import full_circle
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.terminations import judge, out_of_time
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

ROOM = World(
    "room",
    (-5.0, -5.0, 5.0, 5.0),
    segments=np.array([[2.0, -5.0, 2.0, 5.0]]),
    start=(0.0, 0.0, 0.0),
    goal_area=(-4.0, -4.0, -4.0, -4.0),
)
STOP = -3 / 7
"""The action of 0 m/s for a robot with speeds from -0.2 to 0.5 m/s."""


def judged(collision: str, **rows):
    config = task_config("article" if collision == "scan" else "static")
    assert config.collision == collision
    step = SimpleNamespace(**{name: np.array(value) for name, value in rows.items()})
    reached, collided = judge(step, config)
    return reached.tolist(), collided.tolist()


def test_goal_radius_is_exclusive() -> None:
    distances, free = [0.31, 0.3, 0.2999, 0.0], [False] * 4
    assert judged("contact", goal_distance=distances, contact=free)[0] == [False, False, True, True]
    far = judged("scan", goal_distance=distances, nearest_return=[1.0] * 4)
    assert far == ([False, False, True, True], free)


def test_a_touch_spoils_the_arrival() -> None:
    # On the way; at the goal; a touch on the way; a touch at the goal.
    rows = {"goal_distance": [1.0, 0.1, 1.0, 0.1], "contact": [False, False, True, True]}
    assert judged("contact", **rows) == ([False, True, False, False], [False, False, True, True])


def test_article_asks_for_the_goal_before_the_collision() -> None:
    # The last two are both within 0.3 m of the goal and within 0.2 m of an obstacle, or too close
    # for the lidar: the goal counts.
    rows = {
        "goal_distance": [1.0, 1.0, 1.0, 1.0, 0.1, 0.1],
        "nearest_return": [0.21, 0.2, 0.199, -np.inf, 0.15, -np.inf],
    }
    reached, collided = judged("scan", **rows)
    assert reached == [False, False, False, False, True, True]
    assert collided == [False, False, True, True, False, False]


def test_time_is_up_with_the_last_step() -> None:
    step = SimpleNamespace(count=np.array([1, 499, 500, 501]))
    assert out_of_time(step, task_config("static")).tolist() == [False, False, True, True]


def batch_in_room(name: str, *, time_limit_s: float = 50.0, **arguments) -> NavigationBatch:
    beams = {"lidar": full_circle(20 if name == "article" else 36)}
    config = task_config(name).model_copy(
        update={"robot_changes": beams, "time_limit_s": time_limit_s}
    )
    batch = NavigationBatch(config, build_pool([ROOM], 0.27), 1, **arguments)
    batch.reset([0])
    return batch


def place(batch: NavigationBatch, pose, goal) -> None:
    batch.simulator.place(np.array([0]), [pose], [goal])


def run(batch: NavigationBatch, action, limit: int = 600):
    """Repeat an action until the episode ends; return the last step and how many there were."""
    for count in range(1, limit + 1):
        result = batch.step(np.array([action]))
        assert not (result.terminated & result.truncated).any()
        if result.episodes is not None:
            return result, count
        assert not (result.terminated | result.truncated).any()
    raise AssertionError("the episode never ended")


@pytest.mark.parametrize("name", ["static", "article"])
def test_goal_ends_the_episode(name: str) -> None:
    batch = batch_in_room(name)
    place(batch, [-2.0, 0.0, 0.0], [0.0, 0.0])
    result, count = run(batch, [1.0, 0.0])
    assert (result.terminated[0], result.truncated[0]) == (True, False)
    assert (result.episodes.success[0], result.episodes.collision[0]) == (True, False)
    # 1.7 m at 0.05 m a step: 34 steps, and 2 to 5 more to get up to speed (0.25 s and the lag).
    assert 35 <= count <= 40
    assert result.episodes.steps[0] == count


@pytest.mark.parametrize("name", ["static", "article"])
def test_collision_ends_the_episode(name: str) -> None:
    batch = batch_in_room(name, autoreset=False)
    place(batch, [0.0, 0.0, 0.0], [-4.0, -4.0])
    result, _ = run(batch, [1.0, 0.0])
    assert (result.terminated[0], result.truncated[0]) == (True, False)
    assert (result.episodes.success[0], result.episodes.collision[0]) == (False, True)
    x = batch.simulator.state.pose[0, 0]
    # The wall is at x = 2: the footprint of 0.17 m touches it (to a check of 0.05 m), or the
    # lidar sees it nearer than 0.2 m (to a step of 0.05 m).
    edge = 2.0 - (0.2 if name == "article" else 0.17)
    assert edge - 0.05 <= x <= edge + (0.05 if name == "article" else 0.0)


@pytest.mark.parametrize("name", ["static", "article"])
def test_time_truncates_the_episode(name: str) -> None:
    batch = batch_in_room(name, time_limit_s=1.2)
    result, count = run(batch, [STOP, 1.0])
    assert count == 12
    assert (result.terminated[0], result.truncated[0]) == (False, True)
    assert (result.episodes.success[0], result.episodes.collision[0]) == (False, False)
    # After the reset the clock starts anew.
    assert run(batch, [STOP, 0.0])[1] == 12


def test_arrival_in_the_last_step_is_a_success_and_no_truncation() -> None:
    batch = batch_in_room("static")
    place(batch, [-2.0, 0.0, 0.0], [0.0, 0.0])
    _, count = run(batch, [1.0, 0.0])
    batch = batch_in_room("static", time_limit_s=0.1 * count)
    place(batch, [-2.0, 0.0, 0.0], [0.0, 0.0])
    result, _ = run(batch, [1.0, 0.0])
    assert (result.terminated[0], result.truncated[0]) == (True, False)


def test_last_observation_is_that_before_the_reset() -> None:
    # A twin that is not reset shows what the last observation was.
    batch, twin = batch_in_room("static"), batch_in_room("static", autoreset=False)
    for one in (batch, twin):
        place(one, [0.0, 0.0, 0.0], [-4.0, -4.0])
    result, _ = run(batch, [1.0, 0.0])
    last, _ = run(twin, [1.0, 0.0])
    assert (result.episodes.final_observation[0] == last.observation[0]).all()
    assert (result.observation[0] != last.observation[0]).any()
    # The new episode begins at the world's start, at rest, with no last action.
    assert batch.simulator.state.pose[0].tolist() == [0.0, 0.0, 0.0]
    assert batch.simulator.state.twist[0].tolist() == [0.0, 0.0]
    assert result.observation[0, -2:].tolist() == [0.0, 0.0]
