# SPDX-License-Identifier: Apache-2.0
"""Results for those who read and plot them themselves: results.json, results.csv, episodes.csv."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, fields
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.backends import BACKENDS
from pm01_nav.benchmark.compare import Comparison, compare
from pm01_nav.benchmark.merge import Merged, Score
from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.benchmark.summary import summarize
from pm01_nav.config import write_atomically
from pm01_nav.task.tasks import task_config

FORMAT = 1


def summary_of(score: Score, merged: Merged) -> dict[str, Any]:
    """Return an entry's figures of merit on a suite, computing times included."""
    about = merged.suites[score.suite]
    changes = {"backend": backend_of(score.suite, about)}
    figures = summarize(score.results, task_config(about["task"]).model_copy(update=changes))
    figures |= {"task": about["task"], "robot": about["robot"], "seed": about["seed"]}
    if score.step_ms is not None and len(score.step_ms):
        figures["compute_ms_median"] = float(np.median(score.step_ms))
        figures["compute_ms_p99"] = float(np.percentile(score.step_ms, 99))
    return {"suite": score.suite, "entry": score.entry} | figures


def backend_of(suite: str, about: dict[str, Any]) -> str:
    """Return what moved the robots; of older results the suite's name alone says it."""
    named = (name for name in BACKENDS if name in suite.split("+")[1:])
    return about.get("backend") or next(named, "planar")


def summaries_of(merged: Merged) -> list[dict[str, Any]]:
    """Return ``summary_of`` of every entry on every suite that it has driven on."""
    return [summary_of(score, merged) for score in merged.scores]


def comparisons(merged: Merged) -> list[Comparison]:
    """Compare every pair of entries on every suite that no sweep varies."""
    found = []
    for name, about in merged.suites.items():
        scores = [s for s in merged.scores if s.suite == name and not about["sweep"]]
        for first, second in combinations(scores, 2):
            found.append(compare(first, second, about["control_dt"]))
    return found


def write_tables(merged: Merged, folder: Path) -> dict[str, Any]:
    """Write the three files into a folder; return what results.json holds."""
    summaries = summaries_of(merged)
    data = {
        "format": FORMAT,
        "suites": merged.suites,
        "entries": merged.entries,
        "origins": merged.origins,
        "results": summaries,
        "comparisons": [asdict(c) | {"significant": c.significant} for c in comparisons(merged)],
    }
    write_atomically(folder / "results.json", json.dumps(data, indent=2) + "\n")
    write_atomically(folder / "results.csv", _summary_csv(summaries))
    write_atomically(folder / "episodes.csv", _episodes_csv(merged.scores))
    return data


def _summary_csv(summaries: list[dict[str, Any]]) -> str:
    """Return one line for each entry on each suite; an interval takes two columns."""
    lines = []
    for summary in summaries:
        line: dict[str, Any] = {}
        for key, value in summary.items():
            if isinstance(value, list):
                line[f"{key}_low"], line[f"{key}_high"] = value
            elif not isinstance(value, dict):
                line[key] = value
        lines.append(line)
    columns = list(dict.fromkeys(key for line in lines for key in line))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def _episodes_csv(scores: list[Score]) -> str:
    """Return one line for each episode."""
    names = [field.name for field in fields(EpisodeResults)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["suite", "entry", "episode", *names])
    for score in scores:
        columns = [getattr(score.results, name).tolist() for name in names]
        for episode, *row in zip(score.episode.tolist(), *columns, strict=True):
            writer.writerow([score.suite, score.entry, episode, *row])
    return text.getvalue()
