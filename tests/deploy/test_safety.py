# SPDX-License-Identifier: Apache-2.0
"""The supervisor: each reason to stop, the way ahead, and that nothing unsafe gets by."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.deploy import motion_check, safety, scan_check
from pm01_nav.deploy.freshness import Stream
from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.safety import Reason, SafetyConfig, SafetySupervisor
from pm01_nav.deploy.scan_check import ScanCheck
from pm01_nav.errors import InputError

DT = 0.1


@pytest.fixture
def supervisor(robot):
    return SafetySupervisor(robot, DT, SafetyConfig())


@pytest.fixture
def fresh(supervisor, make_scan, make_odometry):
    """A supervisor that has just seen free space, standing still, at 10 s."""
    supervisor.see_odometry(make_odometry(10.0), 10.0)
    supervisor.see_scan(make_scan(10.0), 10.0)
    return supervisor


def test_what_is_safe_goes_through(fresh):
    # 2 m/s^2 and 8 rad/s^2 allow 0.2 m/s and 0.8 rad/s in the first step.
    verdict = fresh.supervise((0.15, -0.5), 10.0)
    assert verdict.command == (0.15, -0.5)
    assert verdict.reasons == ()


def test_speed_and_acceleration_are_limited(fresh, make_scan, make_odometry):
    commands = []
    for step in range(4):
        now = 10.0 + DT * step
        fresh.see_odometry(make_odometry(now + 0.001), now)
        fresh.see_scan(make_scan(now + 0.001), now)
        commands.append(fresh.supervise((9.0, -9.0), now).command)
    assert commands == [
        pytest.approx((0.2, -0.8)),
        pytest.approx((0.4, -1.5)),
        pytest.approx((0.5, -1.5)),
        pytest.approx((0.5, -1.5)),
    ]


@pytest.mark.parametrize(
    "proposed",
    [None, "left", (math.nan, 0.0), (0.0, math.inf), (0.1,), np.zeros((1, 2)), object()],
)
def test_a_policy_that_fails_stops_the_robot(fresh, proposed):
    verdict = fresh.supervise(proposed, 10.0)
    assert verdict.command == (0.0, 0.0)
    assert verdict.reasons == (Reason.POLICY_FAILED,)


def test_nothing_moves_before_the_first_messages(supervisor):
    verdict = supervisor.supervise((0.1, 0.0), 10.0)
    assert verdict.command == (0.0, 0.0)
    assert set(verdict.reasons) == {Reason.NO_SCAN, Reason.NO_ODOMETRY}


def test_a_stale_scan_stops_and_a_fresh_one_lets_go_on(fresh, make_scan, make_odometry):
    for step in range(1, 50):
        fresh.see_odometry(make_odometry(10.0 + 0.01 * step), 10.0 + 0.01 * step)
    assert fresh.supervise((0.1, 0.0), 10.49).reasons == ()
    assert fresh.supervise((0.1, 0.0), 10.52).reasons == (Reason.STALE_SCAN,)
    fresh.see_scan(make_scan(10.53), 10.53)
    assert fresh.supervise((0.04, 0.0), 10.55).command == (0.04, 0.0)


@pytest.mark.parametrize(
    ("scans_late", "odometry_late", "reasons"),
    [
        (0.8, 0.0, (Reason.STALE_SCAN,)),
        (0.3, 0.0, ()),
        (0.0, 0.5, (Reason.STALE_ODOMETRY,)),
        # What both have in common cannot be seen: the robot's clock may be behind as well.
        (0.8, 0.8, ()),
    ],
)
def test_a_constant_delay_shows_beside_the_other_topic(
    supervisor, make_scan, make_odometry, scans_late, odometry_late, reasons
):
    # The robot's clock is 1000 s ahead of ours, and both topics come ten times a second.
    for step in range(30):
        now = 10.0 + 0.1 * step
        supervisor.see_scan(make_scan(1000.0 + now - scans_late), now)
        supervisor.see_odometry(make_odometry(1000.0 + now - odometry_late), now)
        verdict = supervisor.supervise((0.1, 0.0), now)
    assert verdict.reasons == reasons
    assert (verdict.command == (0.0, 0.0)) == bool(reasons)


def test_a_repeated_scan_grows_stale(fresh, make_scan, make_odometry):
    for step in range(1, 7):
        now = 10.0 + 0.1 * step
        fresh.see_odometry(make_odometry(now), now)
        fresh.see_scan(make_scan(10.0), now)
    assert fresh.supervise((0.1, 0.0), 10.6).reasons == (Reason.STALE_SCAN,)


def test_stale_odometry_stops(fresh, make_scan):
    fresh.see_scan(make_scan(10.3), 10.3)
    assert fresh.supervise((0.1, 0.0), 10.31).reasons == (Reason.STALE_ODOMETRY,)


@pytest.mark.parametrize("ranges", [math.nan, -1.0])
def test_an_unusable_scan_stops(fresh, make_scan, ranges):
    fresh.see_scan(make_scan(10.05, ranges), 10.05)
    assert fresh.supervise((0.1, 0.0), 10.05).reasons == (Reason.INVALID_SCAN,)


@pytest.mark.parametrize(
    ("v", "pose"), [(math.nan, (0, 0, 0)), (0.0, (math.inf, 0, 0)), (5.0, (0, 0, 0))]
)
def test_odometry_that_cannot_be_stops(fresh, make_odometry, v, pose):
    fresh.see_odometry(make_odometry(10.05, v, pose=pose), 10.05)
    assert Reason.INVALID_ODOMETRY in fresh.supervise((0.1, 0.0), 10.05).reasons


def test_odometry_that_jumps_stops(fresh, make_odometry, make_scan):
    fresh.see_odometry(make_odometry(10.05, pose=(2.0, 0.0, 0.0)), 10.05)
    assert Reason.ODOMETRY_JUMP in fresh.supervise((0.1, 0.0), 10.05).reasons
    fresh.see_odometry(make_odometry(10.1, pose=(2.0, 0.0, 0.0)), 10.1)
    fresh.see_scan(make_scan(10.1), 10.1)
    assert fresh.supervise((0.1, 0.0), 10.1).reasons == ()


@pytest.mark.parametrize("stamp", [5.0, 15.0])
def test_a_clock_that_jumps_stops_once(fresh, make_odometry, make_scan, stamp):
    fresh.see_scan(make_scan(stamp), 10.1)
    assert Reason.CLOCK_JUMP in fresh.supervise((0.1, 0.0), 10.1).reasons
    fresh.see_odometry(make_odometry(stamp + 0.1), 10.2)
    fresh.see_scan(make_scan(stamp + 0.1), 10.2)
    assert fresh.supervise((0.1, 0.0), 10.2).command == (0.1, 0.0)


def test_odometry_that_turns_all_at_once_is_a_jump(fresh, make_odometry):
    # In 0.05 s PM01 can turn 0.075 rad; with twice that and 0.5 rad of slack 1 rad is too much.
    fresh.see_odometry(make_odometry(10.05, pose=(0.0, 0.0, 1.0)), 10.05)
    assert Reason.ODOMETRY_JUMP in fresh.supervise((0.1, 0.0), 10.05).reasons


def test_a_turn_past_half_a_circle_is_no_jump(supervisor, make_scan, make_odometry):
    supervisor.see_odometry(make_odometry(10.0, pose=(0.0, 0.0, 3.1)), 10.0)
    supervisor.see_scan(make_scan(10.0), 10.0)
    # From 3.1 to -3.1 rad are 0.083 rad.
    supervisor.see_odometry(make_odometry(10.05, pose=(0.0, 0.0, -3.1)), 10.05)
    assert supervisor.supervise((0.1, 0.0), 10.05).reasons == ()


def test_our_own_clock_going_back_is_a_jump(fresh):
    assert Reason.CLOCK_JUMP in fresh.supervise((0.1, 0.0), 9.9).reasons


@pytest.mark.parametrize("now", [math.nan, -math.inf, math.inf])
def test_a_clock_of_ours_that_is_no_time_stops(fresh, make_scan, now):
    fresh.see_scan(make_scan(10.05), now)
    assert fresh.supervise((0.1, 0.0), now).command == (0.0, 0.0)


def test_emergency_stop_lost_transform_and_no_goal(fresh):
    assert fresh.supervise((0.1, 0.0), 10.0, goal=False).reasons == (Reason.NO_GOAL,)
    for age in (1.1, math.inf, math.nan):
        verdict = fresh.supervise((0.1, 0.0), 10.0, transform_age=age)
        assert verdict.reasons == (Reason.LOST_TRANSFORM,)
    fresh.set_emergency(True, "topic")
    assert fresh.supervise((0.1, 0.0), 10.0).reasons == (Reason.EMERGENCY_STOP,)
    fresh.set_emergency(False, "topic")
    assert fresh.supervise((0.1, 0.0), 10.0).reasons == ()


def test_who_presses_the_emergency_stop_is_who_releases_it(fresh):
    fresh.set_emergency(True, "service")
    fresh.set_emergency(False, "topic")
    assert fresh.supervise((0.1, 0.0), 10.0).reasons == (Reason.EMERGENCY_STOP,)
    fresh.set_emergency(False, "service")
    assert fresh.supervise((0.1, 0.0), 10.0).reasons == ()


def test_after_silence_a_robot_starts_from_standing(fresh, make_scan, make_odometry):
    for now in (10.0, 10.1, 10.2):
        fresh.see_odometry(make_odometry(now + 0.001), now)
        fresh.see_scan(make_scan(now + 0.001), now)
        fresh.supervise((0.5, 0.0), now)
    # Nothing was said for 0.25 s, so a watchdog has stopped it: 0.2 m/s is one step from standing.
    fresh.see_odometry(make_odometry(10.44), 10.44)
    fresh.see_scan(make_scan(10.44), 10.44)
    assert fresh.supervise((0.5, 0.0), 10.45).command == pytest.approx((0.2, 0.0))


def test_commands_that_come_too_seldom_are_refused(robot):
    with pytest.raises(InputError, match=r"control_dt = 0\.2 s"):
        SafetySupervisor(robot, 0.2, SafetyConfig())


def test_the_robot_does_not_drive_where_its_lidar_does_not_look(supervisor, make_odometry):
    supervisor.see_odometry(make_odometry(10.0), 10.0)
    # Half a circle ahead, as a lidar in front of a box: backwards nothing is known.
    half = Scan(10.0, -math.pi / 2, math.pi / 180, 0.1, 3.5, np.full(181, np.inf, np.float32))
    supervisor.see_scan(half, 10.0)
    assert supervisor.supervise((0.1, 0.0), 10.0).command == (0.1, 0.0)
    verdict = supervisor.supervise((-0.1, 0.3), 10.1)
    assert verdict.command == (0.0, 0.3)
    assert verdict.reasons == (Reason.UNSEEN,)


def test_beams_that_say_nothing_ahead_let_the_robot_back_away_only(fresh, make_scan):
    # 360 beams, one a degree, 180 ahead. Of the 91 within 45 deg of it 50 are invalid.
    lost = {f"beam_{k}": math.nan for k in range(155, 205)}
    fresh.see_scan(make_scan(10.05, **lost), 10.05)
    assert fresh.supervise((0.1, 0.0), 10.05).reasons == (Reason.UNSEEN,)
    assert fresh.supervise((-0.1, 0.0), 10.1).command == pytest.approx((-0.1, 0.0))


def test_slows_down_near_an_obstacle_and_stands_before_it(fresh, make_scan):
    # Beam 180 looks straight ahead. The gap is r - 0.17 - 0.02 m. 0.1 m/s meets an obstacle at
    # 0.22 m after 0.3 s, half of what the slow-down zone asks for; the looks of 1 cm may make it
    # 0.02 m, that is 0.2 s, earlier.
    fresh.see_scan(make_scan(10.05, beam_180=0.22), 10.05)
    verdict = fresh.supervise((0.1, 0.0), 10.05)
    assert verdict.reasons == (Reason.SLOWED,)
    assert 0.1 * 0.1 / 0.6 <= verdict.command[0] <= 0.1 * 0.3 / 0.6
    fresh.see_scan(make_scan(10.1, beam_180=0.18), 10.1)
    verdict = fresh.supervise((0.1, 0.3), 10.1)
    assert verdict.reasons == (Reason.OBSTACLE,)
    # A disc may still turn on the spot.
    assert verdict.command == (0.0, 0.3)
    assert fresh.supervise((-0.1, 0.0), 10.15).command[0] == -0.1


def test_brakes_for_what_the_robot_does_now(fresh, make_scan, make_odometry):
    # At 0.5 m/s the robot needs 0.3 s to react and 0.0625 m to brake: 0.2125 m, and it has 0.1.
    # Turning away at full speed is then too late, though the new arc itself would be free.
    fresh.see_odometry(make_odometry(10.05, v=0.5), 10.05)
    fresh.see_scan(make_scan(10.05, beam_180=0.29), 10.05)
    verdict = fresh.supervise((0.2, 0.8), 10.05)
    assert 0.0 <= verdict.command[0] < 0.2


def test_returns_stay_in_place_while_the_robot_drives_on(fresh, make_scan, make_odometry):
    fresh.see_odometry(make_odometry(10.05), 10.05)
    fresh.see_scan(make_scan(10.05, beam_180=0.6), 10.05)
    # Seen at 0.6 m. From 0.3 m further on the gap is 0.3 - 0.17 - 0.02 = 0.11 m, 0.55 s at 0.2 m/s;
    # from where the scan was taken it would be beyond the horizon.
    fresh.see_odometry(make_odometry(10.25, pose=(0.3, 0.0, 0.0)), 10.25)
    assert fresh.supervise((0.2, 0.0), 10.25).time_to_contact <= 0.55


@pytest.mark.parametrize(
    ("name", "value"), [("reaction_s", 0.0), ("padding", -0.1), ("scan_timeout_s", math.inf)]
)
def test_settings_that_could_not_protect_are_refused(name, value):
    with pytest.raises(InputError, match=rf"safety\.{name} = {value}"):
        SafetyConfig(**{name: value})


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    seed=st.integers(0, 2**32 - 1),
    robot_name=st.sampled_from(["pm01", "jackal"]),
    rates=st.tuples(*[st.floats(0.0, 0.5)] * 8),
    delay=st.floats(0.0, 0.9),
)
def test_no_sequence_of_messages_leads_to_an_unsafe_command(
    safety_fuzz, seed, robot_name, rates, delay
):
    drop, double, corrupt, jump, policy, operator, lidar, others = rates
    faults = safety_fuzz.Faults(
        drop=drop,
        double=double,
        delay_s=delay,
        corrupt=corrupt,
        clock_jump=0.2 * jump,
        policy=policy,
        operator=operator,
        transform=0.1 * drop,
        silence=0.1 * corrupt,
        sick=lidar,
        frozen=lidar,
        late=others,
        foreign=0.2 * others,
        our_clock_jump=0.1 * jump,
    )
    sequence = safety_fuzz.Sequence(seed, safety_fuzz.robot_with(robot_name, 90), faults)
    sequence.run()
    assert sequence.violations == []


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1), robot_name=st.sampled_from(["pm01", "jackal"]))
def test_with_honest_messages_no_policy_touches_anything(safety_fuzz, seed, robot_name):
    robot = safety_fuzz.robot_with(robot_name, 360)
    sequence = safety_fuzz.Sequence(seed, robot, safety_fuzz.HONEST)
    sequence.run()
    assert sequence.violations == []
    assert sequence.contacts == 0


@pytest.mark.parametrize(
    ("place", "name", "without", "faults", "violation"),
    [
        (motion_check, "BLIND_GAP", 9.0, {"sick": 50.0}, "drives blindly"),
        (ScanCheck, "sees", lambda *_, **__: True, {"sick": 50.0}, "drives blindly"),
        (scan_check, "by_rep_117", lambda scan, _: scan, {"sick": 50.0}, "unusable scan"),
        (ScanCheck, "frozen", False, {"frozen": 50.0}, "frozen scan"),
        (safety, "Stream", lambda _, **how: Stream(**how), {"late": 50.0}, "stale scan"),
        (safety, "MIXED_S", -1.0, {"foreign": 0.5}, "two lidars"),
        (SafetySupervisor, "_moved_too_far", lambda *_: False, {"foreign": 0.5}, "two odometries"),
    ],
)
def test_the_judge_objects_where_a_check_is_left_out(
    safety_fuzz, monkeypatch, place, name, without, faults, violation
):
    monkeypatch.setattr(place, name, without)
    robot = safety_fuzz.robot_with("pm01", 60)
    for seed in range(100):
        sequence = safety_fuzz.Sequence(seed, robot, safety_fuzz.Faults(**faults))
        sequence.run()
        if violation in sequence.violations:
            return
    pytest.fail(f"nobody objected: {violation}")


def test_the_judge_finds_what_is_unsafe(safety_fuzz, monkeypatch):
    """Without the check of the way ahead, the same judge must object."""
    monkeypatch.setattr(SafetySupervisor, "_share", lambda *_, **__: (1.0, math.inf))
    found = set()
    for seed in range(12):
        sequence = safety_fuzz.Sequence(
            seed, safety_fuzz.robot_with("pm01", 360), safety_fuzz.HONEST
        )
        sequence.run()
        found.update(sequence.violations)
    assert found == {"drives into a disc"}
