# SPDX-License-Identifier: Apache-2.0
"""What a curriculum is worth: success by kind of held-out world with none, staged and automatic.

python benchmarks/curriculum_ablation.py --steps 10000000 --seeds 5 \
    --out benchmarks/results/curriculum_ablation.json --plot docs/images/curriculum_ablation.png

Every run has the same number of steps, one learner thread, and the same worlds for the same seed.
The report is written anew after each run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from report import write_report

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.benchmark.metrics import wilson_interval
from pm01_nav.benchmark.policies import load_policy
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

PM01 = str(Path(sys.executable).with_name("pm01"))
COLORS = {"none": "#848d9c", "staged": "#2f80ed", "automatic": "#f28026"}
EASY_FIRST = (
    ("empty", "static"),
    ("empty", "static", "corridors", "rooms", "u_traps", "maze", "barn_like"),
)
"""Kinds of worlds of the first stages, as far as the task has them: little in the way, then all in
which nothing moves. The last stage has every world."""
EVALUATION_SEED = 1


def stages_of(task: str) -> str:
    """Return the stages as YAML: near goals in easy worlds, then more kinds, then everything."""
    config = task_config(task)
    names = {world.name for world in world_pool(config, "train", config.num_worlds).worlds}
    known = [[name for name in kinds if name in names] for kinds in EASY_FIRST]
    shares = ["{" + ", ".join(f"{name}: 1.0" for name in kinds) + "}" for kinds in known]
    near = f"{{worlds: {shares[0]}, goal_distance: [1.0, 4.0]}}"
    return f"[{near}, {{worlds: {shares[0]}}}, {{worlds: {shares[1]}}}, {{}}]"


def train(
    options: argparse.Namespace, curriculum: str, stages: str, seed: int, folder: Path
) -> float:
    """Train by the command line; return how long it took [s]."""
    settings = ["train.threads=1", f"train.curriculum={curriculum}", *options.set]
    if curriculum == "staged":
        settings.append(f"train.staged.stages={stages}")
    command = [PM01, "train", "--task", options.task, "--seed", str(seed)]
    command += ["--steps", str(options.steps), "--out", str(folder)]
    began = time.perf_counter()
    subprocess.run(
        [*command, *(f"--set={setting}" for setting in settings)], check=True, capture_output=True
    )
    return time.perf_counter() - began


def evaluate(evaluator: Evaluator, folder: Path) -> dict[str, Any]:
    """Return success on each kind of held-out world and on all, with 95 % intervals."""
    config = evaluator.config
    policy = load_policy(str(folder), config.robot_spec(), config.control_dt)
    results, _ = evaluator.run(policy)
    kinds = np.array([evaluator.pool.worlds[w].name for w in results.world])
    rates: dict[str, Any] = {}
    for kind in ["all", *np.unique(kinds).tolist()]:
        success = results.success if kind == "all" else results.success[kinds == kind]
        rates[kind] = {
            "success_rate": float(success.mean()),
            "success_rate_ci95": list(wilson_interval(int(success.sum()), len(success))),
            "episodes": len(success),
        }
    return rates


def summarize(runs: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return mean and standard deviation over the seeds, by curriculum and kind of world."""
    summary: dict[str, dict[str, dict[str, float]]] = {}
    for name in dict.fromkeys(run["curriculum"] for run in runs):
        own = [run["held_out"] for run in runs if run["curriculum"] == name]
        summary[name] = {}
        for kind in own[0]:
            rates = [rates[kind]["success_rate"] for rates in own]
            mean, spread = round(float(np.mean(rates)), 4), round(float(np.std(rates)), 4)
            summary[name][kind] = {"mean": mean, "std": spread}
    return summary


def plot(runs: list[dict[str, Any]], path: str, title: str) -> None:
    """Draw the mean success by kind of world as bars, and each seed as a dot."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(run["curriculum"] for run in runs))
    kinds = list(runs[0]["held_out"])
    figure = Figure(figsize=(1.5 + 1.1 * len(kinds), 4.0), dpi=120, layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(names):
        own = [run["held_out"] for run in runs if run["curriculum"] == name]
        rates = np.array([[r[kind]["success_rate"] for kind in kinds] for r in own]) * 100.0
        places = np.arange(len(kinds)) + 0.27 * (k - (len(names) - 1) / 2)
        axes.bar(places, rates.mean(axis=0), 0.25, color=COLORS[name], alpha=0.75, label=name)
        axes.plot(np.tile(places, (len(own), 1)).T, rates.T, ".", color="#3a4456", markersize=4)
    axes.set_xticks(range(len(kinds)), kinds)
    axes.set_ylabel("success on held-out worlds [%]")
    axes.set_ylim(0.0, 100.0)
    axes.set_title(title, loc="left", fontsize=10)
    axes.legend(title="curriculum", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def main() -> None:
    """Train, evaluate and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--plot", metavar="PNG")
    parser.add_argument("--task", default="mixed")
    parser.add_argument("--curricula", nargs="+", choices=list(COLORS), default=list(COLORS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=10_000_000)
    parser.add_argument("--episodes", type=int, default=2000, help="held-out episodes of a run")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args()
    evaluator = Evaluator(task_config(options.task), options.episodes, EVALUATION_SEED)
    stages = stages_of(options.task)
    title = f"{options.task}, {options.steps:,} steps, {options.seeds} seeds"
    about = {"task": options.task, "steps": options.steps, "episodes": options.episodes}
    runs: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        # Seed by seed, so that a run broken off early still compares all curricula.
        for seed in range(options.seeds):
            for curriculum in options.curricula:
                path = Path(folder) / f"{curriculum}_{seed}"
                seconds = round(train(options, curriculum, stages, seed, path), 1)
                run = {"curriculum": curriculum, "seed": seed, "command_s": seconds}
                runs.append(run | {"held_out": evaluate(evaluator, path)})
                results = {"stages": stages, "summary": summarize(runs), "runs": runs}
                write_report(options.out, about | results)
    if options.plot:
        plot(runs, options.plot, title)


if __name__ == "__main__":
    main()
