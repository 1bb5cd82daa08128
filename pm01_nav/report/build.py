# SPDX-License-Identifier: Apache-2.0
"""Put a report together from results folders."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pm01_nav.benchmark.merge import Merged, Score, merge_results
from pm01_nav.benchmark.recorder import MAX_REASON
from pm01_nav.benchmark.tables import write_tables
from pm01_nav.benchmark.trace import Trace
from pm01_nav.config import check_output, make_folder, write_atomically
from pm01_nav.errors import InputError
from pm01_nav.report.charts import COLORS, line_style
from pm01_nav.report.origins import facts, warnings
from pm01_nav.report.plots import distributions, sweep_charts
from pm01_nav.report.replays import pack
from pm01_nav.report.tables import (
    Data,
    figures_table,
    fixed_suites,
    ordered_entries,
    overview,
    pairs_table,
    summaries_on,
)
from pm01_nav.report.thumbnails import thumbnail

TEMPLATES = Path(__file__).parent / "templates"
SCRIPTS = ("decode.js", "world.js", "scene.js", "series.js", "player.js", "page.js")
"""In the order in which they need each other."""
BADNESS = ("failure", "collision", "timeout", "success")


def write_report(paths: Sequence[str | Path], out: str | Path | None = None) -> Path:
    """Write the report of one or more results folders; return its path.

    Tables are written anew, into the folder if there is one, beside the report if there are more.

    Raises:
        InputError: a folder has no results, two do not belong together, or the report or the
            tables cannot be written.
    """
    merged = merge_results(paths)
    if not merged.scores:
        raise InputError(f"{paths[0]}: holds no results yet; `pm01 benchmark` makes some")
    out = Path(paths[0]) / "report.html" if out is None else Path(out)
    tables = Path(paths[0]) if len(paths) == 1 else out.parent
    make_folder(out.parent)
    make_folder(tables, "folder")
    check_output(out, "out")
    data = write_tables(merged, tables)
    write_atomically(out, render(merged, data, [Path(path).resolve().name for path in paths]))
    return out


def render(merged: Merged, data: Data, names: Sequence[str]) -> str:
    """Return the page; ``names`` are the folders', ``data`` is what results.json holds.

    Raises:
        InputError: a trace is damaged.
    """
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html").render(_content(merged, data, names))


def _content(merged: Merged, data: Data, names: Sequence[str]) -> dict[str, Any]:
    """Return all that the template shows."""
    entries = ordered_entries(data)
    sections = [_section(merged, data, suite, entries) for suite in fixed_suites(data)]
    sweeps = sweep_charts(data, entries)
    script = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in SCRIPTS)
    script = f'"use strict";\n(() => {{\n{script}\n}})();\n'
    return {
        "title": ", ".join(names),
        "written": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "facts": facts(merged, len(sections), len(sweeps)),
        "warnings": warnings(merged),
        "entries": [_entry(number, merged.entries[name]) for number, name in enumerate(entries)],
        "suites": merged.suites,
        "fixed": fixed_suites(data),
        "overview": overview(data, entries),
        "sweeps": sweeps,
        "swept": {row["entry"] for sweep in sweeps for row in sweep["rows"]},
        "sections": sections,
        "barn_note": _barn_note(data["results"]),
        "replays_data": [replay for section in sections for replay in section["packed"]],
        "style": (TEMPLATES / "report.css").read_text(encoding="utf-8"),
        "script": script,
        "script_hash": base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    }


def _barn_note(summaries: Iterable[dict[str, Any]]) -> str:
    """Say where these BARN scores are from; empty if there are none."""
    labels = [s["barn_evaluated_in"] for s in summaries if "barn_evaluated_in" in s]
    return "; ".join(dict.fromkeys(labels))


def _entry(number: int, about: dict[str, Any]) -> dict[str, Any]:
    return about | {"number": number, "color": number % COLORS, "style": line_style(number)}


def _section(merged: Merged, data: Data, suite: str, entries: Sequence[str]) -> dict[str, Any]:
    """Return what the page tells of one suite."""
    packed: list[dict[str, str]] = []
    replays = []
    for entry in summaries_on(data, suite, entries):
        score = merged.find(suite, entry)
        assert score is not None
        stored = sorted(_stored(score, packed), key=_rank)
        if stored:
            replays.append({"entry": entry, "episodes": stored})
    return {
        "name": suite,
        "about": merged.suites[suite],
        "table": figures_table(data, suite, entries),
        "barn_note": _barn_note(summaries_on(data, suite, entries).values()),
        "pairs": pairs_table(data, suite, entries),
        "charts": distributions(merged, suite, entries),
        "replays": replays,
        "packed": packed,
    }


def _stored(score: Score, packed: list[dict[str, str]]) -> Iterable[dict[str, Any]]:
    """Describe the episodes of which there is a trace; add the traces to ``packed``."""
    for episode, trace in score.folder.traces(score.suite, score.entry):
        key = "/".join(quote(part, safe="") for part in (score.suite, score.entry, str(episode)))
        try:
            content, described = pack(trace, score.suite, score.entry, episode), _describe(trace)
        except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
            file = score.folder.trace_file(score.suite, score.entry, episode)
            raise InputError(f"{file}: is not a readable trace") from error
        packed.append({"key": key, "content": content})
        yield {"key": key, "episode": episode} | described


def _describe(trace: Trace) -> dict[str, Any]:
    seconds = trace.about["control_dt"] * (len(trace.pose) - 1)
    return {
        "outcome": trace.about["outcome"] if trace.about["outcome"] in BADNESS else "failure",
        "reason": trace.about["reason"][:MAX_REASON],
        "seconds": seconds,
        "thumbnail": thumbnail(trace),
    }


def _rank(stored: dict[str, Any]) -> tuple[int, float, int]:
    """Sort the worst first; of one outcome the longest."""
    return BADNESS.index(stored["outcome"]), -stored["seconds"], stored["episode"]
