# SPDX-License-Identifier: Apache-2.0
"""``pm01 replay``."""

from __future__ import annotations

from typing import Any

import click

from pm01_nav.cli.options import (
    plan_options,
    task_from_options,
    task_options,
)


@click.command("replay", short_help="Film a policy.")
@click.argument("policy")
@task_options
@plan_options
@click.option("--episodes", type=click.IntRange(1), default=3, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=1, show_default=True)
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="FILE",
    help="An .mp4 or .gif to write, or a .png of the first episode, half-way.",
)
@click.option(
    "--render",
    is_flag=True,
    help="Let the physics engine draw it in 3D, without a screen; needs --backend.",
)
@click.option("--speed", type=click.FloatRange(0.1), default=2.0, show_default=True)
def command(
    policy: str,
    episodes: int,
    seed: int,
    output: str,
    render: bool,
    speed: float,
    global_plan: bool,
    look_ahead: float | None,
    **options: Any,
) -> None:
    """Film POLICY driving: a policy.onnx, a run's folder, zoo:NAME, or a planner's name.

    The episodes are the first ones of `pm01 evaluate` with the same task and seed.

    \b
      pm01 replay runs/x --task crowd -o crowd.mp4
      pm01 replay runs/x --backend mujoco --render -o robot.mp4
    """
    from pathlib import Path

    from PIL import Image

    from pm01_nav.benchmark.policies import load_policy, trained_task
    from pm01_nav.benchmark.replay import film, photograph
    from pm01_nav.config import check_output
    from pm01_nav.planners.plan_follower import look_ahead_of
    from pm01_nav.rendering.sheet import save_sheet
    from pm01_nav.rendering.video import write_video

    distance = look_ahead_of(global_plan, look_ahead)
    task = task_from_options(trained_task(policy), **options)
    driver = load_policy(policy, task.robot_spec(), task.control_dt)
    label, how = Path(policy).name, {"look_ahead": distance, "rendered": render}
    if Path(output).suffix.lower() == ".png":
        check_output(output)
        picture = photograph(driver, task, seed, label, **how)
        save_sheet(Image.fromarray(picture), output)
    else:
        frames = film(driver, task, episodes, seed, label, **how)
        write_video(frames, output, fps=speed / task.control_dt)
    click.echo(f"wrote {output}")
