# SPDX-License-Identifier: Apache-2.0
"""The choice of threads, with a clock and a number of threads that the test holds in its hand."""

from __future__ import annotations

import numba
import pytest

from pm01_nav.sim import threads
from pm01_nav.sim.threads import TRIALS, ThreadChoice


class FakeMachine:
    """A kernel that takes ``seconds[n]`` with n threads."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: dict[int, float]) -> None:
        self.seconds, self.now, self.used, self.active = seconds, 0.0, [], max(seconds)
        monkeypatch.setattr(numba, "get_num_threads", lambda: self.active)
        monkeypatch.setattr(numba, "set_num_threads", self.set_num_threads)
        monkeypatch.setattr(threads.time, "perf_counter", lambda: self.now)

    def set_num_threads(self, count: int) -> None:
        self.active = count

    def kernel(self, *arguments: object) -> None:
        self.used.append((self.active, arguments))
        self.now += self.seconds[self.active]


@pytest.mark.parametrize(
    ("one", "two", "chosen"),
    [(0.1, 0.2, 1), (1.0, 0.9, 1), (1.0, 0.55, 2), (1.29, 1.0, 1), (1.31, 1.0, 2)],
)
def test_more_threads_must_be_clearly_faster(
    monkeypatch: pytest.MonkeyPatch, one: float, two: float, chosen: int
) -> None:
    machine = FakeMachine(monkeypatch, {1: one, 2: two})
    choice = ThreadChoice()
    for k in range(2 * TRIALS + 3):
        choice(machine.kernel, k)
    # Each number is tried equally often, then the choice stands; every call reached the kernel.
    assert choice.threads == chosen
    assert [count for count, _ in machine.used[:4]] == [1, 2, 1, 2]
    assert [count for count, _ in machine.used[-3:]] == [chosen] * 3
    assert [arguments for _, arguments in machine.used] == [(k,) for k in range(2 * TRIALS + 3)]
    assert machine.active == 2


def test_one_slow_call_decides_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = FakeMachine(monkeypatch, {1: 1.0, 2: 30.0})  # The first call compiles, say.
    choice = ThreadChoice()
    choice(machine.kernel)
    choice(machine.kernel)
    machine.seconds = {1: 1.0, 2: 0.5}
    for _ in range(2 * TRIALS):
        choice(machine.kernel)
    assert choice.threads == 2


def test_threads_are_given_back_after_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = FakeMachine(monkeypatch, {1: 1.0, 2: 1.0})

    def fail() -> None:
        raise ValueError("out of reach")

    with pytest.raises(ValueError, match="out of reach"):
        ThreadChoice()(fail)
    assert machine.active == 2
