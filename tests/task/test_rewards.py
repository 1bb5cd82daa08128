# SPDX-License-Identifier: Apache-2.0
"""Each reward term at points worked out by hand, and their sum."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot import full_circle
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.rewards import NEEDS, REWARDS, reward_term
from pm01_nav.task.step import Step
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool


def step(**values: Any) -> Step:
    """Return a step in which nothing happens but ``values``, each given as a list of rows."""
    fields: dict[str, Any] = dict.fromkeys(
        ("pose", "twist", "command", "read_scan", "clearance", "contact", "visited", "count"), None
    )
    fields |= {"goal_distance": [1.0], "goal_bearing": [0.0], "previous_goal_distance": [1.0]}
    fields |= {"path_distance": [1.5], "previous_path_distance": [1.5]}
    fields |= values
    gap = fields.pop("mover_gap", None)
    rows = {name: None if v is None else np.array(v) for name, v in fields.items()}
    rows["read_mover_gap"] = lambda: np.array(gap)
    return Step(xp=np, **rows)


@pytest.mark.parametrize(
    ("term", "values", "params", "expected"),
    [
        ("goal", {"reached": [True, False]}, {}, [1, 0]),
        ("revisiting", {"visited": [[0.9, 0.0], [0.3, 0.7]]}, {}, [0, 0.7]),
        ("collision", {"collided": [True, False]}, {}, [1, 0]),
        (
            "progress",
            {"previous_goal_distance": [3.0, 3.0, 3.0], "goal_distance": [2.96, 3.0, 3.02]},
            {},
            [0.04, 0.0, -0.02],
        ),
        (
            "path_progress",
            {"previous_path_distance": [3.0, 8.0], "path_distance": [2.96, 8.05]},
            {},
            [0.04, -0.05],
        ),
        ("time", {"goal_distance": [0.0, 5.0]}, {}, [1, 1]),
        ("turning", {"command": [[0.5, -1.5], [0.0, 0.3], [0.2, 0.0]]}, {}, [1.5, 0.3, 0.0]),
        ("speed", {"command": [[0.5, -1.5], [-0.2, 0.3], [0.0, 1.0]]}, {}, [0.5, 0.2, 0.0]),
        (
            "heading",
            {"goal_bearing": [0.0, np.pi / 2, -np.pi / 2, -np.pi]},
            {},
            [1.0, 0.5, 0.5, 0.0],
        ),
        # A mover that is not there is infinitely far away.
        (
            "personal_space",
            {"mover_gap": [-0.1, 0.0, 0.25, 0.5, np.inf]},
            {},
            [1.0, 1.0, 0.5, 0.0, 0.0],
        ),
        # 0 from the margin outwards, 1 in contact, and even between.
        (
            "proximity",
            {"clearance": [1e9, 0.201, 0.2, 0.15, 0.05, 0.0, -0.1]},
            {},
            [0.0, 0.0, 0.0, 0.25, 0.75, 1.0, 1.0],
        ),
        (
            "proximity",
            {"clearance": [0.401, 0.4, 0.3, 0.0]},
            {"distance": 0.4},
            [0.0, 0.0, 0.25, 1.0],
        ),
        # (0.5 + 0.5)^2 + 0 = 1; 0; 2^2 + 2^2 = 8.
        (
            "jerkiness",
            {
                "action": [[0.5, 0.1], [0.3, 0.3], [1.0, 1.0]],
                "previous_action": [[-0.5, 0.1], [0.3, 0.3], [-1.0, -1.0]],
            },
            {},
            [1.0, 0.0, 8.0],
        ),
    ],
)
def test_term_by_hand(term: str, values, params, expected) -> None:
    # Float64 arithmetic on numbers of about 1.
    result = REWARDS[term](step(**values), **params)
    assert np.asarray(result, dtype=float) == pytest.approx(expected, abs=1e-12)


def test_every_term_has_a_test() -> None:
    marks = test_term_by_hand.pytestmark[0].args[1]
    assert {case[0] for case in marks} == set(REWARDS)


def test_sum_of_the_logged_terms_is_the_reward() -> None:
    table = {name: {"weight": w} for name, w in zip(sorted(REWARDS), range(1, 99), strict=False)}
    changes = {"num_worlds": 2, "time_limit_s": 3.0}
    config = task_config("corridors")  # it has a trail, which one of the terms needs
    config = type(config).model_validate(config.model_dump() | {"rewards": table} | changes)
    config = config.model_copy(update={"robot_changes": {"lidar": full_circle(36)}})
    batch = NavigationBatch(config, world_pool(config, "train", 2), 16)
    batch.reset(np.arange(16))
    rng = np.random.default_rng(0)
    running = np.zeros(16)
    ended = 0
    for _ in range(70):
        result = batch.step(rng.uniform([-0.5, -1.0], [1.5, 1.0], (16, 2)))
        assert set(result.rewards) == set(REWARDS)
        # Both are sums of the same ten numbers, if in another order.
        assert result.reward == pytest.approx(sum(result.rewards.values()), abs=1e-9)
        running += result.reward
        if result.episodes is not None:
            done = result.episodes.indices
            ended += len(done)
            assert result.episodes.returns == pytest.approx(running[done], abs=1e-8)
            assert sum(result.episodes.terms.values()) == pytest.approx(running[done], abs=1e-8)
            running[done] = 0.0
    assert ended >= 32


def test_weights_of_the_article() -> None:
    weights = {name: term.weight for name, term in task_config("article").rewards.items()}
    assert weights == {
        "goal": 100.0,
        "collision": -50.0,
        "progress": 10.0,
        "time": -0.05,
        "turning": -0.01,
        "speed": -0.005,
    }


def test_reward_of_a_step_by_hand() -> None:
    config = task_config("article")
    batch = NavigationBatch(config, world_pool(config, "train", 1), 1)
    batch.reset([0])
    simulator = batch.simulator
    # Far from everything; the goal 2 m ahead, and the robot at its full speed already.
    simulator.place(np.array([0]), [[-0.5, 0.0, 0.0]], [[1.5, 0.0]])
    simulator.state.twist[0] = [0.5, 0.0]
    result = batch.step(np.array([[1.0, 0.0]]))
    # 0.05 m of progress at 10, less 0.05 for the step and 0.005 x 0.5 for the speed.
    assert result.reward[0] == pytest.approx(0.5 - 0.05 - 0.0025, abs=1e-9)
    assert result.rewards["progress"][0] == pytest.approx(0.5, abs=1e-9)


@pytest.fixture
def own_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the term ``own`` of a test be forgotten after it."""
    for table in (REWARDS, NEEDS):
        monkeypatch.setitem(table, "own", None)


def only(term: str, **changes: Any) -> TaskConfig:
    """Return ``u_traps``, where ways are longer than they look, with a single term."""
    config = task_config("u_traps").model_dump() | {"num_worlds": 4}
    config["rewards"] = {term: {"weight": 1.0}}
    return TaskConfig.model_validate(config | changes)


def begun(config: TaskConfig) -> NavigationBatch:
    batch = NavigationBatch(config, world_pool(config, "train", 4), 8)
    batch.reset(np.arange(8))
    return batch


@pytest.mark.usefixtures("own_terms")
def test_a_term_says_what_it_needs_and_gets_it() -> None:
    @reward_term(needs=("path_distance",))
    def own(step: Step) -> Any:
        """Length of the way to the goal [m]."""
        return step.path_distance

    alone, beside = begun(only("own")), begun(only("path_progress"))
    paid = alone.step(np.zeros((8, 2))).reward
    beside.step(np.zeros((8, 2)))
    # The same robots paid by `path_progress`, for which ways were always computed.
    ways = beside.simulator.state.path_distance
    assert (paid == ways).all()
    straight = beside.simulator.state.goal_polar[:, 0]
    assert (ways >= straight).all()
    assert ways.sum() > straight.sum() + 1.0


@pytest.mark.usefixtures("own_terms")
@pytest.mark.parametrize("name", ["path_distance", "previous_path_distance", "visited"])
def test_what_is_not_computed_cannot_be_read(name: str) -> None:
    @reward_term
    def own(step: Step) -> Any:
        return getattr(step, name)

    observation = task_config("static").observation.model_dump()
    batch = begun(only("own", observation=observation))
    need = name.removeprefix("previous_")
    wanted = rf'^step.{name} is not computed .* @reward_term\(needs=\("{need}",\)\)$'
    with pytest.raises(InputError, match=wanted):
        batch.step(np.zeros((8, 2)))


@pytest.mark.usefixtures("own_terms")
def test_needs_are_checked() -> None:
    @reward_term(needs=("visited",))
    def own(step: Step) -> Any:
        return step.visited[:, 0]

    observation = task_config("static").observation.model_dump()
    with pytest.raises(ValueError, match=r"rewards\.own: needs observation\.trail"):
        only("own", observation=observation)
    with pytest.raises(ValueError, match="needs 'clearence': unknown; allowed: path_distance, vis"):
        reward_term(needs=("clearence",))(lambda step: step.clearance)
