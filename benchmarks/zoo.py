# SPDX-License-Identifier: Apache-2.0
"""Put a trained policy into the zoo: its file, and a card with what was measured.

python benchmarks/zoo.py pm01-static --run runs/static --summary "..." \
    --entry static --limit "..."
python benchmarks/zoo.py pm01-crowd --run runs/crowd --summary "..." --evaluation crowd.json
"""

from __future__ import annotations

import argparse
import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.benchmark.evaluate import Evaluator, GoalSource, answer
from pm01_nav.benchmark.policies import load_policy, trained_task
from pm01_nav.config import to_yaml, write_atomically
from pm01_nav.policy.onnx_file import cleaned
from pm01_nav.policy.onnx_policy import OnnxPolicy
from pm01_nav.publish import RATES, result_of
from pm01_nav.task.spinning import SpinMeter
from pm01_nav.zoo import FOLDER

TABLE = Path(__file__).parent / "results" / "benchmark.csv"


def copy_policy(run: Path, target: Path, name: str, command: str | None) -> dict[str, Any]:
    """Copy the file; its command names no folder of the machine that made it."""
    metadata = OnnxPolicy(run / "policy.onnx").metadata
    typed = command or metadata["command"]
    metadata["command"] = re.sub(r"--out \S+", f"--out runs/{name}", typed)
    target.mkdir(exist_ok=True)
    content = cleaned((run / "policy.onnx").read_bytes(), metadata)
    write_atomically(target / "policy.onnx", content)
    return metadata


def from_table(entry: str) -> list[dict[str, Any]]:
    """Return what the benchmark's table says of one entry, without its sweeps."""
    results = []
    with TABLE.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["entry"] != entry or "@" in row["suite"]:
                continue
            result: dict[str, Any] = {"suite": row["suite"], "episodes": int(row["episodes"])}
            for rate in RATES:
                result[rate] = float(row[rate])
                ends = [float(row[f"{rate}_ci95_{end}"]) for end in ("low", "high")]
                result[f"{rate}_ci95"] = ends
            result["spl"] = float(row["spl"])
            if row["barn_score_2024"]:
                result["barn_score_2024"] = float(row["barn_score_2024"])
            results.append(result)
    return results


def spinning_share(policy_name: str, episodes: int) -> float:
    """Return the part of their time that robots spin on the task of the policy, held out."""
    task = trained_task(policy_name)
    assert task is not None
    policy = load_policy(policy_name, task.robot_spec(), task.control_dt)
    evaluator = Evaluator(task, episodes, seed=1)
    batch = evaluator.begin(np.arange(episodes))
    source = GoalSource(batch, evaluator.pool, None)
    policy.reset()
    driving = np.ones(episodes, dtype=np.bool_)
    state = batch.simulator.state
    meter = SpinMeter(state.pose)
    spun = steps = 0.0
    while driving.any():
        result = batch.step(batch.layout.drive.to_action(answer(policy, batch, source)))
        # Robots that are done go on somewhere; what they do then is not looked at.
        meter.note(state.pose, ~driving)
        count = float(driving.sum())
        spun += meter.share() * episodes
        steps += count
        driving &= ~(result.terminated | result.truncated)
    return spun / steps


def main() -> None:
    """Write the folder of one policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--summary", required=True)
    parser.add_argument("--command", help="the run's, if what it typed named files elsewhere")
    parser.add_argument("--entry", help="take results from the benchmark's table")
    parser.add_argument("--evaluation", type=Path, nargs="*", default=[])
    parser.add_argument("--limit", action="append", default=[])
    parser.add_argument("--spin-episodes", type=int, default=256)
    options = parser.parse_args()
    target = FOLDER / options.name
    metadata = copy_policy(options.run, target, options.name, options.command)
    results = from_table(options.entry) if options.entry else []
    results += [result_of(json.loads(p.read_text(encoding="utf-8"))) for p in options.evaluation]
    training = ("command", "training_steps", "seed", "created", "git_revision", "machine")
    share = spinning_share(str(target / "policy.onnx"), options.spin_episodes)
    card = {
        "name": options.name,
        "summary": options.summary,
        "robot": metadata["robot"],
        "task": metadata["task"]["name"],
        "algorithm": metadata.get("algorithm", "ppo"),
        "training": {key: metadata.get(key) for key in training},
        "results": results,
        "spinning": {"share": round(share, 5), "episodes": options.spin_episodes},
        "limits": options.limit,
    }
    write_atomically(target / "card.yaml", to_yaml(card))
    print(to_yaml(card))


if __name__ == "__main__":
    main()
