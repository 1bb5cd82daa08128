# SPDX-License-Identifier: Apache-2.0
"""Ages of messages by clocks that do not agree."""

from __future__ import annotations

import math

import pytest

from pm01_nav.deploy.freshness import Arrival, RobotClock, Stream


def test_age_counts_from_the_quickest_message():
    stream = Stream()
    # The robot's clock is 100 s ahead. Messages take 0.02, 0.01 and 0.31 s.
    assert stream.accept(100.00, 0.02) is Arrival.NEW
    assert stream.accept(100.10, 0.11) is Arrival.NEW
    assert stream.accept(100.20, 0.51) is Arrival.NEW
    # Taken 0.3 s later than it could have come, had it been as quick as the second. The clocks may
    # have run apart by 0.1 % of 0.4 s meanwhile.
    assert stream.age(0.51) == pytest.approx(0.30, abs=0.001)
    assert stream.age(1.00) == pytest.approx(0.79, abs=0.001)


def test_without_a_message_the_age_is_infinite():
    assert Stream().age(5.0) == math.inf


@pytest.mark.parametrize("stamp", [10.0, 9.5, math.nan, math.inf])
def test_a_repeated_overtaken_or_unusable_stamp_does_not_refresh(stamp):
    stream = Stream()
    stream.accept(10.0, 0.0)
    assert stream.accept(stamp, 0.4) is Arrival.OLD
    assert stream.age(0.4) == pytest.approx(0.4)


@pytest.mark.parametrize("stamp", [8.0, 12.0])
def test_a_clock_that_jumps_is_noticed_and_followed(stamp):
    stream = Stream(jump_s=1.0)
    stream.accept(10.0, 0.0)
    assert stream.accept(stamp, 0.1) is Arrival.JUMP
    assert stream.age(0.2) == pytest.approx(0.1)
    assert stream.accept(stamp + 0.1, 0.2) is Arrival.NEW


def test_a_clock_that_drifts_by_100_ppm_for_an_hour_makes_nothing_stale():
    stream = Stream()
    for step in range(36_000):
        now = 0.1 * step
        stream.accept(now * (1.0 - 1e-4), now)
    # Without allowing for drift the newest would look 0.36 s old.
    assert stream.age(3599.9) < 0.01


def test_by_one_clock_a_message_is_as_old_as_its_stamp():
    stream = Stream(RobotClock(same_clock=True))
    assert stream.accept(10.0, 10.2) is Arrival.NEW
    assert stream.age(10.3) == pytest.approx(0.3)
    # A stamp of the near future is one that came before the clock's own message.
    assert stream.accept(10.4, 10.35) is Arrival.NEW
    assert stream.age(10.4) == pytest.approx(0.0)
    assert stream.accept(12.0, 10.5) is Arrival.JUMP


def test_topics_of_one_clock_share_what_is_known_of_it():
    clock = RobotClock()
    scans, odometries = Stream(clock), Stream(clock)
    # The robot's clock is 100 s ahead. Odometry takes 0.01 s, a scan always 0.81 s.
    scans.accept(100.0, 0.81)
    assert scans.age(0.81) == pytest.approx(0.0)
    for step in range(50):
        now = 0.82 + 0.1 * step
        odometries.accept(100.0 + now - 0.01, now)
        scans.accept(100.0 + now - 0.81, now)
        assert scans.age(now) == pytest.approx(0.80, abs=0.001)
        assert odometries.age(now) == pytest.approx(0.0, abs=0.001)


def test_after_a_jump_the_clock_is_measured_anew():
    clock = RobotClock()
    scans, odometries = Stream(clock), Stream(clock)
    odometries.accept(100.0, 0.0)
    scans.accept(100.0, 0.1)
    # It is set back by five seconds: whichever topic notices first tells how far it is now.
    assert odometries.accept(95.1, 0.1) is Arrival.JUMP
    assert odometries.age(0.1) == pytest.approx(0.0)
    assert scans.accept(95.1, 0.2) is Arrival.JUMP
    assert scans.age(0.2) == pytest.approx(0.0)
