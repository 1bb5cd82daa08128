# SPDX-License-Identifier: Apache-2.0
"""What checkpoints cost a training: alternating runs with and without, and the time they take.

    python benchmarks/checkpoint_cost.py --out benchmarks/results/checkpoint_cost.json

The share of the time is taken within one run, so that what
else the machine does meanwhile counts little; between two runs it may count more than checkpoints.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from report import write_report

from pm01_nav.task.tasks import task_config
from pm01_nav.training.config import RunConfig, TrainConfig, algorithm_defaults
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.supervision import NoProgress, Supervision
from pm01_nav.training.trainer import train

CASES: dict[str, dict[str, Any]] = {
    "ppo": {},
    "ppo, 2 workers": {"workers": 2},
    "ppo_lstm": {"algo": "ppo_lstm"},
    "sac": {"algo": "sac"},
}
NEVER = 1e9


class Timed:
    """The moments at which a run is saved, and how long each takes."""

    def __init__(self) -> None:
        """Count nothing yet."""
        self.begun: list[float] = []
        self.seconds: list[float] = []
        self._save = Supervision.save

    def __enter__(self) -> Timed:
        """Begin to count."""

        def save(supervision: Supervision) -> None:
            self.begun.append(time.perf_counter())
            self._save(supervision)
            self.seconds.append(time.perf_counter() - self.begun[-1])

        setattr(Supervision, "save", save)  # noqa: B010  # of another type for pyright
        return self

    def __exit__(self, *_: object) -> None:
        """Leave things as they were."""
        Supervision.save = self._save


def measure(case: dict[str, Any], checkpoint_every: float, budget: float) -> dict[str, float]:
    """Train once; return steps a second from the first iteration on, and what saving took."""
    more = {"threads": 1, "eval_every": 10**9, "eval_episodes": 1}
    settings = algorithm_defaults(case.get("algo", "ppo")) | case | more
    settings |= {"checkpoint_every": checkpoint_every, "time_budget": budget}
    config = RunConfig(task=task_config("static"), train=TrainConfig.model_validate(settings))
    with tempfile.TemporaryDirectory() as folder, Timed() as saved:
        run = RunFolder(Path(folder) / "run")
        steps = train(config, run, NoProgress(), started_at=time.perf_counter()).steps
        size = run.last.stat().st_size
    # From the save after the first iteration to the last one, which every run has at its end.
    seconds = max(saved.begun[-1] - saved.begun[0], 1e-9)
    return {
        "steps_per_s": steps / seconds,
        "seconds": seconds,
        "saves": len(saved.seconds),
        "share": sum(saved.seconds[1:-1]) / seconds,
        "longest_save_s": max(saved.seconds),
        "longest_without_s": float(np.diff(saved.begun).max(initial=0.0)),
        "megabytes": size / 1e6,
    }


def main() -> None:
    """Measure each case in pairs of runs, with checkpoints and without."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="Of each run.")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), metavar="CASE")
    arguments = parser.parse_args()
    results = {}
    for name in arguments.cases:
        case = CASES[name]
        measure(case, NEVER, 0.5 * arguments.seconds)
        kept, never = [], []
        for _ in range(arguments.pairs):
            kept.append(measure(case, 10.0, arguments.seconds))
            never.append(measure(case, NEVER, arguments.seconds))
        ratios = [a["steps_per_s"] / b["steps_per_s"] for a, b in zip(kept, never, strict=True)]
        results[name] = {
            "share_of_time_saving": [round(run["share"], 5) for run in kept],
            "speed_with_of_without": [round(ratio, 3) for ratio in ratios],
            "median_of_pairs": round(statistics.median(ratios), 3),
            "steps_per_s": [round(run["steps_per_s"]) for run in kept],
            "seconds": [round(run["seconds"], 1) for run in kept],
            "saves": [int(run["saves"]) for run in kept],
            "longest_save_s": round(max(run["longest_save_s"] for run in kept), 3),
            "longest_without_s": round(max(run["longest_without_s"] for run in kept), 2),
            "megabytes": round(kept[0]["megabytes"], 2),
        }
    write_report(arguments.out, {"checkpoint_every_s": 10.0, "cases": results})


if __name__ == "__main__":
    main()
