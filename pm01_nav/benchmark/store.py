# SPDX-License-Identifier: Apache-2.0
"""A folder of benchmark results: many small files, each written whole or not at all.

Episodes are kept in parts of ``PART`` each, ``parts/SUITE/ENTRY/FIRST.npz``; who is killed loses
the parts that were not finished. ``timing/SUITE/ENTRY.json`` has computing times,
``replays/SUITE/ENTRY/EPISODE.npz`` traces. Nothing is pickled.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.benchmark.trace import Trace, load_trace
from pm01_nav.config import write_atomically
from pm01_nav.errors import InputError
from pm01_nav.worlds.barn import UNREADABLE

FORMAT = 1
PART = 125
"""Episodes of a full part."""


@dataclass(frozen=True)
class Part:
    """Consecutive episodes of one entry on one suite."""

    header: dict[str, Any]
    """``suite``, ``entry``, ``first``, ``about_suite`` (with its hash), ``about_entry`` (with its
    fingerprint), and where it comes from: command, revision, versions, machine."""
    results: EpisodeResults

    def __len__(self) -> int:
        """Return how many episodes there are."""
        return len(self.results.success)

    @property
    def first(self) -> int:
        """Number of its first episode."""
        return int(self.header["first"])


@dataclass(frozen=True)
class ResultsFolder:
    """Where the results of one or more runs lie."""

    path: Path

    def part_file(self, suite: str, entry: str, first: int) -> Path:
        """Return the file of a part."""
        return self.path / "parts" / suite / entry / f"{first:08d}.npz"

    def timing_file(self, suite: str, entry: str) -> Path:
        """Return the file of an entry's computing times on a suite."""
        return self.path / "timing" / suite / f"{entry}.json"

    def trace_file(self, suite: str, entry: str, episode: int) -> Path:
        """Return the file of a trace."""
        return self.path / "replays" / suite / entry / f"{episode:08d}.npz"

    def save(self, part: Part) -> None:
        """Write a part."""
        header = part.header
        content = io.BytesIO()
        text = json.dumps({"format": FORMAT} | header)
        arrays = vars(part.results)
        np.savez_compressed(content, allow_pickle=False, header=np.array(text), **arrays)
        file = self.part_file(header["suite"], header["entry"], part.first)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, content.getvalue())

    def save_timing(self, suite: str, entry: str, milliseconds: list[float]) -> None:
        """Write the computing time of each step that was measured [ms]."""
        file = self.timing_file(suite, entry)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, json.dumps({"step_ms": [round(ms, 4) for ms in milliseconds]}))

    def parts(self, suite: str = "*", entry: str = "*") -> Iterator[tuple[Path, Part]]:
        """Read every part, or those of one suite or entry, in the order of the names.

        Raises:
            InputError: a file is damaged, or not one of ours.
        """
        for file in sorted(self.path.glob(f"parts/{suite}/{entry}/*.npz")):
            yield file, read_part(file)

    def timing(self, suite: str, entry: str) -> NDArray[np.float64] | None:
        """Return the computing times that were measured [ms], if any."""
        file = self.timing_file(suite, entry)
        if not file.is_file():
            return None
        try:
            times = json.loads(file.read_text(encoding="utf-8"))["step_ms"]
            return np.asarray(times, dtype=np.float64).reshape(-1)
        except (*UNREADABLE, TypeError) as error:
            raise InputError(f"{file}: is not a readable file of computing times") from error

    def traces(self, suite: str, entry: str) -> Iterator[tuple[int, Trace]]:
        """Read the traces of an entry on a suite, with the episodes' numbers."""
        for file in sorted((self.path / "replays" / suite / entry).glob("*.npz")):
            yield int(file.stem), load_trace(file)


def read_part(file: Path) -> Part:
    """Read one part.

    Raises:
        InputError: the file is damaged, or not one of ours.
    """
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as entry:
            arrays = dict(entry)
        header = json.loads(str(arrays.pop("header")))
        found = header.pop("format")
        whole = _is_whole(header, arrays)
    except (*UNREADABLE, TypeError, AttributeError) as error:
        raise InputError(f"{file}: is no readable results file; remove it") from error
    if found != FORMAT or not whole:
        raise InputError(f"{file}: is a results file of another version (format {found!r})")
    return Part(header, EpisodeResults(**arrays))


def _is_whole(header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bool:
    """Tell whether nothing is missing and the arrays have a row for each episode."""
    names = {field.name for field in fields(EpisodeResults)}
    keys = {"suite", "entry", "first", "about_suite", "about_entry"}
    lengths = {len(array) for array in arrays.values()}
    return set(arrays) == names and len(lengths) == 1 and keys <= set(header)
