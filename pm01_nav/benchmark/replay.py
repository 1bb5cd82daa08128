# SPDX-License-Identifier: Apache-2.0
"""Film a policy on held-out worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

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
from pm01_nav.worlds.pool import WorldPool

HOLD_FRAMES = 8
"""The last picture of an episode stays for so many frames."""
SIZE = (720, 760)
"""All episodes of a film share one picture size, whatever the shape of their world [px]."""

RENDERED_SIZE = (960, 720)
CAMERA = 18.0
"""The camera stands so many radii of the footprint behind the robot, and as many above."""

Trail = list[NDArray[np.float64]]
Draw = Callable[[Trail, Outcome | None], NDArray[np.uint8]]
"""Returns a picture, given the places so far and how the episode ended."""


def film(
    policy: Policy,
    config: TaskConfig,
    episodes: int,
    seed: int,
    label: str,
    *,
    look_ahead: float | None = None,
    rendered: bool = False,
) -> Iterator[NDArray[np.uint8]]:
    """Yield pictures (height, width, 3) of the first episodes that ``Evaluator`` would run.

    With ``look_ahead`` [m] the policy follows a global plan, see ``Evaluator``. They are drawn from
    above, or ``rendered`` by the task's physics engine.

    Raises:
        InputError: the worlds cannot be had, or no engine is there to render them.
    """
    pool, batch = _stage(config, episodes, seed)
    for number in range(episodes):
        batch.reset([(seed << 32) + number], np.array([number % len(pool)]))
        caption = f"{label}   {config.name}, seed {seed}, episode {number + 1} of {episodes}"
        draw = _camera(batch) if rendered else _plan(batch, caption)
        picture = None
        for trail, outcome in _drive(policy, batch, GoalSource(batch, pool, look_ahead)):
            picture = draw(trail, outcome)
            yield picture
        assert picture is not None
        yield from [picture] * (HOLD_FRAMES - 1)


def photograph(
    policy: Policy,
    config: TaskConfig,
    seed: int,
    label: str,
    *,
    look_ahead: float | None = None,
    rendered: bool = False,
) -> NDArray[np.uint8]:
    """Return a picture of the first episode when half of the distance to the goal is left.

    Parameters and errors are those of ``film``.
    """
    pool, batch = _stage(config, 1, seed)
    batch.reset([seed << 32], np.array([0]))
    draw = _camera(batch) if rendered else _plan(batch, f"{label}   {config.name}, seed {seed}")
    distance = batch.simulator.state.goal_polar[:, 0]
    half = 0.5 * float(distance[0])
    for trail, outcome in _drive(policy, batch, GoalSource(batch, pool, look_ahead)):
        if distance[0] <= half or outcome is not None:
            return draw(trail, outcome)
    raise AssertionError("an episode ends with an outcome")


def _stage(config: TaskConfig, episodes: int, seed: int) -> tuple[WorldPool, NavigationBatch]:
    """Return the worlds of the first episodes, and a robot for them."""
    pool = world_pool(config, "held_out", episodes, seed)
    return pool, NavigationBatch(config, pool, 1, autoreset=False)


def _drive(
    policy: Policy, batch: NavigationBatch, source: GoalSource
) -> Iterator[tuple[Trail, Outcome | None]]:
    """Drive an episode; yield the places so far, and how it ended, before each step and after."""
    policy.reset()
    state = batch.simulator.state
    trail = [state.pose[0, :2].copy()]
    outcome: Outcome | None = None
    while outcome is None:
        yield trail, None
        command = policy.act(batch.simulator.scan, source.goals(), batch.simulator.measured_twist)
        step = batch.advance(np.asarray(command, dtype=np.float64))
        trail.append(state.pose[0, :2].copy())
        outcome = _outcome(step, batch.config)
    yield trail, outcome


def _camera(batch: NavigationBatch) -> Draw:
    """Return what draws robot 0 from behind and above, as seen on the way from start to goal."""
    simulator = batch.simulator
    way = simulator.state.goal[0] - simulator.state.pose[0, :2]
    distance = CAMERA * batch.robot.footprint.circumscribed_radius
    back = distance * way / max(float(np.linalg.norm(way)), 1e-9)
    offset = np.array([-back[0], -back[1], distance])
    return lambda trail, outcome: simulator.picture(0, offset, RENDERED_SIZE)


def _plan(batch: NavigationBatch, caption: str) -> Draw:
    """Return what draws robot 0 and all around it from above."""
    world = batch.simulator.pool.worlds[int(batch.simulator.state.world[0])]
    canvas = Canvas(world, batch.robot, SIZE)

    def draw(trail: Trail, outcome: Outcome | None) -> NDArray[np.uint8]:
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

    return draw


def _outcome(step: Step, config: TaskConfig) -> Outcome | None:
    if step.reached[0]:
        return "success"
    if step.collided[0]:
        return "collision"
    return "timeout" if out_of_time(step, config)[0] or step.faults else None
