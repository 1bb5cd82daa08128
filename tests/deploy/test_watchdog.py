# SPDX-License-Identifier: Apache-2.0
"""The watchdog speaks after silence, and only then."""

from __future__ import annotations

import threading
import time

from pm01_nav.deploy.watchdog import Guard, Turn, Watchdog


def test_it_speaks_after_silence_and_not_before():
    spoke = threading.Event()
    watchdog = Watchdog(spoke.set)
    watchdog.start()
    for _ in range(10):
        watchdog.feed()
        time.sleep(0.02)
    early = spoke.is_set()
    silent = time.monotonic()
    assert spoke.wait(5.0)
    waited = time.monotonic() - silent
    watchdog.end()
    # Fed 0.02 s before the silence began; looks come every 0.02 s.
    assert not early
    assert waited >= 0.1


def test_after_its_end_it_is_silent():
    calls = []
    watchdog = Watchdog(lambda: calls.append(1))
    watchdog.start()
    watchdog.feed()
    watchdog.end()
    time.sleep(0.3)
    assert calls == []


def test_a_stop_that_fails_is_tried_again():
    tries = []

    def stop() -> None:
        tries.append(1)
        raise ConnectionError("lost")

    watchdog = Watchdog(stop)
    watchdog.start()
    watchdog.feed()
    time.sleep(0.5)
    watchdog.end()
    # It looks every 0.02 s once 0.15 s are over.
    assert len(tries) > 1


def stops(guard: Guard, start: float, seconds: float) -> list[float]:
    """Return when a guard says stop, looked at every 0.01 s."""
    times = [start + 0.01 * k for k in range(round(seconds / 0.01))]
    return [now for now in times if guard.must_stop(now)]


def test_a_guard_guards_what_moves_and_stops_it_for_a_second():
    guard = Guard(0.15)
    assert stops(guard, 0.0, 5.0) == []
    guard.hear(True, 5.0)
    said = stops(guard, 5.0, 5.0)
    assert 5.15 <= said[0] <= 5.17
    assert 6.13 <= said[-1] <= 6.15
    # A stop needs nobody to guard it.
    guard.hear(True, 10.0)
    guard.hear(False, 10.1)
    assert stops(guard, 10.1, 5.0) == []


def test_a_clock_that_goes_back_is_a_silence():
    guard = Guard(0.15)
    guard.hear(True, 500.0)
    said = stops(guard, 3.0, 5.0)
    assert said[0] == 3.0
    assert said[-1] <= 4.0


def test_it_is_our_turn_on_the_way_and_for_a_second_after_it():
    turn = Turn(10.0)
    assert turn.is_ours(False, 10.9)
    assert not turn.is_ours(False, 11.1)
    assert turn.is_ours(True, 20.0)
    assert turn.is_ours(False, 20.9)
    assert not turn.is_ours(False, 21.1)
    # The clock went back: a stop for a second, not until it has caught up.
    assert turn.is_ours(False, 3.0)
    assert not turn.is_ours(False, 4.1)
