# SPDX-License-Identifier: Apache-2.0
"""The scan that belongs to a step: waited for by its stamp, with a limit."""

from __future__ import annotations

import threading
import time

import pytest

from pm01_nav.backends.gazebo.messages import SilentError, StampedStream

SECOND = 1_000_000_000


@pytest.fixture
def stream() -> StampedStream:
    """Return a stream whose messages are stamps."""
    return StampedStream("/scan", lambda stamp: (stamp, f"scan of {stamp}"))


def test_an_old_scan_is_not_taken_for_the_new_one(stream: StampedStream) -> None:
    stream.put(9 * SECOND // 10)
    with pytest.raises(SilentError, match=r"/scan: no message of 1\.000 s .*newest is of 0\.900 s"):
        stream.wait(SECOND, 0.01)


def test_waits_for_a_late_scan(stream: StampedStream) -> None:
    stream.put(SECOND // 2)
    late = threading.Timer(0.05, stream.put, (SECOND,))
    late.start()
    began = time.monotonic()
    assert stream.wait(SECOND, 5.0) == f"scan of {SECOND}"
    assert 0.03 < time.monotonic() - began < 4.0


def test_the_newest_is_returned_again_until_there_is_a_newer_one(stream: StampedStream) -> None:
    for stamp in (100, 120, 140):
        stream.put(stamp)
    assert stream.wait(110, 0.01) == "scan of 140"
    assert stream.latest(140) == "scan of 140"
    assert stream.latest(141) is None


def test_nothing_is_left_after_a_reset(stream: StampedStream) -> None:
    stream.put(5 * SECOND)
    stream.clear()
    with pytest.raises(SilentError, match="none at all came"):
        stream.wait(0, 0.01)


def test_messages_that_nobody_asks_for_are_not_read() -> None:
    read = []
    stream = StampedStream("/odom", lambda stamp: (read.append(stamp), (stamp, stamp))[1])
    for stamp in range(1000):
        stream.put(stamp)
    assert stream.latest(0) == 999
    assert read == [999]


def test_a_recorded_drive_gives_each_step_its_own_scan(stream: StampedStream) -> None:
    # Ten scans a second, each a few milliseconds late; and the reset loses none of the later ones.
    def play() -> None:
        for k in range(1, 11):
            time.sleep(0.003)
            stream.put(k * SECOND // 10)

    player = threading.Thread(target=play)
    player.start()
    for k in range(1, 11):
        stamp = k * SECOND // 10
        # Never an older one; a newer one only if the player is ahead.
        assert int(stream.wait(stamp, 5.0).rsplit(" ", 1)[1]) >= stamp
    player.join()
