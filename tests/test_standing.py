# SPDX-License-Identifier: Apache-2.0
"""Workers that stay: what they remember, and what becomes of those that are lost."""

from __future__ import annotations

import os
import signal

import pytest

from pm01_nav.errors import InputError
from pm01_nav.standing import LocalHost, StandingWorkers

_seen: list[int] = []


def remember(number: int) -> tuple[int, list[int]]:
    """Return the process and all numbers that it was given so far."""
    _seen.append(number)
    return os.getpid(), list(_seen)


def refuse(number: int) -> None:
    raise InputError(f"number = {number}: not this one")


def die(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_of_even(number: int) -> int:
    if number % 2 == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_each_worker_has_its_own_pieces_and_keeps_what_it_knows():
    with StandingWorkers(LocalHost(), 2) as workers:
        assert workers.fresh == [True, True]
        first = workers.run(remember, [1, 2], lambda i: -i)
        second = workers.run(remember, [3, 4], lambda i: -i)
        assert workers.fresh == [False, False]
    assert [seen for _, seen in first] == [[1], [2]]
    assert [seen for _, seen in second] == [[1, 3], [2, 4]]
    assert [pid for pid, _ in first] == [pid for pid, _ in second]
    assert os.getpid() not in {pid for pid, _ in first}


def test_lost_worker_is_replaced_and_its_piece_done_anew():
    with StandingWorkers(LocalHost(), 2) as workers:
        assert workers.run(die_of_even, [1, 2], lambda i: 10 * i + 1) == [1, 11]
        assert workers.replaced == 1


def test_piece_that_fails_or_kills_is_said():
    with StandingWorkers(LocalHost(), 1) as workers:
        with pytest.raises(InputError, match="number = 7: not this one"):
            workers.run(refuse, [7], lambda i: 7)
        with pytest.raises(InputError, match=r"worker 0: was lost 4 times"):
            workers.run(die, [7], lambda i: 7)
