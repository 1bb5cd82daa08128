# SPDX-License-Identifier: Apache-2.0
"""Drive the episodes of a benchmark on other machines.

A piece of work carries the policy's file; worlds that come from files must lie at the same place
everywhere.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pm01_nav.benchmark.job import Job, Worker
from pm01_nav.benchmark.store import Part, ResultsFolder, read_part
from pm01_nav.errors import InputError
from pm01_nav.executors import Executor
from pm01_nav.provenance import provenance


@dataclass(frozen=True)
class Piece:
    """Episodes for a machine that has the code and nothing else."""

    job: Job
    policy: bytes | None
    """The policy's file; a planner needs none."""
    command: str
    """What the user typed."""


def drive_on(executor: Executor, folder: ResultsFolder, jobs: Sequence[Job]) -> Iterator[Job]:
    """Do jobs of episodes on other machines, write what comes back; yield each job when it is done.

    Raises:
        InputError: a job could not be done.
    """
    command = provenance()["command"]
    pieces = [Piece(job, _content(job), command) for job in jobs]
    for done in executor.run(drive, pieces):
        if done.error is not None:
            raise InputError(done.error)
        folder.save(done.result)
        yield jobs[done.index]


def drive(piece: Piece) -> Part:
    """Drive the episodes of a piece on the machine that this runs on.

    Raises:
        InputError: worlds or policy cannot be had.
    """
    import numba

    # As in a benchmark on one machine: a piece is for one core.
    numba.set_num_threads(1)
    job = piece.job
    with tempfile.TemporaryDirectory(prefix="pm01_benchmark_") as name:
        entry = job.entry
        if piece.policy is not None:
            file = Path(name) / "policy.onnx"
            file.write_bytes(piece.policy)
            entry = replace(entry, source=str(file))
        folder = ResultsFolder(Path(name))
        Worker(folder, provenance() | {"command": piece.command}).do(replace(job, entry=entry))
        part = read_part(folder.part_file(job.suite.name, entry.name, job.first))
    return Part(part.header | {"about_entry": job.entry.describe()}, part.results)


def _content(job: Job) -> bytes | None:
    return Path(job.entry.source).read_bytes() if job.entry.kind == "policy" else None
