# SPDX-License-Identifier: Apache-2.0
"""Film a policy on held-out worlds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.evaluate import GoalSource
from pm01_nav.policy.protocol import Policy
from pm01_nav.rendering.canvas import Canvas
from pm01_nav.rendering.scene import Outcome, Scene
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.step import Step
from pm01_nav.task.terminations import out_of_time
from pm01_nav.task.worlds import world_pool

HOLD_FRAMES = 8
"""The last picture of an episode stays for so many frames."""
SIZE = (720, 760)
"""All episodes of a film share one picture size, whatever the shape of their world [px]."""


def film(
    policy: Policy,
    config: TaskConfig,
    episodes: int,
    seed: int,
    label: str,
    *,
    look_ahead: float | None = None,
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures (height, width, 3) of the first episodes that ``Evaluator`` would run.

    With ``look_ahead`` [m] the policy follows a global plan, see ``Evaluator``.

    Raises:
        InputError: the worlds cannot be had.
    """
    pool = world_pool(config, "held_out", episodes, seed)
    batch = NavigationBatch(config, pool, 1, autoreset=False)
    for number in range(episodes):
        batch.reset([(seed << 32) + number], np.array([number % len(pool)]))
        policy.reset()
        world = pool.worlds[int(batch.simulator.state.world[0])]
        canvas = Canvas(world, batch.robot, SIZE)
        caption = f"{label}   {config.name}, seed {seed}, episode {number + 1} of {episodes}"
        source = GoalSource(batch, pool, look_ahead)
        yield from _film_episode(policy, batch, source, canvas, caption)


def _film_episode(
    policy: Policy,
    batch: NavigationBatch,
    source: GoalSource,
    canvas: Canvas,
    caption: str,
) -> Iterator[NDArray[np.uint8]]:
    state = batch.simulator.state
    trail = [state.pose[0, :2].copy()]
    outcome: Outcome | None = None
    while outcome is None:
        yield _picture(batch, canvas, trail, caption, None)
        command = policy.act(batch.simulator.scan, source.goals(), batch.simulator.measured_twist)
        step = batch.advance(np.asarray(command, dtype=np.float64))
        trail.append(state.pose[0, :2].copy())
        outcome = _outcome(step, batch.config)
    for _ in range(HOLD_FRAMES):
        yield _picture(batch, canvas, trail, caption, outcome)


def _picture(
    batch: NavigationBatch,
    canvas: Canvas,
    trail: list[NDArray[np.float64]],
    caption: str,
    outcome: Outcome | None,
) -> NDArray[np.uint8]:
    state = batch.simulator.state
    scene = Scene(
        pose=state.pose[0],
        goal=state.goal[0],
        goal_radius=batch.config.goal_radius,
        scan=batch.simulator.scan[0],
        trail=np.array(trail),
        movers=batch.simulator.movers(0),
        caption=f"{caption}   {(len(trail) - 1) * batch.config.control_dt:.1f} s",
        outcome=outcome,
    )
    return canvas.draw(scene)


def _outcome(step: Step, config: TaskConfig) -> Outcome | None:
    if step.reached[0]:
        return "success"
    if step.collided[0]:
        return "collision"
    return "timeout" if out_of_time(step, config)[0] else None
