# SPDX-License-Identifier: Apache-2.0
"""The watchdog speaks after silence, and only then."""

from __future__ import annotations

import threading
import time

from pm01_nav.deploy.watchdog import Watchdog


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
    time.sleep(0.5)
    watchdog.end()
    # It looks every 0.02 s once 0.15 s are over.
    assert len(tries) > 1
