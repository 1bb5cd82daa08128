# SPDX-License-Identifier: Apache-2.0
"""``pm01 benchmark``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from pm01_nav.cli.options import episode_options, ray_option
from pm01_nav.cli.tables import TableOption

if TYPE_CHECKING:
    from pm01_nav.benchmark.entry import Entry
    from pm01_nav.benchmark.runner import Plan
    from pm01_nav.benchmark.store import ResultsFolder
    from pm01_nav.benchmark.suite import Suite
    from pm01_nav.executors import Executor


@click.command("benchmark", short_help="Measure policies and planners on many suites.")
@click.option(
    "--suite",
    "suites",
    multiple=True,
    metavar="NAME",
    cls=TableOption,
    help="A task's held-out worlds (repeatable): {tasks}. Worlds from files as NAME=PATH.",
)
@click.option(
    "--sweep",
    "sweeps",
    multiple=True,
    metavar="NAME",
    cls=TableOption,
    help="One thing varied (repeatable): {sweeps}.",
)
@click.option(
    "--policy",
    "policies",
    multiple=True,
    metavar="[NAME=]FILE",
    help="A policy.onnx or a run's folder (repeatable).",
)
@click.option(
    "--planner",
    "planners",
    multiple=True,
    metavar="NAME",
    cls=TableOption,
    help="A planner (repeatable): {planners}.",
)
@episode_options
@click.option("--robot", metavar="NAME|FILE", help="Drive this robot on all suites.")
@click.option(
    "--randomization",
    metavar="on|FILE",
    help="Perturb the robots; the suites' names get the file's name added.",
)
@click.option(
    "--backend",
    metavar="NAME",
    cls=TableOption,
    help="What moves the robots: {backends}; the suites' names get it added.",
)
@click.option("--out", required=True, metavar="DIR", help="Where results are, or are added.")
@click.option("--jobs", type=click.IntRange(1), help="Processes.  [default: one a core]")
@ray_option
@click.option(
    "--replays",
    type=click.IntRange(0),
    default=6,
    show_default=True,
    help="Episodes kept for the report of each entry on each suite, the worst ones first.",
)
def command(
    policies: tuple[str, ...],
    planners: tuple[str, ...],
    episodes: int,
    out: str,
    jobs: int | None,
    ray_address: str | None,
    replays: int,
    **where: Any,
) -> None:
    """Measure policies and planners on the same episodes, in parallel processes.

    \b
      pm01 benchmark --suite static --suite mixed --policy runs/mixed --planner dwa \\
          --planner mppi --episodes 1000 --out results/x
      pm01 report results/x

    After a kill the same command goes on where it stopped. Another command with the same --out
    adds to the results; results of other worlds, rules or robots under the same name are refused.
    """
    from pathlib import Path

    from pm01_nav.benchmark.runner import plan_benchmark
    from pm01_nav.benchmark.store import ResultsFolder
    from pm01_nav.config import make_folder

    suites = _suites(**where)
    folder = ResultsFolder(Path(out))
    plan = plan_benchmark(folder, suites, _entries(policies, planners), episodes, replays)
    make_folder(folder.path)
    _run(folder, plan, jobs, ray_address)
    _report(folder, suites)


def _suites(
    suites: tuple[str, ...],
    sweeps: tuple[str, ...],
    seed: int,
    robot: str | None,
    randomization: str | None,
    backend: str | None,
) -> list[Suite]:
    from pm01_nav.benchmark.suite import read_suite, sweep_suites
    from pm01_nav.errors import InputError

    how = (robot, randomization, backend)
    found = [read_suite(text, seed, *how) for text in dict.fromkeys(suites)]
    for name in dict.fromkeys(sweeps):
        found += sweep_suites(name, seed, *how)
    if not found:
        raise InputError("suite: give --suite or --sweep, or several of them")
    return found


def _entries(policies: tuple[str, ...], planners: tuple[str, ...]) -> list[Entry]:
    from pm01_nav.benchmark.entry import planner_entry, policy_entry
    from pm01_nav.errors import InputError

    found = [planner_entry(name) for name in dict.fromkeys(planners)]
    found += [policy_entry(text) for text in dict.fromkeys(policies)]
    if not found:
        raise InputError("policy: give --policy or --planner, or several of them")
    if len({entry.name for entry in found}) < len(found):
        raise InputError("policy: two have the same name; write --policy NAME=FILE")
    return found


def _run(folder: ResultsFolder, plan: Plan, jobs: int | None, ray_address: str | None) -> None:
    """Run with a progress bar; it counts episodes."""
    from pm01_nav.executors import RayCluster

    cluster = RayCluster(ray_address) if ray_address and plan.episodes else None
    try:
        _follow(folder, plan, jobs, cluster)
    except KeyboardInterrupt:
        click.echo("interrupted; the same command goes on where it stopped", err=True)
        raise SystemExit(130) from None


def _follow(folder: ResultsFolder, plan: Plan, jobs: int | None, cluster: Executor | None) -> None:
    from pm01_nav.benchmark.runner import run_plan
    from pm01_nav.cli.display import episodes_bar
    from pm01_nav.provenance import machine

    with episodes_bar() as bar:
        task = bar.add_task("episodes", total=plan.total, completed=plan.done, now="")
        for job in run_plan(folder, plan, jobs or int(machine()["cores"]), cluster):
            what = f"{job.entry.name} on {job.suite.name}"
            note = what if job.kind == "episodes" else f"{job.kind}: {what}"
            bar.update(task, advance=job.count if job.kind == "episodes" else 0, now=note)


def _report(folder: ResultsFolder, suites: Sequence[Suite]) -> None:
    """Write the tables and print the short one."""
    from rich.console import Console

    from pm01_nav.benchmark.merge import merge_results
    from pm01_nav.benchmark.tables import summaries_of, write_tables
    from pm01_nav.cli.display import benchmark_table

    merged = merge_results([folder.path])
    write_tables(merged, folder.path)
    names = [suite.name for suite in suites]
    summaries = [s for s in summaries_of(merged) if s["suite"] in names]
    summaries.sort(key=lambda summary: names.index(summary["suite"]))
    console = Console()
    console.print(benchmark_table(summaries))
    for label in dict.fromkeys(s.get("barn_evaluated_in") for s in summaries):
        if label:
            click.echo(f"BARN scores: {label}")
    click.echo(f"wrote {folder.path}/results.json, results.csv and episodes.csv")
    click.echo(f"next: pm01 report {folder.path}")
