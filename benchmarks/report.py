# SPDX-License-Identifier: Apache-2.0
"""Write a measurement as JSON, with the command, the machine and the versions that made it."""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pm01_nav.config import write_atomically
from pm01_nav.provenance import provenance, shown_command


def write_report(path: str, results: dict[str, Any]) -> None:
    """Write ``results`` and where they come from to ``path``."""
    origin = provenance() | {"command": shown_command("python", sys.argv)}
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, json.dumps(results | origin, indent=2) + "\n")
    print(json.dumps(results, indent=2))


def rate(function: Callable[[], None], units: int, seconds: float, repeats: int) -> dict[str, Any]:
    """Call ``function`` over and over; return units a second: median and all repeats."""
    function()
    rates = []
    for _ in range(repeats):
        calls, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            function()
            calls += 1
        rates.append(calls * units / (time.perf_counter() - began))
    return {"median": round(statistics.median(rates)), "repeats": [round(r) for r in rates]}
