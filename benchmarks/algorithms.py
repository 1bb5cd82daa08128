# SPDX-License-Identifier: Apache-2.0
"""Success and speed of every algorithm and network after the same time of `pm01 train`.

python benchmarks/algorithms.py --budget 60 --seeds 3 --out benchmarks/results/algorithms.json
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from learning import run
from report import write_report

CASES: dict[str, list[str]] = {
    "ppo": [],
    "ppo, rsl_rl": ["--learner", "rsl_rl"],
    "ppo_lstm": ["--algo", "ppo_lstm"],
    "sac": ["--algo", "sac"],
    "td3": ["--algo", "td3"],
    "tqc": ["--algo", "tqc"],
    "ppo, circular_conv": ["--set", "train.ppo.features_extractor=circular_conv"],
    "ppo, asymmetric_critic": ["--set", "train.ppo.asymmetric_critic=true"],
    "ppo, norm_obs and norm_reward": ["--set", "train.ppo={norm_obs: true, norm_reward: true}"],
}


def main() -> None:
    """Measure and report; cases come turn about, so that a busy machine is unjust to none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--task", default="static")
    parser.add_argument("--budget", type=float, default=60.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--eval-every", type=int, default=100_000, help="steps")
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    options = parser.parse_args()
    runs: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.seeds):
            for k, case in enumerate(options.cases):
                path = Path(folder) / f"{k}_{seed}"
                extra = [*CASES[case], "--set", f"train.eval_every={options.eval_every}"]
                found = run(options.task, options.budget, seed, options.episodes, path, extra)
                found["steps_per_second"] = round(found["steps"] / options.budget)
                runs.append({"case": case} | found)
                print(runs[-1], flush=True)
                write_report(options.out, {"task": options.task, "runs": runs})


if __name__ == "__main__":
    main()
