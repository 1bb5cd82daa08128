# SPDX-License-Identifier: Apache-2.0
"""Curricula: when stages change, which worlds are drawn, and going on from where one was."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot import full_circle
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.curriculum import (
    Automatic,
    AutomaticConfig,
    Stage,
    Staged,
    StagedConfig,
    Uniform,
    apply,
    effective_number,
    make_curriculum,
)
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.outcomes import Episodes
from pm01_nav.task.tasks import navigation
from pm01_nav.worlds.pool import WorldPool, build_pool
from pm01_nav.worlds.world import World

NAMES = ("empty", "rooms", "rooms", "maze")
BOUNDS = (0.0, 0.0, 8.0, 8.0)
TWO_STAGES = StagedConfig(
    stages=(Stage(worlds={"empty": 1.0}, goal_distance=(1.0, 2.0)), Stage()),
    threshold=0.75,
    window=4,
)


def episodes(success, world=None, steps=1) -> Episodes:
    """Return episodes that ended with or without success."""
    n = len(success)
    return Episodes(
        indices=np.arange(n),
        world=np.array(world if world is not None else [0] * n),
        success=np.array(success, dtype=np.bool_),
        collision=~np.array(success, dtype=np.bool_),
        steps=np.broadcast_to(steps, n),
        returns=np.zeros(n),
        terms={},
        final_observation=np.zeros((n, 1), dtype=np.float32),
    )


def pool_of(names=NAMES) -> WorldPool:
    return build_pool([World(name, BOUNDS) for name in names], 0.27)


def batch_of(num_envs: int, names=NAMES) -> NavigationBatch:
    lidar = {"lidar": full_circle(36)}
    config: TaskConfig = navigation("static", robot_changes=lidar, time_limit_s=0.5)
    return NavigationBatch(config, pool_of(names), num_envs)


def test_stage_is_passed_at_its_threshold_over_a_full_window() -> None:
    staged = Staged(TWO_STAGES, NAMES)
    for success, stage in (
        ([1, 1, 1], 0),  # all of them, but the window of four is not full
        ([0, 0], 0),  # the last four: 1 1 0 0, a half
        ([1, 1], 0),  # 0 0 1 1, a half
        ([1], 1),  # 0 1 1 1, three quarters: reached
    ):
        staged.update(episodes(success))
        staged.advance()
        assert staged.stage == stage


def test_stages_never_go_back_nor_beyond_the_last() -> None:
    staged = Staged(TWO_STAGES, NAMES)
    for success in ([1] * 4, [0] * 9, [1] * 9):
        staged.update(None)
        staged.update(episodes(success))
        staged.advance()
        assert staged.stage == 1


def test_episodes_drawn_by_the_stage_before_do_not_count() -> None:
    staged = Staged(
        StagedConfig(stages=(Stage(), Stage(), Stage()), threshold=1.0, window=2), NAMES
    )
    # The first episodes of a run are drawn by its first stage: they end after k steps in step k.
    staged.update(None)
    staged.update(episodes([1, 1], steps=2))
    staged.advance()
    assert staged.stage == 1
    # These two ended in the step before, or began in it: both were drawn by the first stage.
    staged.update(episodes([1, 1], steps=[40, 1]))
    staged.advance()
    assert staged.stage == 1
    assert math.isnan(staged.metrics()["stage_success_rate"])
    # One step later an episode of one step was drawn by the second stage, one of two was not.
    staged.update(episodes([1, 0], steps=[1, 2]))
    assert staged.metrics()["stage_success_rate"] == 1.0


def test_age_agrees_with_the_batch() -> None:
    # Episodes of exactly five steps: time runs out while nobody moves.
    batch, staged = batch_of(3), Staged(TWO_STAGES, NAMES)
    apply(staged, batch)
    batch.reset(np.arange(3))
    counted = []
    for step in range(1, 21):
        ended = batch.step(np.zeros((3, 2))).episodes
        staged.update(ended)
        counted.append(len(staged._recent))
        if step == 7:
            staged.stage, staged._age = 1, 0
            staged._recent.clear()
    # The first five steps end three episodes, those of step 10 began before the stage did at 7.
    assert [counted[k - 1] for k in (4, 5, 10, 14, 15, 20)] == [0, 3, 0, 0, 3, 4]


def test_stage_weights_by_hand() -> None:
    config = StagedConfig(stages=(Stage(worlds={"rooms": 3.0, "empty": 1.0}), Stage()))
    staged = Staged(config, NAMES)
    # A quarter of the episodes in the empty world, three quarters shared by two with rooms.
    assert staged.weights().tolist() == [0.25, 0.375, 0.375, 0.0]
    # 1 / (1/16 + 2 * 9/64) = 64/22.
    assert staged.metrics()["effective_worlds"] == pytest.approx(64 / 22)
    staged.stage = 1
    assert staged.weights().tolist() == [1.0] * 4
    assert staged.metrics()["effective_worlds"] == 4.0


def test_stage_limits_by_hand() -> None:
    stages = (Stage(goal_distance=(1.0, 2.5)), Stage(goal_distance=(2.0, None)), Stage())
    staged = Staged(StagedConfig(stages=stages), NAMES)
    limits = []
    for staged.stage in range(3):
        limits.append(staged.goal_distance())
    assert limits == [(1.0, 2.5), (2.0, math.inf), None]


def automatic(success, **settings) -> Automatic:
    curriculum = Automatic(AutomaticConfig(**settings), len(success))
    curriculum.success[:] = success
    return curriculum


def test_learnability_by_hand() -> None:
    curriculum = automatic([0.0, 0.5, 1.0, 0.9], top=1, share=0.6)
    assert curriculum.learnability() == pytest.approx([0.0, 0.25, 0.0, 0.09])
    # 0.4 are shared by all four, 0.6 go to the most learnable one.
    assert curriculum.weights() == pytest.approx([0.1, 0.7, 0.1, 0.1])
    metrics = curriculum.metrics()
    assert metrics["learnability"] == pytest.approx(0.34 / 4)
    assert metrics["learnability_drawn"] == pytest.approx(0.7 * 0.25 + 0.1 * 0.09)
    # 1 / (0.49 + 0.03).
    assert metrics["effective_worlds"] == pytest.approx(1 / 0.52)


def test_as_learnable_worlds_are_treated_alike() -> None:
    # The second place is shared by two; p and 1 - p are as learnable.
    weights = automatic([0.5, 0.25, 0.75, 0.0, 1.0], top=2, share=0.9).weights()
    assert weights == pytest.approx([0.32, 0.32, 0.32, 0.02, 0.02])
    for success in (0.5, 0.0, 1.0):
        assert automatic([success] * 5, top=2).weights() == pytest.approx([0.2] * 5)
    assert automatic([0.1, 0.2], top=100).weights() == pytest.approx([0.5, 0.5])


def test_success_rates_are_exponential_averages() -> None:
    curriculum = automatic([0.5, 0.5, 0.5], rate=0.1)
    curriculum.update(None)
    curriculum.update(episodes([1, 0, 1], world=[2, 0, 2]))
    # 0.5 + 0.1 * 0.5 = 0.55, then + 0.1 * 0.45; 0.5 - 0.1 * 0.5.
    assert curriculum.success == pytest.approx([0.45, 0.5, 0.595])


def test_draws_follow_the_weights() -> None:
    n = 20_000
    batch = batch_of(n)
    curriculum = automatic([0.0, 0.5, 1.0, 0.9], top=2, share=0.6)
    apply(curriculum, batch)
    batch.reset(np.arange(n))
    counts = np.bincount(batch.simulator.state.world, minlength=4)
    expected = np.array([0.1, 0.4, 0.1, 0.4])
    # Binomial: four standard deviations.
    assert (np.abs(counts - n * expected) < 4 * np.sqrt(n * expected * (1 - expected))).all()


@pytest.mark.parametrize("kind", ["empty", "rooms", "maze"])
def test_worlds_without_weight_are_never_drawn(kind: str) -> None:
    batch = batch_of(3000)
    stage = Stage(worlds={kind: 0.1}, goal_distance=(1.0, 1.5))
    apply(Staged(StagedConfig(stages=(stage,)), NAMES), batch)
    batch.reset(np.arange(3000))
    names = {NAMES[w] for w in batch.simulator.state.world}
    assert names == {kind}
    # The goal distance is the stage's; of the cell around a goal 0.07 m may be beyond it.
    distance = batch.simulator.state.goal_polar[:, 0]
    assert ((distance > 0.92) & (distance < 1.58)).all()


def test_no_curriculum_changes_nothing() -> None:
    with_one, without = batch_of(64), batch_of(64)
    curriculum = make_curriculum("none", StagedConfig(), AutomaticConfig(), NAMES)
    assert isinstance(curriculum, Uniform)
    apply(curriculum, with_one)
    assert (with_one.reset(np.arange(64)) == without.reset(np.arange(64))).all()
    arrays = [b.simulator.pool.arrays.cumulative_weight for b in (with_one, without)]
    assert (arrays[0] == arrays[1]).all()
    assert curriculum.metrics() == {}


@pytest.mark.parametrize("name", ["none", "staged", "automatic"])
def test_state_goes_on_as_if_never_stopped(name) -> None:
    rng = np.random.default_rng(0)
    stages = StagedConfig(
        stages=(Stage(worlds={"empty": 1}), Stage(worlds={"maze": 1}), Stage()),
        threshold=0.6,
        window=8,
    )

    def make():
        return make_curriculum(name, stages, AutomaticConfig(top=2), NAMES)

    whole, parts = make(), make()
    for _ in range(60):
        news = episodes(rng.random(3) < 0.6, rng.integers(0, 4, 3), rng.integers(1, 9, 3))
        for curriculum in (whole, parts):
            curriculum.update(news)
            curriculum.advance()
        # Through JSON: plain numbers and lists of numbers only.
        state = json.loads(json.dumps(parts.state_dict()))
        parts = make()
        parts.load_state_dict(state)
        assert (parts.weights() == whole.weights()).all()
        assert parts.goal_distance() == whole.goal_distance()
        assert str(parts.metrics()) == str(whole.metrics())


def test_state_of_another_curriculum_is_refused() -> None:
    staged, four = Staged(TWO_STAGES, NAMES), automatic([0.5] * 4)
    for curriculum, state in (
        (staged, {}),
        (staged, four.state_dict()),
        (staged, staged.state_dict() | {"stage": 2}),
        (four, automatic([0.5] * 5).state_dict()),
        (Uniform(4), four.state_dict()),
    ):
        with pytest.raises(ValueError, match="curriculum"):
            curriculum.load_state_dict(state)


def test_unknown_kind_of_world_is_refused() -> None:
    config = StagedConfig(stages=(Stage(), Stage(worlds={"moon": 1.0})))
    message = r"train\.staged\.stages\.1\.worlds\.moon: .*allowed: empty, maze, rooms$"
    with pytest.raises(InputError, match=message):
        make_curriculum("staged", config, AutomaticConfig(), NAMES)


@pytest.mark.parametrize(
    "weights", [[1.0, 1.0], [0.0] * 4, [1.0, -0.1, 1.0, 1.0], [np.nan, 1.0, 1.0, 1.0]]
)
def test_impossible_weights_are_refused(weights) -> None:
    with pytest.raises(ValueError, match=r"weight"):
        pool_of().set_weights(np.array(weights))


def test_effective_number_of_worlds() -> None:
    assert effective_number(np.array([0.0, 2.0, 0.0])) == 1.0
    assert effective_number(np.ones(7)) == pytest.approx(7.0)
