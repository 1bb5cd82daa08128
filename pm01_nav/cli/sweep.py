# SPDX-License-Identifier: Apache-2.0
"""``pm01 sweep``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from pm01_nav.cli.options import randomization_option, ray_option, task_options
from pm01_nav.cli.train import fresh_config, training_options

if TYPE_CHECKING:
    from pm01_nav.training.config import RunConfig

EVAL_EVERY = 250_000
"""Steps between two points of a learning curve, which `pm01 train` alone needs less densely."""


@click.command("sweep", short_help="Train with many seeds and report what they show together.")
@task_options
@randomization_option
@training_options
@click.option("--seeds", type=click.IntRange(1, 1000), default=5, show_default=True, metavar="N")
@click.option("--first-seed", type=click.IntRange(0), default=0, show_default=True, metavar="N")
@click.option("--out", required=True, metavar="DIR", help="Folder of the sweep; gone on with.")
@click.option(
    "--suite",
    "suites",
    multiple=True,
    metavar="NAME",
    help="Measure on this task instead of the one trained on (repeatable); worlds from files as "
    "NAME=PATH.",
)
@click.option("--episodes", type=click.IntRange(1), default=1000, show_default=True)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Seeds at a time on this machine. With --time-budget more than 1 makes each slower.",
)
@ray_option
def command(
    seeds: int,
    first_seed: int,
    out: str,
    suites: tuple[str, ...],
    episodes: int,
    jobs: int,
    ray_address: str | None,
    **options: Any,
) -> None:
    """Train with the seeds 0 to N - 1, measure each policy, write sweep.json and sweep.png.

    Success is reported for every seed and as the interquartile mean over all with its 95 %
    bootstrap interval (Agarwal et al. 2021). Seeds that are done are not run again.

    \b
    Examples:
      pm01 sweep --task static --time-budget 60 --seeds 5 --out sweeps/static
      pm01 sweep --task static --algo sac --steps 500000 --seeds 10 --jobs 2 --out sweeps/sac
    """
    from pathlib import Path

    from rich.console import Console

    from pm01_nav.cli.display import sweep_table
    from pm01_nav.config import to_yaml, write_atomically
    from pm01_nav.errors import InputError
    from pm01_nav.executors import make_executor
    from pm01_nav.rendering.sweep_plot import plot_sweep
    from pm01_nav.training.sweep import SeedJob, Sweep, suite_task

    config = fresh_config(options, {"eval_every": EVAL_EVERY})
    suites = tuple(dict.fromkeys(suites))
    for suite in suites:
        suite_task(suite, config)
    threads = _threads(config, shared=jobs > 1 or ray_address is not None)
    job = SeedJob(to_yaml(config.model_dump(mode="json")), 0, suites, episodes, 1, threads)
    sweep = Sweep(Path(out), config, range(first_seed, first_seed + seeds))
    executor = make_executor(jobs, ray_address)
    try:
        failed = sweep.run(executor, job, _told)
    except KeyboardInterrupt:
        click.echo("interrupted; the same command goes on with what is missing", err=True)
        raise
    report = sweep.report()
    write_atomically(sweep.folder / "sweep.json", json.dumps(report, indent=2) + "\n")
    plot_sweep(report, sweep.folder / "sweep.png")
    Console().print(sweep_table(report))
    click.echo(f"wrote {sweep.folder / 'sweep.json'} and sweep.png")
    if failed:
        raise InputError(f"seeds {sorted(failed)} failed; the same command tries them again")


def _threads(config: RunConfig, *, shared: bool) -> int:
    """Return the threads of each seed; 0 leaves them to the configuration.

    How many are fastest is measured, and differs from run to run: only with a fixed number is a
    sweep over steps the same bit for bit.
    """
    given = config.train.threads
    if shared:
        return given or 1
    return 0 if given or config.train.time_budget is not None else 1


def _told(seed: int, error: str | None) -> None:
    click.echo(f"seed {seed}: {error or 'done'}", err=True)
