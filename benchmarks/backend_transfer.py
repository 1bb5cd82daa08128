# SPDX-License-Identifier: Apache-2.0
"""Success of policies trained in one simulator and measured in all of them.

python benchmarks/backend_transfer.py --trained planar=runs/static \
    --trained planar+randomization=runs/randomized --trained mujoco=runs/mujoco \
    --out benchmarks/results/backend_transfer.json

The runs are made with `pm01 train --task static`, with `--randomization on`, and with
`--backend mujoco`. All cells of a suite are the same held-out episodes, but for their number.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from report import write_report

PM01 = str(Path(sys.executable).with_name("pm01"))
EPISODES = {"planar": 1000, "mujoco": 1000, "pybullet": 100}
"""PyBullet takes a hundred times as long."""
SUITES = ("static", "corridors", "crowd")
FIGURES = ("episodes", "success_rate", "success_rate_ci95", "collision_rate", "timeout_rate", "spl")


def evaluate(run: str, suite: str, backend: str, episodes: int) -> dict[str, Any]:
    """Return the policy's figures on held-out worlds of a suite in a simulator."""
    command = [PM01, "evaluate", run, "--task", suite, "--backend", backend, "--seed", "1"]
    command += ["--episodes", str(episodes), "--json", "-"]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    summary = json.loads(answer.stdout)
    return {key: summary[key] for key in FIGURES}


def main() -> None:
    """Evaluate and report; the report is written anew after each suite of a policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trained", action="append", required=True, metavar="NAME=RUN")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    matrix: dict[str, Any] = {}
    for text in options.trained:
        name, _, run = text.partition("=")
        history = json.loads((Path(run) / "history.json").read_text(encoding="utf-8"))
        matrix[name] = {"steps": int(history["steps"][-1]), "measured": {}}
        for suite in SUITES:
            cells = {b: evaluate(run, suite, b, n) for b, n in EPISODES.items()}
            matrix[name]["measured"][suite] = cells
            write_report(options.out, {"trained": matrix})


if __name__ == "__main__":
    main()
