# SPDX-License-Identifier: Apache-2.0
"""How many inputs each reader saw, reported after the run."""

from __future__ import annotations

from collections import Counter

import pytest

SEEN = pytest.StashKey[Counter[tuple[str, str]]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[SEEN] = Counter()


@pytest.fixture(scope="session")
def seen(request: pytest.FixtureRequest) -> Counter[tuple[str, str]]:
    """Inputs by reader and outcome."""
    return request.config.stash[SEEN]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    counts = terminalreporter.config.stash.get(SEEN, Counter())
    readers = sorted({reader for reader, _ in counts})
    for reader in readers:
        worlds, refused = counts[reader, "world"], counts[reader, "refused"]
        line = f"{reader}: {worlds + refused} inputs, {worlds} worlds, {refused} refused"
        terminalreporter.write_line(f"fuzz: {line}")
