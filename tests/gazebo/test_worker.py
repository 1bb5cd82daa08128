# SPDX-License-Identifier: Apache-2.0
"""Which cores servers get."""

from __future__ import annotations

import os

import pytest

from pm01_nav.backends.gazebo.worker import cores_of


@pytest.fixture
def eight_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the machine have the cores 2 to 9."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(2, 10)), raising=False)


@pytest.mark.usefixtures("eight_cores")
def test_servers_share_half_of_the_cores() -> None:
    assert cores_of(0, 1) == {2, 3, 4, 5}
    assert [cores_of(k, 2) for k in range(2)] == [{2, 3}, {4, 5}]
    assert [cores_of(k, 4) for k in range(4)] == [{2}, {3}, {4}, {5}]


@pytest.mark.usefixtures("eight_cores")
def test_more_servers_than_cores_take_turns() -> None:
    used = [min(cores_of(k, 12)) for k in range(12)]
    assert used == [2, 3, 4, 5, 6, 7, 8, 9, 2, 3, 4, 5]


def test_without_a_say_in_it_the_system_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert cores_of(0, 1) == frozenset()
