# SPDX-License-Identifier: Apache-2.0
"""Which parts of a drive tell of the base, and which do not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.base_model import Drive, FloatArray
from pm01_nav.deploy.base_problem import BoolArray, Problem, noise_of

BLOCK_S = 2.0
"""Errors further apart than this are taken for independent [s]."""
GAP_S = 1.0
"""After so long without a command most bases stop by themselves; the model does not [s]."""
SETTLE_S = 1.0
"""After a gap its speed is known again [s]."""
SPIKE = 8.0
"""A single error of so many standard deviations is odometry's."""
DEVIATES = 5.0
"""A block in which most errors are larger is something else than commands driving a base."""
GOES_ON = 0.8
"""So much of the silence must look like driving on."""
MOST_DEVIATING = 0.3
"""If more blocks deviate than this share, it is the model that is wrong: they stay."""


class Segment(NamedTuple):
    """A part of a drive that was left out."""

    drive: int
    begin: float
    """[s]"""
    end: float
    reason: str

    @classmethod
    def of(cls, drives: list[Drive], rows: BoolArray, reason: str) -> list[Segment]:
        """Return the segments that the rows (n,) of all drives form."""
        found, first = [], 0
        for number, drive in enumerate(drives):
            marked = np.concatenate([[False], rows[first : first + len(drive.times)], [False]])
            first += len(drive.times)
            edges = np.flatnonzero(np.diff(marked.astype(int)))
            for begin, end in zip(edges[::2], edges[1::2], strict=True):
                times = drive.times[begin], drive.times[end - 1]
                found.append(cls(number, float(times[0]), float(times[1]), reason))
        return found


def blocks(problem: Problem) -> NDArray[np.int64]:
    """Return for each odometry of all drives the number of its block, shape (n,)."""
    numbers, first = [], 0
    for drive in problem.drives:
        if len(drive.times):
            own = ((drive.times - drive.times[0]) / BLOCK_S).astype(int)
            numbers.append(first + own)
            first += int(own[-1]) + 1
    return np.concatenate(numbers)


def commands_known(drive: Drive) -> BoolArray:
    """Return for each odometry whether the base still heeded the last command, shape (m,)."""
    times = drive.command_times[1:]
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    longest = max(GAP_S, 5.0 * period)
    last = np.clip(np.searchsorted(times, drive.times, side="right") - 1, 0, None)
    moving = (drive.commands[1:] != 0.0).any(axis=1)
    known = ~((drive.times - times[last] > longest) & moving[last])
    # A command after a long silence finds a base that may have stopped.
    silent = np.flatnonzero((np.diff(times) > longest) & moving[:-1]) + 1
    for begin in times[silent]:
        known &= ~((drive.times >= begin) & (drive.times < begin + SETTLE_S))
    return known


def goes_on(problem: Problem, parameters: FloatArray) -> bool:
    """Return whether the base drives on where no command comes, as some do."""
    silent = ~problem.used
    if not silent.any():
        return False
    scaled = problem.scaled(noise_of(problem, parameters))
    size = np.abs(scaled.errors(parameters)).max(axis=1)
    return bool(np.quantile(size[silent], GOES_ON) < DEVIATES)


def spikes(problem: Problem, parameters: FloatArray) -> BoolArray:
    """Return which odometry is far out while its neighbours are not, shape (n,)."""
    scaled = problem.scaled(noise_of(problem, parameters))
    size = np.abs(scaled.errors(parameters)).max(axis=1)
    calm = size < 0.5 * SPIKE
    around = np.concatenate([[True], calm[:-1]]) & np.concatenate([calm[1:], [True]])
    return problem.used & (size > SPIKE) & around


def deviating(problem: Problem, parameters: FloatArray) -> BoolArray:
    """Return which odometry lies in blocks where the base did something else, shape (n,)."""
    scaled = problem.scaled(noise_of(problem, parameters))
    size = np.abs(scaled.errors(parameters)).max(axis=1)
    number = blocks(problem)
    strange = np.zeros(len(number), dtype=bool)
    used_blocks = np.unique(number[problem.used])
    bad = [b for b in used_blocks if np.median(size[(number == b) & problem.used]) > DEVIATES]
    if len(bad) <= MOST_DEVIATING * len(used_blocks):
        strange = np.isin(number, bad) & problem.used
    return strange
