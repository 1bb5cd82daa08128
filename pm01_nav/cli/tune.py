# SPDX-License-Identifier: Apache-2.0
"""``pm01 tune``."""

from __future__ import annotations

import sys
from typing import Any

import click

from pm01_nav.cli.options import randomization_option, task_options
from pm01_nav.cli.sweep import EVAL_EVERY
from pm01_nav.cli.train import fresh_config, training_options
from pm01_nav.executors import Executor, run_pm01

EVALUATIONS = 10
"""Evaluations of a trial whose steps are given; with few, a bad trial goes on for long."""


@click.command("tune", short_help="Search for hyper-parameters.")
@task_options
@randomization_option
@training_options
@click.option("--trials", type=click.IntRange(1), default=20, show_default=True, metavar="N")
@click.option("--out", required=True, metavar="DIR", help="Folder of the study; gone on with.")
@click.option("--space", metavar="FILE", help="YAML of what is searched. [default: by algorithm]")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Trials at a time on this machine.",
)
@click.option(
    "--storage",
    metavar="URL",
    help="An SQL database to keep the study in, for several machines. [default: a file in --out]",
)
@click.option("--ray", "ray_address", metavar="ADDRESS", help="Use a Ray cluster; needs --storage.")
@click.option("--worker", type=click.IntRange(0), default=0, hidden=True)
def command(
    trials: int,
    out: str,
    space: str | None,
    jobs: int,
    storage: str | None,
    ray_address: str | None,
    worker: int,
    **options: Any,
) -> None:
    """Train with many settings and keep what succeeds most on held-out worlds.

    Optuna proposes settings (TPE) and ends trials that do worse than the median of the finished
    ones at the same evaluation. PPO is evaluated every tenth of --steps, without --steps every
    250000 steps, off-policy algorithms every 100000; --set train.eval_every=N changes it. The study
    is kept: the same command goes on with it until it has N trials. Success of trials is measured
    on the worlds of the evaluation along the way; measure the winner with `pm01 sweep` before you
    believe it.

    \b
    Examples:
      pm01 tune --task static --steps 500000 --trials 30 --out tuning/static
      pm01 train --task static --config tuning/static/best.yaml --out runs/tuned
    """
    from pathlib import Path

    from rich.console import Console

    from pm01_nav.cli.display import tuning_table
    from pm01_nav.errors import InputError
    from pm01_nav.executors import make_executor
    from pm01_nav.training.tuning import Tuning, default_space, load_space

    if ray_address and not storage:
        raise InputError("ray: several machines need --storage, a database that all of them reach")
    config = fresh_config(options, {"eval_every": _eval_every(options["steps"])})
    algo = config.train.algo
    chosen = load_space(space, algo) if space else default_space(algo)
    tuning = Tuning(Path(out), config, chosen, storage, worker)
    tuning.study()
    try:
        if jobs == 1 and not ray_address:
            tuning.work(trials)
        else:
            _employ(make_executor(jobs, ray_address), jobs)
    except KeyboardInterrupt:
        click.echo("interrupted; the same command goes on with the study", err=True)
        raise
    Console().print(tuning_table(tuning.write_report()))
    click.echo(f"wrote {tuning.folder / 'tuning.json'} and best.yaml")


def _eval_every(steps: int | None) -> int:
    """Return the steps between two evaluations, at which a trial may be cut short."""
    return max(steps // EVALUATIONS, 1) if steps else EVAL_EVERY


def _employ(executor: Executor, workers: int) -> None:
    """Let so many processes work on the study until it has its trials."""
    given = _worker_arguments()
    numbered = [[*given, "--worker", str(number)] for number in range(workers)]
    for done in executor.run(run_pm01, numbered):
        if done.error:
            click.echo(f"worker {done.index}: {done.error}", err=True)


def _worker_arguments() -> list[str]:
    """Return this command's arguments for one of its workers: one trial at a time, without Ray."""
    kept, given = [], iter(sys.argv[1:])
    for argument in given:
        if argument in ("--jobs", "--ray"):
            next(given, None)
        elif not argument.startswith(("--jobs=", "--ray=")):
            kept.append(argument)
    return kept
