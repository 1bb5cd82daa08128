# SPDX-License-Identifier: Apache-2.0
"""How large a report is, how long it takes to write, and to open in a browser.

python benchmarks/report_size.py --results results/x --out benchmarks/results/report_size.json

Entries and suites of a real results folder are copied under other names until there are ten and
five. Opening is from the navigation to the first replay drawn; it needs playwright and Chromium.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

from report import write_report as write_measurement

from pm01_nav.benchmark.merge import Merged, merge_results
from pm01_nav.benchmark.store import Part, ResultsFolder
from pm01_nav.errors import InputError
from pm01_nav.report.build import write_report

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
PATIENCE = 30.0
"""Seconds to wait for a page."""


def enlarge(source: Path, target: Path, entries: int, suites: int) -> None:
    """Copy results until there are so many ``entries`` on so many ``suites``."""
    merged = merge_results([source])
    names = [name for name, about in merged.suites.items() if not about["sweep"]]
    for k, n in product(range(suites), range(entries)):
        suite = names[k % len(names)]
        driven = [score.entry for score in merged.scores if score.suite == suite]
        new_suite = suite if k < len(names) else f"{suite}-{k // len(names)}"
        new_entry = f"{driven[n % len(driven)]}-{n // len(driven)}"
        copy_score(merged, (suite, driven[n % len(driven)]), target, (new_suite, new_entry))


def copy_score(merged: Merged, old: tuple[str, str], target: Path, new: tuple[str, str]) -> None:
    """Copy an entry's parts, computing times and traces under another suite's and entry's name."""
    score = merged.find(*old)
    assert score is not None
    source, there = score.folder, ResultsFolder(target)
    for _, part in source.parts(*old):
        about = part.header["about_entry"] | {"name": new[1]}
        names = {"suite": new[0], "entry": new[1], "about_entry": about}
        there.save(Part(part.header | names, part.results))
    if source.timing_file(*old).is_file():
        there.timing_file(*new).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source.timing_file(*old), there.timing_file(*new))
    for episode, _ in source.traces(*old):
        there.trace_file(*new, episode).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source.trace_file(*old, episode), there.trace_file(*new, episode))


def opening(page: Path, repeats: int) -> dict[str, Any] | str:
    """Return the seconds from the navigation to the first replay drawn, or why there are none."""
    try:
        from playwright.sync_api import sync_playwright  # pyright: ignore[reportMissingImports]
    except ImportError:
        return "not measured: needs playwright"
    with sync_playwright() as playwright:
        own = playwright.chromium.executable_path
        path = own if Path(own).exists() else next(filter(None, map(shutil.which, BROWSERS)), None)
        if path is None:
            return "not measured: needs Chromium"
        browser = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        times = [seconds_to_replay(browser, page) for _ in range(repeats)]
        version = browser.version
        browser.close()
    median = round(statistics.median(times), 3)
    return {"median": median, "repeats": [round(t, 3) for t in times], "chromium": version}


def seconds_to_replay(browser: Any, path: Path) -> float:
    """Open the page at its first replay, in a context without a cache."""
    key = path.read_text(encoding="utf-8").partition('data-key="')[2].partition('"')[0]
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.goto(f"{path.as_uri()}#{key}")
    began = time.perf_counter()
    drawn = "window.pm01Player && window.pm01Player.firstDrawn"
    while not (milliseconds := page.evaluate(drawn)):
        if time.perf_counter() - began > PATIENCE:
            raise InputError(f"{path}: no replay was drawn")
        page.wait_for_timeout(10)
    context.close()
    return milliseconds / 1e3


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", required=True, type=Path, help="a folder of pm01 benchmark")
    parser.add_argument("--entries", type=int, default=10)
    parser.add_argument("--suites", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--keep", help="where to keep the report")
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "enlarged"
        enlarge(arguments.results, folder, arguments.entries, arguments.suites)
        began = time.perf_counter()
        page = write_report([folder])
        seconds = time.perf_counter() - began
        results = {
            "entries": arguments.entries,
            "suites": arguments.suites,
            "episodes": sum(len(score.episode) for score in merge_results([folder]).scores),
            "replays": len(list(folder.glob("replays/*/*/*.npz"))),
            "bytes": page.stat().st_size,
            "seconds_to_write": round(seconds, 2),
            "seconds_to_first_replay": opening(page.resolve(), arguments.repeats),
        }
        if arguments.keep:
            shutil.copy(page, arguments.keep)
    write_measurement(arguments.out, results)


if __name__ == "__main__":
    main()
