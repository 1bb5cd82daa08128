# SPDX-License-Identifier: Apache-2.0
"""``pm01 evaluate``."""

from __future__ import annotations

from typing import Any

import click

from pm01_nav.cli.options import (
    episode_options,
    plan_options,
    randomization_option,
    task_from_options,
    task_options,
)
from pm01_nav.cli.tables import TableCommand


@click.command(
    "evaluate", cls=TableCommand, short_help="Measure a policy on worlds it has never seen."
)
@click.argument("policy")
@task_options
@plan_options
@randomization_option
@episode_options
@click.option("--json", "json_file", metavar="FILE", help="Write the figures; - for stdout.")
def command(
    policy: str,
    episodes: int,
    seed: int,
    json_file: str | None,
    global_plan: bool,
    look_ahead: float | None,
    **options: Any,
) -> None:
    """Measure POLICY: a policy.onnx, a run's folder, zoo:NAME, or a planner's name.

    Planners: {planners}.

    Rates come with Wilson 95 % intervals. Without --task a policy is measured on the task it was
    trained on. BARN (Perille et al. 2020): unpack the dataset, then

    \b
      pm01 evaluate policy.onnx --task barn --worlds barn_data --episodes 250

    Robots are as described, however the policy was trained; --randomization perturbs them. A range
    with low = high in its file is a fixed perturbation.

    A policy alone gets stuck in dead ends. Where the map is known, a global plan leads it:

    \b
      pm01 evaluate policy.onnx --task map --map office.yaml --global-plan
    """
    from pm01_nav.benchmark.evaluate import Evaluator
    from pm01_nav.benchmark.policies import load_policy, trained_task
    from pm01_nav.config import check_output
    from pm01_nav.planners.plan_follower import look_ahead_of
    from pm01_nav.provenance import shown_path

    if json_file not in (None, "-"):
        check_output(json_file, "json")
    distance = look_ahead_of(global_plan, look_ahead)
    task = task_from_options(trained_task(policy), **options)
    driver = load_policy(policy, task.robot_spec(), task.control_dt)
    evaluator = Evaluator(task, episodes, seed, look_ahead=distance)
    summary = {"policy": shown_path(policy)} | evaluator.summary(driver)
    _report(summary, f"{task.name}: {episodes} episodes, seed {seed}", json_file)


def _report(summary: dict[str, Any], title: str, json_file: str | None) -> None:
    """Print the figures as a table, and write them as JSON if asked to; - prints JSON alone."""
    import json

    from rich.console import Console

    from pm01_nav.cli.display import results_table
    from pm01_nav.config import write_atomically
    from pm01_nav.provenance import provenance

    text = json.dumps(summary | provenance(), indent=2)
    if json_file == "-":
        click.echo(text)
        return
    Console().print(results_table({summary["policy"]: summary}, title))
    for reason, count in summary.get("failures", {}).items():
        click.echo(f"failed {count} times: {reason}")
    if "barn_evaluated_in" in summary:
        click.echo(f"BARN scores: {summary['barn_evaluated_in']}")
    # Last, so that a full disk does not cost the table.
    if json_file:
        write_atomically(json_file, text + "\n")
