# SPDX-License-Identifier: Apache-2.0
"""What curiosity brings where only the goal and collisions pay: `u_traps` with a sparse reward.

python benchmarks/curiosity.py --steps 2000000 --seeds 3 --out benchmarks/results/curiosity.json
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml
from report import write_report

from pm01_nav.task.tasks import task_config

PM01 = (sys.executable, "-c", "from pm01_nav.cli import main; main()")
CASES = {
    "sparse": [],
    "sparse + icm": ["--set", "train.icm={}"],
    "sparse + rnd": ["--set", "train.rnd={}"],
}
SPARSE = {"goal": {"weight": 100.0}, "collision": {"weight": -20.0}}
"""Nothing for coming closer, nothing for time."""


def sparse_task(name: str) -> dict[str, Any]:
    """Return a task of which only the goal and collisions pay."""
    task = task_config(name).model_dump(mode="json")
    return task | {"rewards": SPARSE}


def run(config: Path, steps: int, seed: int, extra: list[str], folder: Path) -> dict[str, Any]:
    """Train and measure on 500 held-out episodes."""
    arguments = ["train", "--config", str(config), "--steps", str(steps), "--seed", str(seed)]
    fixed = ["--set", "train.threads=1", "--out", str(folder)]
    subprocess.run([*PM01, *arguments, *fixed, *extra], check=True, capture_output=True)
    answer = subprocess.run(
        [*PM01, "evaluate", str(folder), "--episodes", "500", "--json", "-"],
        check=True,
        capture_output=True,
        text=True,
    )
    summary = json.loads(answer.stdout)
    history = json.loads((folder / "history.json").read_text(encoding="utf-8"))
    rates = ("success_rate", "success_rate_ci95", "collision_rate", "timeout_rate")
    return {
        "seed": seed,
        **{key: summary[key] for key in rates},
        "evaluations": history["eval_success_rate"],
        "seconds": round(history["seconds"][-1], 1),
        "last_training_success": history["success_rate"][-1],
    }


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--task", default="u_traps")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    results: dict[str, Any] = {"task": options.task, "steps": options.steps, "rewards": SPARSE}
    results["runs"] = []
    with tempfile.TemporaryDirectory() as name:
        config = Path(name) / "sparse.yaml"
        settings = {"eval_every": options.steps // 4, "eval_episodes": 256}
        data = {"task": sparse_task(options.task), "train": settings}
        config.write_text(yaml.safe_dump(data), encoding="utf-8")
        for seed in range(options.seeds):
            for k, (case, extra) in enumerate(CASES.items()):
                folder = Path(name) / f"{k}_{seed}"
                found = run(config, options.steps, seed, extra, folder)
                results["runs"].append({"case": case} | found)
                print(results["runs"][-1], flush=True)
                write_report(options.out, results)


if __name__ == "__main__":
    main()
