# SPDX-License-Identifier: Apache-2.0
"""One policy for all suites: success on held-out worlds of each after `pm01 train --task mixed`.

python benchmarks/mixed.py --time-budget 600 --out benchmarks/results/mixed.json
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from report import write_report

PM01 = str(Path(sys.executable).with_name("pm01"))
SUITES = ("static", "corridors", "rooms", "maze", "u_traps", "crowd", "warehouse", "mixed")
RATES = ("success_rate", "collision_rate", "timeout_rate")


def evaluate(run: Path, suite: str, episodes: int) -> dict[str, Any]:
    """Return the policy's figures on held-out worlds of a suite."""
    command = [PM01, "evaluate", str(run), "--task", suite, "--episodes", str(episodes)]
    answer = subprocess.run(
        [*command, "--seed", "1", "--json", "-"], check=True, capture_output=True, text=True
    )
    summary = json.loads(answer.stdout)
    keys = ("episodes", *RATES, *(f"{rate}_ci95" for rate in RATES), "spl", "time_to_goal_s")
    return {key: summary[key] for key in keys}


def main() -> None:
    """Train, evaluate and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--time-budget", type=float, default=600.0, help="of the training [s]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=1000, help="held-out episodes of a suite")
    parser.add_argument("--keep", metavar="DIR", help="folder for the run; else it is deleted")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = Path(options.keep or Path(folder) / "run")
        command = ["train", "--task", "mixed", "--seed", str(options.seed)]
        command += ["--time-budget", f"{options.time_budget:g}"]
        subprocess.run([PM01, *command, "--out", str(run)], check=True, capture_output=True)
        history = json.loads((run / "history.json").read_text(encoding="utf-8"))
        results: dict[str, Any] = {
            "training": " ".join(["pm01", *command]),
            "steps": int(history["steps"][-1]),
            "held_out": {suite: evaluate(run, suite, options.episodes) for suite in SUITES},
        }
    write_report(options.out, results)


if __name__ == "__main__":
    main()
