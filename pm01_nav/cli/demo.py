# SPDX-License-Identifier: Apache-2.0
"""``pm01 demo``."""

from __future__ import annotations

import json
from typing import Any

import click


@click.command("demo", short_help="Train, measure and film a policy, in about a minute and a half.")
@click.option("--out", default="runs/demo", show_default=True, metavar="DIR")
@click.option("--time-budget", type=float, default=60.0, show_default=True, metavar="SECONDS")
@click.option("--episodes", type=click.IntRange(1), default=1000, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True)
def command(out: str, time_budget: float, episodes: int, seed: int) -> None:
    """Train on task static, evaluate on worlds never seen, export, plot and film.

    A former demo in the same folder is replaced.
    """
    from rich.console import Console

    from pm01_nav.cli.display import results_table
    from pm01_nav.cli.train import run_training
    from pm01_nav.task.tasks import task_config
    from pm01_nav.training.config import run_config
    from pm01_nav.training.run_folder import RunFolder

    task = task_config("static")
    config = run_config(task, {"seed": seed, "time_budget": time_budget}, "demo")
    folder = RunFolder(out)
    result = run_training(config, folder, force=True)
    if result.interrupted:
        return
    columns = _measure(folder, task, episodes)
    _picture(folder, task)
    title = f"{task.name}: {episodes} episodes on held-out worlds"
    Console().print(results_table(columns, title))
    for path in (folder.policy, folder.config, folder.metrics, folder.plot):
        click.echo(f"wrote {path}")
    click.echo(f"wrote {folder.path / 'replay.mp4'}")


def _measure(folder: Any, task: Any, episodes: int) -> dict[str, dict[str, Any]]:
    from pm01_nav.benchmark.evaluate import Evaluator
    from pm01_nav.benchmark.policies import load_policy
    from pm01_nav.config import write_atomically
    from pm01_nav.provenance import provenance

    evaluator = Evaluator(task, episodes, seed=1)
    names = {"trained policy": str(folder.policy), "goal seeking": "goal_seeking"}
    columns = {
        label: evaluator.summary(load_policy(name, task.robot_spec(), task.control_dt))
        for label, name in names.items()
    }
    metrics = columns["trained policy"] | {"baselines": {"goal_seeking": columns["goal seeking"]}}
    write_atomically(folder.metrics, json.dumps(metrics | provenance(), indent=2) + "\n")
    return columns


def _picture(folder: Any, task: Any) -> None:
    from pm01_nav.benchmark.policies import load_policy
    from pm01_nav.benchmark.replay import film
    from pm01_nav.rendering.training_plot import plot_training
    from pm01_nav.rendering.video import write_video

    history = json.loads(folder.history.read_text(encoding="utf-8"))
    plot_training(history, folder.plot, "PPO on task static")
    policy = load_policy(str(folder.policy), task.robot_spec(), task.control_dt)
    frames = film(policy, task, episodes=5, seed=1, label="policy.onnx")
    write_video(frames, folder.path / "replay.mp4", fps=20.0)
