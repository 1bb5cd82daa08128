# SPDX-License-Identifier: Apache-2.0
"""Success on 1000 held-out worlds after so many seconds of `pm01 train`, for several seeds.

python benchmarks/learning.py --seeds 5 --out benchmarks/results/learning_static.json
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from report import write_report

from pm01_nav.training.statistics import time_to

LEVELS = (0.95, 0.99)
"""The time at which an evaluation on the way first shows these rates of success is told."""
PM01 = str(Path(sys.executable).with_name("pm01"))


def run(
    task: str, budget: float, seed: int, episodes: int, folder: Path, options: Sequence[str] = ()
) -> dict[str, Any]:
    """Train from a cold start of the command and evaluate; return the figures.

    ``options`` are further ones of ``pm01 train``.
    """
    began = time.perf_counter()
    train = [PM01, "train", "--task", task, "--seed", str(seed), "--time-budget", str(budget)]
    subprocess.run([*train, *options, "--out", str(folder)], check=True, capture_output=True)
    seconds = time.perf_counter() - began
    answer = subprocess.run(
        [PM01, "evaluate", str(folder), "--episodes", str(episodes), "--seed", "1", "--json", "-"],
        check=True,
        capture_output=True,
        text=True,
    )
    summary = json.loads(answer.stdout)
    history = json.loads((folder / "history.json").read_text(encoding="utf-8"))
    keys = ("success_rate", "success_rate_ci95", "collision_rate", "timeout_rate", "spl")
    return {
        "seed": seed,
        "budget_s": budget,
        "steps": int(history.get("steps", [0])[-1]),
        "command_s": round(seconds, 1),
        **{key: summary[key] for key in keys},
        **{
            f"seconds_to_{100 * level:g}": time_to(
                history["eval_success_rate"], history["eval_seconds"], level
            )
            for level in LEVELS
        },
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--task", default="static")
    parser.add_argument("--budgets", type=float, nargs="+", default=[30.0, 120.0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=1000)
    options = parser.parse_args()
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        for budget in options.budgets:
            for seed in range(options.seeds):
                path = Path(folder) / f"{budget:g}_{seed}"
                runs.append(run(options.task, budget, seed, options.episodes, path))
                print(runs[-1], flush=True)
    write_report(options.out, {"task": options.task, "episodes": options.episodes, "runs": runs})


if __name__ == "__main__":
    main()
