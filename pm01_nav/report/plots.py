# SPDX-License-Identifier: Apache-2.0
"""Which charts the report has: one for each sweep, three distributions for each suite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pm01_nav.benchmark.merge import Merged, Score
from pm01_nav.report.charts import Axis, Line, distribution, line_chart
from pm01_nav.report.figures import FIGURES, cell
from pm01_nav.report.tables import Data, summaries_on

PERCENT = Axis("", 0.0, 100.0, (0.0, 25.0, 50.0, 75.0, 100.0))
LONG_TAIL = 98.0
"""A distribution's axis ends at this percentile of the entry that reaches farthest."""

FloatArray = NDArray[np.float64]


def sweep_charts(data: Data, entries: Sequence[str]) -> list[dict[str, Any]]:
    """Return for each sweep its name, label, chart, and the same numbers as a table."""
    sweeps: dict[str, list[tuple[float, str]]] = {}
    for suite, about in data["suites"].items():
        if about["sweep"]:
            sweeps.setdefault(about["sweep"]["sweep"], []).append((about["sweep"]["value"], suite))
    return [_sweep(data, name, sorted(points), entries) for name, points in sweeps.items()]


def _sweep(
    data: Data, name: str, points: list[tuple[float, str]], entries: Sequence[str]
) -> dict[str, Any]:
    about = data["suites"][points[0][1]]["sweep"]
    values = [value for value, _ in points]
    found = [(value, summaries_on(data, suite, entries)) for value, suite in points]
    lines, rows = [], []
    for number, entry in enumerate(entries):
        own = [(value, summaries[entry]) for value, summaries in found if entry in summaries]
        if own:
            lines.append(_sweep_line(number, entry, own, about["label"]))
            cells = {value: cell(summary, FIGURES[0]) for value, summary in own}
            rows.append({"entry": entry, "cells": [cells.get(value) for value in values]})
    margin = 0.02 * (max(values) - min(values)) or 0.5
    x = Axis(about["label"], min(values) - margin, max(values) + margin, values)
    return {
        "name": name.replace("_", " "),
        "suite": about["suite"],
        "label": about["label"],
        "chart": line_chart(lines, x, PERCENT, f"Success in percent against {about['label']}"),
        "values": [f"{value:g}" for value in values],
        "rows": rows,
    }


def _sweep_line(
    number: int, entry: str, points: list[tuple[float, dict[str, Any]]], label: str
) -> Line:
    cells = [cell(summary, FIGURES[0]) for _, summary in points]
    ends = np.array([summary["success_rate_ci95"] for _, summary in points]) * 100.0
    hints = [
        f"{entry}: {c.text} % ({c.interval}) at {value:g} {label}"
        for (value, _), c in zip(points, cells, strict=True)
    ]
    x = np.array([value for value, _ in points], dtype=np.float64)
    y = np.array([100.0 * summary["success_rate"] for _, summary in points])
    return Line(number, entry, x, y, (ends[:, 0], ends[:, 1]), hints)


def distributions(merged: Merged, suite: str, entries: Sequence[str]) -> list[dict[str, Any]]:
    """Return three charts of a suite: time to goal, detour, least clearance."""
    scores = [(k, merged.find(suite, entry)) for k, entry in enumerate(entries)]
    found = [(k, score) for k, score in scores if score is not None]
    dt = merged.suites[suite]["control_dt"]
    return [
        {
            "title": "Time to goal",
            "note": "% of all episodes that arrived by then",
            "chart": _curves([_times(k, s, dt) for k, s in found], "time [s]", 0.0),
        },
        {
            "title": "Path length over shortest",
            "note": "% of successes with at most this ratio",
            "chart": _curves([_detours(k, s) for k, s in found], "path length / shortest", 1.0),
        },
        {
            "title": "Minimum clearance",
            "note": "% of all episodes that came at least this near",
            "chart": _curves([_clearances(k, s) for k, s in found], "min. clearance [m]", 0.0),
        },
    ]


def _times(number: int, score: Score, dt: float) -> tuple[FloatArray, Line]:
    won = score.results.success
    seconds = dt * score.results.steps[won].astype(np.float64)
    return distribution(seconds, number, score.entry, total=len(won))


def _detours(number: int, score: Score) -> tuple[FloatArray, Line]:
    results = score.results
    counted = results.success & np.isfinite(results.shortest_path) & (results.shortest_path > 0.0)
    # The way found on a grid is no shorter than the shortest one; who is shorter counts as 1.
    ratio = results.path_length[counted] / results.shortest_path[counted]
    return distribution(np.maximum(ratio, 1.0), number, score.entry)


def _clearances(number: int, score: Score) -> tuple[FloatArray, Line]:
    return distribution(np.maximum(score.results.min_clearance, 0.0), number, score.entry)


def _curves(found: list[tuple[FloatArray, Line]], label: str, low: float) -> Markup | None:
    """Draw distributions that begin at ``low``; ``None`` if there is nothing to draw."""
    ends = [float(np.percentile(values, LONG_TAIL)) for values, _ in found if len(values)]
    if not ends:
        return None
    high = max(1.03 * max(ends), low + 0.1)
    lines = [line for _, line in found if len(line.x)]
    return line_chart(lines, Axis(label, low, high), PERCENT, f"Distribution of {label}")
