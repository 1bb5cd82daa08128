# SPDX-License-Identifier: Apache-2.0
"""Put the parts of one or more results folders together; refuse what does not belong together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.benchmark.store import Part, ResultsFolder
from pm01_nav.errors import InputError

ORIGIN = ("command", "git_revision", "versions", "machine")
"""What is told of where a part comes from."""


@dataclass
class Score:
    """All that was measured of one entry on one suite."""

    suite: str
    entry: str
    episode: NDArray[np.int64]
    """Numbers of the episodes, rising."""
    results: EpisodeResults
    step_ms: NDArray[np.float64] | None
    """Computing times of single steps [ms], if they were measured."""
    folder: ResultsFolder
    """Where its traces are."""


@dataclass
class Merged:
    """What some results folders hold together."""

    suites: dict[str, dict[str, Any]] = field(default_factory=dict)
    """``Suite.describe`` of each."""
    entries: dict[str, dict[str, Any]] = field(default_factory=dict)
    """``Entry.describe`` of each."""
    origins: list[dict[str, Any]] = field(default_factory=list)
    """Where the parts come from, each origin once."""
    created: list[str] = field(default_factory=list)
    """When the parts were written (ISO 8601), as far as it is known."""
    scores: list[Score] = field(default_factory=list)

    def admit(self, source: str | Path, header: dict[str, Any]) -> None:
        """Take note of a part's suite, entry and origin.

        Raises:
            InputError: it is of another suite, or of another policy, than an earlier part that
                goes by the same name.
        """
        name, about = header["suite"], header["about_suite"]
        known = self.suites.setdefault(name, about)
        if known["hash"] != about["hash"]:
            raise InputError(
                f"{source}: cannot be merged: its suite {name} has the hash {about['hash'][:12]}, "
                f"that of the other results {known['hash'][:12]}: other worlds, rules or robot"
            )
        name, about = header["entry"], header["about_entry"]
        known = self.entries.setdefault(name, about)
        if known["fingerprint"] != about["fingerprint"]:
            raise InputError(
                f"{source}: cannot be merged: its {name} is not the {name} of the other results; "
                "give it another name (--policy NAME=FILE) or another folder"
            )
        origin = {key: header.get(key) for key in ORIGIN}
        if origin not in self.origins:
            self.origins.append(origin)
        if "created" in header:
            self.created.append(header["created"])

    def find(self, suite: str, entry: str) -> Score | None:
        """Return one entry's score on one suite, if there is one."""
        return next((s for s in self.scores if (s.suite, s.entry) == (suite, entry)), None)


def merge_results(paths: Iterable[str | Path]) -> Merged:
    """Read results folders; of episodes that several have, the larger part counts.

    Raises:
        InputError: one is no results folder, a file is damaged, or two do not belong together.
    """
    merged = Merged()
    groups: dict[tuple[str, str], dict[int, Part]] = {}
    homes: dict[tuple[str, str], ResultsFolder] = {}
    for path in paths:
        folder = ResultsFolder(Path(path))
        if not (folder.path / "parts").is_dir():
            raise InputError(f"{path}: holds no results; `pm01 benchmark --out {path}` makes some")
        for file, part in folder.parts():
            merged.admit(file, part.header)
            key = (part.header["suite"], part.header["entry"])
            rival = groups.setdefault(key, {}).get(part.first)
            if rival is None or len(rival) < len(part):
                groups[key][part.first] = part
            homes.setdefault(key, folder)
    merged.scores = [_score(*key, parts, homes[key]) for key, parts in groups.items()]
    return merged


def _score(suite: str, entry: str, parts: dict[int, Part], folder: ResultsFolder) -> Score:
    episode, results = merge_parts([parts[first] for first in sorted(parts)])
    return Score(suite, entry, episode, results, folder.timing(suite, entry), folder)


def merge_parts(ordered: Sequence[Part]) -> tuple[NDArray[np.int64], EpisodeResults]:
    """Return the numbers of the parts' episodes, rising, and their results."""
    episode = np.concatenate([part.first + np.arange(len(part)) for part in ordered])
    # Parts of another size may overlap.
    episode, rows = np.unique(episode, return_index=True)
    results = EpisodeResults(
        **{
            f.name: np.concatenate([getattr(part.results, f.name) for part in ordered])[rows]
            for f in fields(EpisodeResults)
        }
    )
    return episode, results
