# SPDX-License-Identifier: Apache-2.0
"""The report's tables: who is best, all figures of a suite, and pairs of entries."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

from pm01_nav.report.figures import FIGURES, Cell, cell, columns_of, number, span

Data = dict[str, Any]
"""What ``benchmark.tables.write_tables`` writes into results.json."""
Mark = Literal["best", "equal", ""]


def fixed_suites(data: Data) -> list[str]:
    """Return the suites that no sweep varies."""
    return [name for name, about in data["suites"].items() if not about["sweep"]]


def ordered_entries(data: Data) -> list[str]:
    """Return the entries, the one with the highest mean success first."""
    rates: dict[str, list[float]] = {name: [] for name in data["entries"]}
    fixed = set(fixed_suites(data))
    for summary in data["results"]:
        if summary["suite"] in fixed or not fixed:
            rates[summary["entry"]].append(summary["success_rate"])

    def key(name: str) -> tuple[float, str]:
        return -sum(rates[name]) / max(len(rates[name]), 1), name

    return sorted(rates, key=key)


def summaries_on(data: Data, suite: str, entries: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the summaries of those entries that drove on a suite, in the entries' order."""
    found = {s["entry"]: s for s in data["results"] if s["suite"] == suite}
    return {name: found[name] for name in entries if name in found}


def overview(data: Data, entries: Sequence[str]) -> dict[str, Any]:
    """Return success of every entry (row) on every suite that no sweep varies (column)."""
    suites = fixed_suites(data)
    columns = [_success_column(data, suite, entries) for suite in suites]
    rows = [
        {"entry": name, "cells": [column.get(name) for column in columns]}
        for name in entries
        if any(name in column for column in columns)
    ]
    return {"suites": suites, "rows": rows}


def _success_column(data: Data, suite: str, entries: Sequence[str]) -> dict[str, dict[str, Any]]:
    summaries = summaries_on(data, suite, entries)
    marks = _marks(data, suite, summaries)
    return {
        name: {"cell": cell(summary, FIGURES[0]), "mark": marks[name]}
        for name, summary in summaries.items()
    }


def _marks(data: Data, suite: str, summaries: dict[str, dict[str, Any]]) -> dict[str, Mark]:
    """Tell who is best on a suite, and who is not told apart from the best by its interval."""
    if len(summaries) < 2:
        return dict.fromkeys(summaries, "")
    top = max(summary["success_rate"] for summary in summaries.values())
    best = next(name for name, s in summaries.items() if s["success_rate"] == top)
    marks: dict[str, Mark] = {}
    pairs = _pairs(data, suite)
    for name, summary in summaries.items():
        pair = pairs.get((best, name))
        alike = pair is not None and not pair["significant"]
        marks[name] = "best" if summary["success_rate"] == top else "equal" if alike else ""
    return marks


def figures_table(data: Data, suite: str, entries: Sequence[str]) -> dict[str, Any]:
    """Return all figures (columns) of every entry (row) on a suite."""
    summaries = summaries_on(data, suite, entries)
    columns = columns_of(list(summaries.values()))
    rows = [
        {"entry": name, "cells": [cell(summary, figure) for figure in columns]}
        for name, summary in summaries.items()
    ]
    counts = sorted({summary["episodes"] for summary in summaries.values()})
    episodes = " to ".join(f"{count}" for count in dict.fromkeys([counts[0], counts[-1]]))
    return {
        "columns": columns,
        "rows": rows,
        "episodes": episodes,
        "failures": _failures(summaries),
    }


def _failures(summaries: dict[str, dict[str, Any]]) -> list[tuple[str, str, int]]:
    """Return why policies failed: entry, reason and how often."""
    return [
        (name, reason, count)
        for name, summary in summaries.items()
        for reason, count in summary.get("failures", {}).items()
    ]


def pairs_table(data: Data, suite: str, entries: Sequence[str]) -> list[dict[str, Any]]:
    """Return how much better each entry (row) is than each other (column) on a suite.

    Cells are ``None`` on the diagonal; there is no table of fewer than two entries.
    """
    names = list(summaries_on(data, suite, entries))
    if len(names) < 2:
        return []
    pairs = _pairs(data, suite)
    return [
        {"entry": first, "cells": [_pair_cell(pairs.get((first, second))) for second in names]}
        for first in names
    ]


def _pair_cell(pair: dict[str, Any] | None) -> dict[str, Any] | None:
    if pair is None:
        return None
    low, high = pair["success_ci95"]
    verdict = "better" if low > 0.0 else "worse" if high < 0.0 else "alike"
    time = ""
    if pair["time_ci95_s"] is not None:
        slower = number(pair["time_difference_s"], 1, sign=True)
        time = f"time to goal {slower} s ({span(pair['time_ci95_s'], 1, sign=True)} s)"
    text = number(100.0 * pair["success_difference"], 1, sign=True)
    interval = span(pair["success_ci95"], 1, 100.0, sign=True)
    return {"cell": Cell(text, None, interval), "verdict": verdict, "time": time}


def _pairs(data: Data, suite: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Return a suite's comparisons by their two entries, in both directions."""
    found = {}
    for pair in data["comparisons"]:
        if pair["suite"] == suite:
            found[pair["first"], pair["second"]] = pair
            found[pair["second"], pair["first"]] = _turned(pair)
    return found


def _turned(pair: dict[str, Any]) -> dict[str, Any]:
    """Return a comparison as seen from its second entry."""
    turned = pair | {"success_difference": -pair["success_difference"]}
    turned["success_ci95"] = _negated(pair["success_ci95"])
    if pair["time_ci95_s"] is not None:
        turned["time_difference_s"] = -pair["time_difference_s"]
        turned["time_ci95_s"] = _negated(pair["time_ci95_s"])
    return turned


def _negated(interval: Iterable[float]) -> tuple[float, float]:
    low, high = interval
    return -high, -low
