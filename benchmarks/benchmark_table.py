# SPDX-License-Identifier: Apache-2.0
"""Write the results of `pm01 benchmark` as Markdown, with the published BARN figures beside ours.

python benchmarks/benchmark_table.py results/x/results.json --out benchmarks/results/benchmark.md
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import yaml

from pm01_nav.config import write_atomically

PUBLISHED = Path(__file__).with_name("barn_published.yaml")
Results = dict[str, Any]
COLUMNS = (
    ("SPL", "spl", "{:.2f}"),
    ("time to goal [s]", "time_to_goal_s", "{:.1f}"),
    ("path [m]", "path_length_m", "{:.2f}"),
    ("least clearance [m]", "min_clearance_m", "{:.2f}"),
    ("jerk [m/s³]", "mean_jerk", "{:.2f}"),
    ("turns to the other side [1/min]", "turn_reversals_per_min", "{:.1f}"),
    ("close to pedestrians", "personal_space_intrusion", "{:.2f}"),
    ("computing, median [ms]", "compute_ms_median", "{:.2f}"),
    ("computing, 99 % [ms]", "compute_ms_p99", "{:.2f}"),
    ("score 2024", "barn_score_2024", "{:.3f}"),
    ("score 2022", "barn_score_2022", "{:.3f}"),
    ("OT/AT", "barn_optimal_over_actual_time", "{:.2f}"),
    ("as DynaBARN publishes it", "dynabarn_score_as_published", "{:.3f}"),
)


def table(header: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table; all columns but the first are aligned to the right."""
    rule = ["---", *("---:" for _ in header[1:])]
    return "".join(f"| {' | '.join(row)} |\n" for row in [header, rule, *rows])


def success(result: Results) -> str:
    """Return the rate of success and its interval, in percent."""
    low, high = result["success_rate_ci95"]
    return f"{100 * result['success_rate']:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def short_form(results: list[Results], suites: list[str]) -> str:
    """Return success in percent of every entry (row) on every suite (column)."""
    found = {(r["entry"], r["suite"]): r for r in results}
    best = {
        suite: max(r["success_rate"] for r in results if r["suite"] == suite) for suite in suites
    }
    rows = []
    for entry in dict.fromkeys(r["entry"] for r in results):
        row = [f"`{entry}`"]
        for suite in suites:
            result = found.get((entry, suite))
            rate = f"{100 * result['success_rate']:.1f}" if result else "-"
            row.append(f"**{rate}**" if result and result["success_rate"] == best[suite] else rate)
        if set(row[1:]) != {"-"}:
            rows.append(row)
    return table(["", *(f"`{suite}`" for suite in suites)], rows)


def suite_table(results: list[Results]) -> str:
    """Return all figures of one suite, one row an entry."""
    used = [c for c in COLUMNS if any(r.get(c[1]) is not None for r in results)]
    rows = [
        [
            f"`{r['entry']}`",
            str(r["episodes"]),
            success(r),
            f"{100 * r['collision_rate']:.1f}",
            f"{100 * r['timeout_rate']:.1f}",
            *("-" if r.get(key) is None else form.format(r[key]) for _, key, form in used),
        ]
        for r in sorted(results, key=lambda r: -r["success_rate"])
    ]
    header = ["", "episodes", "success %", "collision %", "time-out %", *(c[0] for c in used)]
    return table(header, rows)


def sweep_table(results: list[Results], points: dict[str, Results]) -> str:
    """Return success in percent of every entry along one sweep."""
    names = sorted(points, key=lambda name: points[name]["value"])
    found = {(r["entry"], r["suite"]): r for r in results}
    entries = dict.fromkeys(r["entry"] for r in results if r["suite"] in points)
    rows = [
        [f"`{e}`", *(success(found[e, n]) if (e, n) in found else "-" for n in names)]
        for e in entries
    ]
    label = next(iter(points.values()))["label"]
    return table([label, *(f"{points[name]['value']:g}" for name in names)], rows)


def published_table() -> str:
    """Return what others have published on BARN."""
    rows = []
    for row in yaml.safe_load(PUBLISHED.read_text(encoding="utf-8")):
        rates = [row.get(key) for key in ("success", "collision", "timeout")]
        figures = ["-" if rate is None else f"{100 * rate:.1f}" for rate in rates]
        scores = [str(row.get(key, "-")) for key in ("time_s", "score_2022", "score_2024")]
        method, origin = f"{row['method']} ({row['year']})", [row["evidence"], row["source"]]
        rows.append([method, row["worlds"], *figures, *scores, *origin])
    header = ["method", "worlds", "success %", "collision %", "time-out %", "time [s]"]
    return table([*header, "score 2022", "score 2024", "evidence", "source"], rows)


def origins(data: Results) -> str:
    """Return the commands, and the machines and revisions that they ran on."""
    commands = dict.fromkeys(origin["command"] for origin in data["origins"])
    machines = dict.fromkeys(
        f"{o['machine']['processor']}, {o['machine']['cores']} cores, revision {o['git_revision']}"
        for o in data["origins"]
    )
    return "```bash\n" + "\n".join(commands) + "\n```\n\n" + "\n".join(f"- {m}" for m in machines)


def document(data: Results) -> str:
    """Return the whole document."""
    suites, results = data["suites"], data["results"]
    plain = [name for name, about in suites.items() if not about["sweep"]]
    parts = ["# Benchmark\n", "Made by `benchmarks/benchmark_table.py` from the results of:\n"]
    parts += [origins(data) + "\n", "## Success %\n", short_form(results, plain)]
    for name in plain:
        about = suites[name]
        parts.append(f"## {name}\n")
        parts.append(
            f"Robot {about['robot']}, seed {about['seed']}, hash `{about['hash'][:12]}`.\n"
        )
        parts.append(suite_table([r for r in results if r["suite"] == name]))
    sweeps = dict.fromkeys(about["sweep"]["sweep"] for about in suites.values() if about["sweep"])
    for sweep in sweeps:
        points = {
            name: about["sweep"]
            for name, about in suites.items()
            if about["sweep"] and about["sweep"]["sweep"] == sweep
        }
        on = next(iter(points.values()))["suite"]
        parts += [f"## Sweep {sweep}, on {on}\n", sweep_table(results, points)]
    if any("barn_score_2024" in r for r in results):
        parts.append("## BARN as published, in Gazebo\n")
        parts.append("Ours are from the pm01 planar simulator and do not compare with these.\n")
        parts.append(published_table())
    return "\n".join(parts)


def main() -> None:
    """Read, format, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", help="the results.json of a results folder")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    data = json.loads(Path(options.results).read_text(encoding="utf-8"))
    write_atomically(options.out, document(data))


if __name__ == "__main__":
    main()
