# SPDX-License-Identifier: Apache-2.0
"""How soon `pm01 train` has learnt its first iteration, and what it has learnt after ten seconds.

The first iteration is told beside a bare ``import torch, stable_baselines3``, turn about, with all
caches warm. The ten seconds begin with the command and end with the last iteration of the training.

python benchmarks/training_startup.py --out benchmarks/results/training_startup.json
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from report import write_report

import pm01_nav

PM01 = "from pm01_nav.cli import main; main()"
BARE = "import torch, stable_baselines3"
BEGUN = "import pm01_nav.cli as cli; print(cli.STARTED_AT)"
PRESETS = ("default", "quick")
# Who writes no bytecode compiles every module at every start.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def run(code: str, *arguments: str) -> tuple[float, str]:
    """Run Python; return its wall time [s] and what it printed."""
    command = [sys.executable, "-c", code, *arguments]
    began = time.perf_counter()
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=ENVIRONMENT)
    return time.perf_counter() - began, done.stdout


def until_the_clock_starts() -> float:
    """Return how long a command takes until its own clock starts [s]."""
    began = time.perf_counter()  # The system's clock, the same in all processes.
    return float(run(BEGUN)[1]) - began


def trained(folder: Path, *options: str) -> dict[str, list[float]]:
    """Train on ``static``; return the history of the run."""
    run(PM01, "train", "--task", "static", "--out", str(folder), "--force", *options)
    return json.loads((folder / "history.json").read_text(encoding="utf-8"))


def first_iteration(folder: Path, preset: str) -> float:
    """Return when the first iteration ends, counted from the start of the command [s]."""
    options = ("--preset", preset, "--steps", "1", "--set", "train.eval_episodes=1")
    return until_the_clock_starts() + trained(folder, *options)["seconds"][0]


def first_iterations(folder: Path, repeats: int) -> dict[str, Any]:
    """Measure the bare import and the first iterations, turn about."""
    for preset in PRESETS:
        first_iteration(folder, preset)  # Fills the caches.
    seconds: dict[str, list[float]] = {name: [] for name in ("bare_import", *PRESETS)}
    for _ in range(repeats):
        seconds["bare_import"].append(run(BARE)[0])
        for preset in PRESETS:
            seconds[preset].append(first_iteration(folder, preset))
    medians = {name: round(statistics.median(values), 3) for name, values in seconds.items()}
    above = {name: round(medians[name] - medians["bare_import"], 3) for name in PRESETS}
    rounded = {name: [round(v, 3) for v in values] for name, values in seconds.items()}
    return {"median_s": medians, "above_bare_import_s": above, "repeats_s": rounded}


def after_seconds(folder: Path, budget: float, seed: int, episodes: int) -> dict[str, Any]:
    """Train with ``--preset quick``; return when that ended, and success on held-out worlds."""
    options = ("--preset", "quick", "--time-budget", str(budget), "--seed", str(seed))
    before = until_the_clock_starts()
    history = trained(folder, *options)
    summary = pm01_nav.evaluate(folder, episodes=episodes)
    return {
        "seed": seed,
        "training_ended_s": round(before + history["seconds"][-1], 2),
        "steps": int(history["steps"][-1]),
        "success_rate": round(summary["success_rate"], 4),
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--repeats", type=int, default=11, help="of the first iteration; 0: none")
    parser.add_argument("--seeds", type=int, default=10, help="of the ten seconds; 0: none")
    parser.add_argument("--budget", type=float, default=9.8)
    parser.add_argument("--episodes", type=int, default=1000)
    options = parser.parse_args()
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        if options.repeats:
            results["first_iteration"] = first_iterations(folder, options.repeats)
            print(results, flush=True)
        runs = []
        for seed in range(options.seeds):
            runs.append(after_seconds(folder, options.budget, seed, options.episodes))
            print(runs[-1], flush=True)
    if runs:
        results["quick"] = {"budget_s": options.budget, "episodes": options.episodes, "runs": runs}
    write_report(options.out, results)


if __name__ == "__main__":
    main()
