# SPDX-License-Identifier: Apache-2.0
"""The scan that belongs to a step: waited for by its stamp, with a limit."""

from __future__ import annotations

import threading
import time

import pytest

from pm01_nav.backends.gazebo_stream import KEPT, SilentError, StampedStream

SECOND = 1_000_000_000


def test_an_old_scan_is_not_taken_for_the_new_one() -> None:
    stream = StampedStream("/scan")
    stream.put(9 * SECOND // 10, "before")
    with pytest.raises(SilentError, match=r"/scan: no message of 1\.000 s .*newest is of 0\.900 s"):
        stream.wait(SECOND, 0.01)


def test_waits_for_a_late_scan() -> None:
    stream = StampedStream("/scan")
    late = threading.Timer(0.05, stream.put, (SECOND, "now"))
    late.start()
    began = time.monotonic()
    assert stream.wait(SECOND, 5.0) == "now"
    assert 0.03 < time.monotonic() - began < 4.0


def test_the_newest_wins_whatever_order_messages_come_in() -> None:
    stream = StampedStream("/odom")
    for stamp in (100, 140, 120):
        stream.put(stamp, stamp)
    assert stream.wait(110, 0.01) == 140
    assert stream.latest(140) == 140
    assert stream.latest(141) is None


def test_nothing_is_left_after_a_reset() -> None:
    stream = StampedStream("/scan")
    stream.put(5 * SECOND, "last episode")
    stream.clear()
    with pytest.raises(SilentError, match="none at all came"):
        stream.wait(0, 0.01)


def test_a_topic_that_nobody_reads_does_not_grow() -> None:
    stream = StampedStream("/odom")
    for stamp in range(10 * KEPT):
        stream.put(stamp, stamp)
    assert stream.latest(0) == 10 * KEPT - 1
    assert len(stream._messages) == KEPT
