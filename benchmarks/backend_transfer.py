# SPDX-License-Identifier: Apache-2.0
"""Success of policies trained in one simulator and measured in all of them.

python benchmarks/backend_transfer.py --trained planar=runs/static \
    --trained planar+randomization=runs/randomized --trained mujoco=runs/mujoco \
    --out benchmarks/results/backend_transfer.json
python benchmarks/backend_transfer.py --trained planar=runs/static --suites static \
    --measured planar=100 gazebo=100 --out benchmarks/results/gazebo_transfer.json
python benchmarks/backend_transfer.py --trained barn=runs/barn --suites barn --worlds BARN20 \
    --measured planar=100 gazebo/ground_truth=100 gazebo/odometry=20 --out FILE.json

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
EPISODES = ["planar=1000", "mujoco=1000", "pybullet=100"]
"""PyBullet takes a hundred times as long."""
SUITES = ["static", "corridors", "crowd"]
FIGURES = ("episodes", "success_rate", "success_rate_ci95", "collision_rate", "timeout_rate", "spl")


def evaluate(run: str, suite: str, where: str, worlds: str | None) -> dict[str, Any]:
    """Return the policy's figures on held-out worlds of a suite in a simulator."""
    place, _, episodes = where.partition("=")
    backend, _, localization = place.partition("/")
    command = [PM01, "evaluate", run, "--task", suite, "--backend", backend, "--seed", "1"]
    command += ["--episodes", episodes, "--json", "-"]
    if localization:
        command += ["--set", f"task.gazebo.localization={localization}"]
    if worlds is not None and suite == "barn":
        command += ["--worlds", worlds]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    summary = json.loads(answer.stdout)
    return {key: summary[key] for key in FIGURES}


def main() -> None:
    """Evaluate and report; the report is written anew after each suite of a policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trained", action="append", required=True, metavar="NAME=RUN")
    parser.add_argument("--suites", nargs="+", default=SUITES)
    parser.add_argument(
        "--measured", nargs="+", default=EPISODES, metavar="BACKEND[/LOCALIZATION]=EPISODES"
    )
    parser.add_argument("--worlds", help="the unpacked BARN dataset, for the suite barn")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    matrix: dict[str, Any] = {}
    for text in options.trained:
        name, _, run = text.partition("=")
        history = json.loads((Path(run) / "history.json").read_text(encoding="utf-8"))
        matrix[name] = {"steps": int(history["steps"][-1]), "measured": {}}
        for suite in options.suites:
            cells = {w: evaluate(run, suite, w, options.worlds) for w in options.measured}
            matrix[name]["measured"][suite] = {w.split("=")[0]: c for w, c in cells.items()}
            write_report(options.out, {"trained": matrix})


if __name__ == "__main__":
    main()
