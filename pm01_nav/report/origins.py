# SPDX-License-Identifier: Apache-2.0
"""What was measured, when and by which code; what a reader should be warned of."""

from __future__ import annotations

from typing import Any

from pm01_nav.benchmark.merge import Merged

UNKNOWN = "unknown"
NARROW_SPACE = "\N{NARROW NO-BREAK SPACE}"


def facts(merged: Merged, suites: int, sweeps: int) -> dict[str, Any]:
    """Return how much there is and where it comes from, each thing once."""
    origins = merged.origins
    episodes = sum(len(score.episode) for score in merged.scores)
    counts = (
        _count(len(merged.entries), "entry", "entries"),
        _count(suites, "suite", "suites"),
        _count(sweeps, "sweep", "sweeps"),
        _count(episodes, "episode", "episodes"),
    )
    return {
        "counts": ", ".join(count for count in counts if count),
        "created": _period(merged.created),
        "revisions": _unique(origin["git_revision"] or UNKNOWN for origin in origins),
        "commands": _unique(origin["command"] or UNKNOWN for origin in origins),
        "machines": _unique(_machine(origin["machine"] or {}) for origin in origins),
        "versions": _unique(_versions(origin["versions"] or {}) for origin in origins),
    }


def warnings(merged: Merged) -> list[str]:
    """Return what stands in the way of trusting or repeating the results."""
    found = []
    revisions = _unique(origin["git_revision"] or UNKNOWN for origin in merged.origins)
    if len(revisions) > 1:
        found.append(f"Results of {len(revisions)} revisions of the code: {', '.join(revisions)}.")
    if any(revision.endswith("-dirty") for revision in revisions):
        found.append("The code had changes that are not committed (-dirty): not repeatable.")
    if UNKNOWN in revisions:
        found.append("The code's revision is not known for all results.")
    if len(_unique(_machine(origin["machine"] or {}) for origin in merged.origins)) > 1:
        found.append("Computing times come from different machines.")
    return found + _uneven(merged)


def _uneven(merged: Merged) -> list[str]:
    """Tell in one line on which suites entries have not driven equally many episodes."""
    found = []
    for suite in merged.suites:
        counts = sorted({len(s.episode) for s in merged.scores if s.suite == suite})
        if len(counts) > 1:
            found.append(f"{suite} {counts[0]} to {counts[-1]}")
    return [f"Entries differ in their number of episodes: {', '.join(found)}."] if found else []


def _count(number: int, one: str, many: str) -> str:
    """Return so many of them in words, empty for none."""
    return f"{number:,} {one if number == 1 else many}".replace(",", NARROW_SPACE) if number else ""


def _period(created: list[str]) -> str:
    """Return from which to which day results were made."""
    days = sorted({moment[:10] for moment in created})
    return " to ".join(dict.fromkeys([days[0], days[-1]])) if days else UNKNOWN


def _machine(machine: dict[str, Any]) -> str:
    keys = ("processor", "cores", "system")
    processor, cores, system = (machine.get(key, UNKNOWN) for key in keys)
    return f"{processor}, {cores} cores, {system}"


def _versions(versions: dict[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items()) or UNKNOWN


def _unique(values: Any) -> list[str]:
    return list(dict.fromkeys(values))
