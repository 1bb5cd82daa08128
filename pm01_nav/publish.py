# SPDX-License-Identifier: Apache-2.0
"""Lay out a policy as a model repository of the Hugging Face kind; nothing is sent anywhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pm01_nav.benchmark.policies import policy_file
from pm01_nav.config import make_folder, to_yaml, write_atomically
from pm01_nav.documents import load_json, load_yaml
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.provenance import shown
from pm01_nav.zoo import PREFIX, zoo_folder

LICENSE = "apache-2.0"
EXPORTERS_MARK = b"pkg.torch"
"""Begins the names of what torch's exporter leaves in a file."""
RATES = ("success_rate", "collision_rate", "timeout_rate")


def card_of(name: str) -> dict[str, Any]:
    """Return the card of a policy: the zoo's, or one made from a run's folder or a file.

    Raises:
        InputError: there is no such policy.
    """
    if name.startswith(PREFIX):
        return load_yaml(zoo_folder(name.removeprefix(PREFIX)) / "card.yaml")
    file = policy_file(name)
    metadata = OnnxPolicy(file).metadata
    measured = file.with_name("metrics.json")
    task = metadata.get("task")
    card = {
        "name": file.resolve().parent.name if file.name == "policy.onnx" else file.stem,
        "summary": "A local navigation policy trained with PM01 Navigation.",
        "robot": metadata.get("robot"),
        "task": task.get("name") if isinstance(task, dict) else None,
        "algorithm": metadata.get("algorithm", "ppo"),
        "training": {
            key: metadata.get(key) for key in ("command", "training_steps", "seed", "git_revision")
        },
        "results": [result_of(load_json(measured))] if measured.is_file() else [],
        "limits": ["Measured in simulation only."],
    }
    return shown(card)


def result_of(summary: dict[str, Any]) -> dict[str, Any]:
    """Return what a card says of an evaluation (`pm01 evaluate --json`)."""
    kept = ("task", "suite", "episodes", "seed", "spl", *RATES)
    found = {key: summary[key] for key in kept if key in summary}
    return found | {f"{n}_ci95": summary[f"{n}_ci95"] for n in RATES if f"{n}_ci95" in summary}


def write_repository(name: str, folder: Path) -> list[Path]:
    """Write policy.onnx, README.md (the card), config.json and results.json; return the files.

    Raises:
        InputError: there is no such policy, or the folder is not empty or cannot be made.
    """
    card, file = card_of(name), policy_file(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"output = {folder}: exists and is not an empty folder")
    metadata = OnnxPolicy(file).metadata
    content = _shareable(file, metadata)
    make_folder(folder, "output")
    files = {
        "policy.onnx": content,
        "README.md": readme(card),
        "config.json": json.dumps(shown(metadata), indent=2) + "\n",
        "results.json": json.dumps(card["results"], indent=2) + "\n",
    }
    for file_name, text in files.items():
        write_atomically(folder / file_name, text)
    return [folder / file_name for file_name in files]


def _shareable(file: Path, metadata: dict[str, Any]) -> bytes:
    """Return a policy's file without what early versions of this program left in it.

    Raises:
        InputError: there is something to be taken out, and onnx is not installed.
    """
    content = file.read_bytes()
    if EXPORTERS_MARK not in content and shown(metadata) == metadata:
        return content
    try:
        from pm01_nav.policy.onnx_file import cleaned
    except ImportError as error:
        raise InputError(
            f"{file}: names folders of the machine that made it; to take them out: "
            "pip install 'pm01-nav[train]'"
        ) from error
    return cleaned(content, metadata)


def readme(card: dict[str, Any]) -> str:
    """Return the model card as Markdown with Hugging Face's front matter."""
    header = {
        "license": LICENSE,
        "library_name": "pm01-nav",
        "pipeline_tag": "robotics",
        "tags": ["robotics", "navigation", "reinforcement-learning", "onnx", str(card["robot"])],
        "model-index": [{"name": card["name"], "results": [_index(r) for r in card["results"]]}],
    }
    training = card["training"]
    lines = [
        f"---\n{to_yaml(header)}---",
        f"# {card['name']}",
        card["summary"],
        f"Robot `{card['robot']}`, trained on task `{card['task']}` by `{card['algorithm']}`.",
        "## Use",
        # `pm01 evaluate` simulates (sim) and runs an ONNX file (deploy); it needs no torch.
        "```bash\npip install 'pm01-nav[sim,deploy]'\n"
        "pm01 evaluate policy.onnx --episodes 1000\n```",
        "The file holds the normaliser, the network and the limits of the robot; its metadata "
        "(config.json) says which lidar and which limits it fits.",
        "## Results",
        _table(card["results"]),
        "## Training",
        "\n".join(f"- {key}: `{value}`" for key, value in training.items() if value is not None),
        "## Limits",
        "\n".join(f"- {limit}" for limit in card["limits"]),
    ]
    return "\n\n".join(lines) + "\n"


def _index(result: dict[str, Any]) -> dict[str, Any]:
    where = str(result.get("suite") or result.get("task"))
    metrics = [
        {"type": name, "name": name.replace("_", " "), "value": round(result[name], 4)}
        for name in (*RATES, "spl")
        if name in result
    ]
    return {
        "task": {"type": "robotics", "name": "navigation"},
        "dataset": {"type": "pm01-nav", "name": where},
        "metrics": metrics,
    }


def _table(results: list[dict[str, Any]]) -> str:
    if not results:
        return "Not measured: `pm01 evaluate` does it."
    rows = [
        "| suite | episodes | success % [95 % interval] | collision % | time-out % | SPL |",
        "|---|---|---|---|---|---|",
    ]
    for result in results:
        low, high = (100.0 * value for value in result["success_rate_ci95"])
        success, collision, timeout = (100.0 * result[name] for name in RATES)
        rows.append(
            f"| {result.get('suite') or result.get('task')} | {result['episodes']} | "
            f"{success:.1f} [{low:.1f}, {high:.1f}] | {collision:.1f} | {timeout:.1f} | "
            f"{result['spl']:.2f} |"
        )
    return "\n".join(rows)
