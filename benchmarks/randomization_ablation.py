# SPDX-License-Identifier: Apache-2.0
"""What domain randomization costs on the robot as described, and what it buys on another one.

python benchmarks/randomization_ablation.py --steps 3000000 --seeds 5 \
    --out benchmarks/results/randomization_ablation.json \
    --plot docs/images/randomization_ablation.png

Every run has the same number of steps, one learner thread, and the same worlds for the same seed.
Each policy drives the same held-out episodes on three robots: as described (nominal), drawn from
the default ranges (randomized), and one fixed robot that is wrong in every respect (harsh,
harsh_robot.yaml). The report is written anew after each run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from report import write_report

PM01 = str(Path(sys.executable).with_name("pm01"))
HARSH = str(Path(__file__).with_name("harsh_robot.yaml"))
ROBOTS = {"nominal": "off", "randomized": "on", "harsh": HARSH}
COLORS = {"off": "#848d9c", "on": "#2f80ed"}
FIGURES = ("success_rate", "success_rate_ci95", "collision_rate", "timeout_rate", "spl")


def train(options: argparse.Namespace, trained: str, seed: int, folder: Path) -> float:
    """Train by the command line; return how long it took [s]."""
    command = [PM01, "train", "--task", options.task, "--seed", str(seed)]
    command += ["--steps", str(options.steps), "--out", str(folder), "--randomization", trained]
    settings = [f"--set={setting}" for setting in ("train.threads=1", *options.set)]
    began = time.perf_counter()
    subprocess.run([*command, *settings], check=True, capture_output=True)
    return time.perf_counter() - began


def evaluate(folder: Path, robot: str, episodes: int) -> dict[str, Any]:
    """Return how well a run's policy drives held-out worlds on one of the robots."""
    command = [PM01, "evaluate", str(folder), "--episodes", str(episodes), "--seed", "1"]
    command += ["--randomization", ROBOTS[robot], "--json", "-"]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    summary = json.loads(answer.stdout)
    return {key: summary[key] for key in FIGURES}


def summarize(runs: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return mean and standard deviation of success over the seeds, by training and robot."""
    summary: dict[str, dict[str, dict[str, float]]] = {}
    for trained in dict.fromkeys(run["trained"] for run in runs):
        own = [run["robots"] for run in runs if run["trained"] == trained]
        rates = {robot: [r[robot]["success_rate"] for r in own] for robot in ROBOTS}
        summary[trained] = {
            robot: {"mean": round(float(np.mean(r)), 4), "std": round(float(np.std(r)), 4)}
            for robot, r in rates.items()
        }
    return summary


def plot(runs: list[dict[str, Any]], path: str, title: str) -> None:
    """Draw the mean part of failed episodes by robot as bars, and each seed as a dot."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.0), dpi=120, layout="constrained")
    axes = figure.subplots()
    for k, trained in enumerate(dict.fromkeys(run["trained"] for run in runs)):
        own = [run["robots"] for run in runs if run["trained"] == trained]
        rates = np.array([[1.0 - r[robot]["success_rate"] for robot in ROBOTS] for r in own]) * 100
        places = np.arange(len(ROBOTS)) + 0.36 * (k - 0.5)
        axes.bar(places, rates.mean(axis=0), 0.34, color=COLORS[trained], alpha=0.75, label=trained)
        axes.plot(np.tile(places, (len(own), 1)).T, rates.T, ".", color="#3a4456", markersize=4)
    axes.set_xticks(range(len(ROBOTS)), list(ROBOTS))
    axes.set_xlabel("robot that drives")
    axes.set_ylabel("failed episodes on held-out worlds [%]")
    axes.set_title(title, loc="left", fontsize=10)
    axes.legend(
        title="randomization\nin training",
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        frameon=False,
    )
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def parse_options() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--plot")
    parser.add_argument("--task", default="static")
    parser.add_argument("--steps", type=int, default=3_000_000)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--set", action="append", default=[], help="a setting of pm01 train")
    return parser.parse_args()


def main() -> None:
    """Train, evaluate and report."""
    options = parse_options()
    settings = {key: getattr(options, key) for key in ("task", "steps", "episodes", "set")}
    runs: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.seeds):
            for trained in COLORS:
                folder = Path(temporary) / f"{trained}_{seed}"
                seconds = train(options, trained, seed, folder)
                robots = {robot: evaluate(folder, robot, options.episodes) for robot in ROBOTS}
                run = {"trained": trained, "seed": seed, "train_s": round(seconds, 1)}
                runs.append(run | {"robots": robots})
                write_report(options.out, settings | {"success": summarize(runs), "runs": runs})
    if options.plot:
        title = f"{options.task}, {options.steps:,} steps, seeds: {options.seeds}"
        plot(runs, options.plot, title)


if __name__ == "__main__":
    main()
