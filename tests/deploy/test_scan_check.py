# SPDX-License-Identifier: Apache-2.0
"""Scans that say little, nothing, or always the same: the robot must not take that for free."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pm01_nav.deploy.messages import Scan, from_json, scan_from_ros
from pm01_nav.deploy.motion_check import seen_share
from pm01_nav.deploy.safety import STOP, Reason, SafetyConfig, SafetySupervisor
from pm01_nav.deploy.scan_check import by_rep_117
from pm01_nav.robot import load_robot

INF, NAN = math.inf, math.nan
DT = 0.1


@pytest.fixture(scope="module")
def robot_that_means(robot):
    """Return PM01 with a lidar whose 0 means something."""

    def make(zero_means: str):
        lidar = robot.lidar.model_copy(update={"zero_means": zero_means})
        return robot.model_copy(update={"lidar": lidar})

    return make


def shown(robot, scan: Scan, make_odometry) -> SafetySupervisor:
    """Return a supervisor of a robot at rest that has just seen ``scan``."""
    supervisor = SafetySupervisor(robot, DT, SafetyConfig())
    supervisor.see_odometry(make_odometry(10.0), 10.0)
    supervisor.see_scan(replace(scan, stamp=10.0), 10.0)
    return supervisor


def with_ranges(scan: Scan, ranges) -> Scan:
    return replace(scan, ranges=np.array(ranges, dtype=np.float32))


@pytest.mark.parametrize(
    ("value", "share", "advice"),
    [
        (0.0, 1.0, "the scan is mostly zeros: set lidar.zero_means in the robot's YAML"),
        (0.0, 0.9, "the scan is mostly zeros: set lidar.zero_means in the robot's YAML"),
        (-0.0, 1.0, "the scan is mostly zeros: set lidar.zero_means in the robot's YAML"),
        (0.05, 1.0, "360 of 360 ranges are below the scan's range_min (0.12 m)"),
        (65.535, 1.0, "360 of 360 ranges are beyond the scan's range_max (3.5 m)"),
        (3.51, 0.6, "216 of 360 ranges are beyond the scan's range_max (3.5 m)"),
        (NAN, 0.9, None),
    ],
)
def test_a_scan_that_says_too_little_stops(robot, make_scan, make_odometry, value, share, advice):
    ranges = np.full(360, 2.0)
    # The valid rest is spread evenly, so that no direction has a gap of its own.
    ranges[np.arange(360) % 10 < round(10 * share)] = value
    supervisor = shown(robot, with_ranges(make_scan(0.0), ranges), make_odometry)
    verdict = supervisor.supervise((0.1, 0.0), 10.0)
    assert verdict.command == STOP
    assert verdict.reasons == (Reason.INVALID_SCAN,)
    assert supervisor.advice == advice or supervisor.advice.startswith(advice)
    assert "\n" not in (supervisor.advice or "")


@pytest.mark.parametrize("value", [0.0, 0.05, 65.535, NAN])
@pytest.mark.parametrize("half_width", [5, 20, 45, 80])
def test_nothing_told_of_what_lies_ahead(robot, make_scan, make_odometry, value, half_width):
    # Beam 180 looks ahead. 11 beams lost are a gap of 12 degrees between those that are left.
    ranges = np.full(360, INF)
    ranges[180 - half_width : 181 + half_width] = value
    supervisor = shown(robot, with_ranges(make_scan(0.0), ranges), make_odometry)
    verdict = supervisor.supervise((0.1, 0.2), 10.0)
    assert verdict.command == (0.0, 0.2)
    assert verdict.reasons == (Reason.UNSEEN,)
    if value == 0.0:
        count = 2 * half_width + 1
        assert supervisor.advice.startswith(f"{count} ranges are 0: set lidar.zero_means")
    assert supervisor.supervise((-0.1, 0.0), 10.1).command == (-0.1, 0.0)
    assert supervisor.advice is None


def test_a_few_beams_lost_here_and_there_are_no_reason_to_stop(robot, make_scan, make_odometry):
    ranges = np.full(360, INF)
    # Eight together are a gap of 9 degrees; and every third one.
    ranges[176:184] = NAN
    ranges[::3] = 0.0
    ranges[[175, 184]] = INF
    supervisor = shown(robot, with_ranges(make_scan(0.0), ranges), make_odometry)
    assert supervisor.supervise((0.1, 0.0), 10.0).command == (0.1, 0.0)
    assert supervisor.advice is None


def test_a_gap_at_the_edge_of_what_the_lidar_sees():
    # From -90 to 90 deg, of which the left half but for 5 deg says nothing: 96 of 181 are valid.
    ranges = np.full(181, 1.0, dtype=np.float32)
    ranges[96:] = 0.0
    scan = Scan(0.0, -math.pi / 2, math.pi / 180, 0.1, 3.5, ranges)
    assert seen_share(scan, 0.0) == (0.0, 0.0)
    # A lidar that does not look further than 30 deg to each side has 61 of the 91 beams.
    narrow = Scan(0.0, -math.pi / 6, math.pi / 180, 0.1, 3.5, np.full(61, 1.0, np.float32))
    assert seen_share(narrow, 0.0) == pytest.approx((61 / 90, 0.0), abs=1e-4)


@pytest.mark.parametrize(
    ("zero_means", "command", "reasons"),
    [
        ("no_return", (0.1, 0.0), ()),
        # Something is nearer than 0.12 m to all sides.
        ("too_close", STOP, (Reason.OBSTACLE,)),
        ("invalid", STOP, (Reason.INVALID_SCAN,)),
    ],
)
@pytest.mark.parametrize("range_min", [0.12, 0.0])
def test_what_a_zero_means_is_the_robots_setting(
    robot_that_means, make_scan, make_odometry, zero_means, command, reasons, range_min
):
    # Some drivers, as the LDS-02's, say that they see from 0 m on; a 0 is none of their returns.
    scan = replace(with_ranges(make_scan(0.0), np.zeros(360)), range_min=range_min)
    supervisor = shown(robot_that_means(zero_means), scan, make_odometry)
    verdict = supervisor.supervise((0.1, 0.0), 10.0)
    assert (verdict.command, verdict.reasons) == (command, reasons)


def test_the_robots_of_the_lds_class():
    assert load_robot("turtlebot3_burger").lidar.zero_means == "no_return"
    assert load_robot("turtlebot3_waffle").lidar.zero_means == "no_return"
    assert load_robot("jackal").lidar.zero_means == "invalid"


def test_ranges_by_rep_117():
    ranges = np.array([0.0, -0.0, 0.05, 0.12, 1.0, 3.5, 3.6, INF, -INF, NAN], dtype=np.float32)
    scan = Scan(0.0, 0.0, 0.1, 0.12, 3.5, ranges)
    rest = [NAN, 0.12, 1.0, 3.5, NAN, INF, -INF, NAN]
    for zero_means, zero in (("no_return", INF), ("too_close", -INF), ("invalid", NAN)):
        expected = np.array([zero, zero, *rest], dtype=np.float32)
        np.testing.assert_array_equal(by_rep_117(scan, zero_means).ranges, expected)


def test_a_scan_that_goes_round_twice_is_no_scan(robot, make_scan, make_odometry):
    scan = with_ranges(make_scan(0.0), np.full(720, INF))
    supervisor = shown(robot, scan, make_odometry)
    assert supervisor.supervise((0.1, 0.0), 10.0).reasons == (Reason.INVALID_SCAN,)


def test_a_bridge_that_writes_null_for_everything_tells_nothing(robot, make_scan, make_odometry):
    scan = make_scan(0.0)
    header = {"stamp": {"sec": 10, "nanosec": 0}, "frame_id": "laser"}
    message = {name: getattr(scan, name) for name in ("angle_min", "angle_increment")}
    message |= {"header": header, "range_min": 0.12, "range_max": 3.5}

    def reasons(ranges) -> tuple[Reason, ...]:
        scan = scan_from_ros(from_json({**message, "ranges": ranges}))
        return shown(robot, scan, make_odometry).supervise((0.1, 0.0), 10.0).reasons

    assert reasons([None] * 360) == (Reason.INVALID_SCAN,)
    # With a single return it is a lidar that works.
    assert reasons([2.0] + [None] * 359) == ()
    assert reasons([0.0] * 360) == (Reason.INVALID_SCAN,)
    assert reasons([2.0] + [0.0] * 359) == (Reason.INVALID_SCAN,)


class Moving:
    """A supervisor, and a robot that moves by ``v`` and ``w`` while scans come."""

    def __init__(self, robot, make_odometry) -> None:
        self.supervisor = SafetySupervisor(robot, DT, SafetyConfig())
        self.make_odometry = make_odometry
        self.pose, self.now = np.zeros(3), 10.0

    def see(self, scan: Scan, v: float, w: float = 0.0, says=("pose", "twist")):
        """Move for a tenth of a second; return why the robot stands after a scan."""
        for _ in range(2):
            self.now += 0.05
            self.pose = self.pose + 0.05 * np.array([v, 0.0, w])
            twist = (v, w) if "twist" in says else (0.0, 0.0)
            pose = tuple(self.pose) if "pose" in says else (0.0, 0.0, 0.0)
            odometry = self.make_odometry(self.now, *twist, pose)
            self.supervisor.see_odometry(odometry, self.now)
        self.supervisor.see_scan(replace(scan, stamp=self.now), self.now)
        return self.supervisor.faults(self.now)


@pytest.fixture
def moving(robot, make_odometry):
    return Moving(robot, make_odometry)


@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (-0.1, 0.0), (0.0, 0.5)])
def test_a_lidar_that_repeats_one_scan_while_the_robot_moves_is_broken(moving, make_scan, v, w):
    scan = make_scan(0.0, 2.0)
    reasons = [moving.see(scan, v, w) for _ in range(12)]
    # The first scan, and ten more within the second after it.
    assert reasons[:10] == [()] * 10
    assert reasons[11] == (Reason.FROZEN_SCAN,)
    # It stays broken while the robot stands, until the lidar moves on.
    assert moving.see(scan, 0.0) == (Reason.FROZEN_SCAN,)
    # One that cannot be used in between tells nothing of that.
    broken = replace(scan, range_max=NAN)
    assert set(moving.see(broken, 0.0)) == {Reason.INVALID_SCAN, Reason.FROZEN_SCAN}
    assert moving.see(scan, 0.0) == (Reason.FROZEN_SCAN,)
    assert moving.see(make_scan(0.0, 2.0, beam_7=2.001), 0.0) == ()


@pytest.mark.parametrize("says", ["pose", "twist"])
def test_odometry_may_tell_of_motion_in_either_way(moving, make_scan, says):
    reasons = [moving.see(make_scan(0.0, 2.0), 0.3, says=(says,)) for _ in range(12)]
    assert (reasons[8], reasons[-1]) == ((), (Reason.FROZEN_SCAN,))


def test_to_stop_now_and_then_does_not_hide_a_broken_lidar(moving, make_scan):
    scan = make_scan(0.0, 2.0)
    reasons = [moving.see(scan, 0.3 if k % 8 < 4 else 0.0) for k in range(24)]
    # In 24 tenths of a second it moves for 12.
    assert reasons[12] == ()
    assert reasons[-1] == (Reason.FROZEN_SCAN,)


def test_a_robot_that_stands_sees_the_same_again_and_again(moving, make_scan):
    # 0.01 m/s is what odometry says of a robot that stands.
    assert all(moving.see(make_scan(0.0, 2.0), 0.01) == () for _ in range(40))


def test_where_nothing_is_in_range_all_scans_are_alike(moving, make_scan, robot_that_means):
    ranges = np.full(360, INF)
    ranges[::5] = NAN
    scan = with_ranges(make_scan(0.0), ranges)
    assert all(moving.see(scan, 0.3) == () for _ in range(30))
    zeros = Moving(robot_that_means("no_return"), moving.make_odometry)
    scan = with_ranges(scan, np.zeros(360))
    assert all(zeros.see(scan, 0.3) == () for _ in range(30))


def test_a_driver_may_write_into_the_same_array_again(moving, make_scan):
    scan = make_scan(0.0, 2.0)
    for k in range(30):
        scan.ranges[7] = 2.0 + 0.001 * k
        assert moving.see(scan, 0.3) == ()


def test_a_lidar_that_moves_on_by_one_bit_is_not_broken(moving, make_scan):
    distance = np.float32(2.0)
    for _ in range(30):
        distance = np.nextafter(distance, np.float32(3.0))
        assert moving.see(make_scan(0.0, float(distance)), 0.3) == ()


def test_scans_of_two_lidars_on_one_topic(moving, make_scan):
    front, rear = (replace(make_scan(0.0), frame_id=name) for name in ("front", "rear"))
    assert moving.see(front, 0.1) == ()
    assert moving.see(rear, 0.1) == (Reason.MIXED_SCANS,)
    assert [moving.see(k, 0.1) for k in (front, rear)] == [(Reason.MIXED_SCANS,)] * 2
    # A driver that was started anew with another frame goes on alone: after a second all is well.
    assert [moving.see(rear, 0.1) for _ in range(11)][-1] == ()


def test_odometry_of_two_sources(robot, make_scan, make_odometry):
    """Wheels and a filter on one topic: 0.1 m apart is no jump, back and forth all the time is."""

    def reasons(apart: float, frames=("odom", "odom")) -> set[Reason]:
        supervisor, found = SafetySupervisor(robot, DT, SafetyConfig()), set()
        for k in range(40):
            now, pose = 10.0 + 0.05 * k, (0.0, apart * (k % 2), 0.0)
            odometry = replace(make_odometry(now, pose=pose), frame_id=frames[k % 2])
            supervisor.see_odometry(odometry, now)
            supervisor.see_scan(make_scan(now), now)
            found.update(supervisor.supervise((0.1, 0.0), now).reasons)
        return found

    # In 0.05 s PM01 can move 0.05 m, twice what its limit says: 0.04 m back and forth may be noise.
    assert reasons(0.04) == set()
    # Six times 0.1 - 0.05 m are 0.3 m, more than may be.
    assert Reason.ODOMETRY_JUMP in reasons(0.1)
    assert Reason.ODOMETRY_JUMP in reasons(0.0, ("odom", "map"))
    assert reasons(0.0, ("odom", "")) == set()
