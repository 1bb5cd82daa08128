# SPDX-License-Identifier: Apache-2.0
"""Times to contact of a disc and an oblong, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.deploy.messages import Scan
from pm01_nav.deploy.motion_check import (
    Outline,
    allowed_share,
    returns_as_points,
    seen_share,
    time_to_contact,
)
from pm01_nav.robot import Footprint

DISC = Outline(Footprint(shape="circle", radius=0.2))
OBLONG = Outline(
    Footprint(shape="polygon", vertices=((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)))
)


def points(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, dtype=float).reshape(-1, 2)


def test_clearance():
    assert DISC.clearance(points((0.5, 0.0), (0.0, 0.1))) == pytest.approx([0.3, -0.1])
    # Ahead of the front edge, beside the left one, and inside, 0.1 m from the nearest edge.
    places = points((0.5, 0.0), (0.0, 0.45), (0.0, 0.1))
    assert OBLONG.clearance(places) == pytest.approx([0.2, 0.25, -0.1])


@pytest.mark.parametrize(
    ("twist", "place", "seconds"),
    [
        # The gap of 0.3 m at 0.5 m/s.
        ((0.5, 0.0), (0.5, 0.0), 0.6),
        ((-0.5, 0.0), (-0.5, 0.0), 0.6),
        # Beside the way: touched when the centre is sqrt(0.2^2 - 0.1^2) = 0.173 m before it.
        ((0.5, 0.0), (0.5, 0.1), (0.5 - 0.1732) / 0.5),
        # 0.23 m beside the way, and behind: never.
        ((0.5, 0.0), (0.5, 0.23), math.inf),
        ((0.5, 0.0), (-0.5, 0.0), math.inf),
        # A disc may turn on the spot as it likes.
        ((0.0, 2.0), (0.21, 0.0), math.inf),
        # On a circle of 0.5 m to the left, half of it takes pi s; the point lies on that circle at
        # half a turn. Contact is where the chord is 0.2 m: 2 asin(0.2) = 0.403 rad earlier.
        ((0.5, 1.0), (0.0, 1.0), math.pi - 2.0 * math.asin(0.2)),
    ],
)
def test_time_to_contact_of_a_disc(twist, place, seconds):
    found = time_to_contact(DISC, points(place), twist, horizon=4.0)
    if math.isinf(seconds):
        assert math.isinf(found)
    else:
        # Early by two looks at most: 2 x (4 s / 64) where the way is long.
        assert seconds - 0.13 <= found <= seconds


def test_the_front_corner_of_an_oblong_turns_into_a_wall():
    # Corner at (0.3, 0.2): 0.3606 m out, at 33.69 deg. It touches y = 0.3 at asin(0.3 / 0.3606)
    # = 56.31 deg, after turning 22.62 deg = 0.3948 rad.
    wall = np.stack([np.linspace(-1.0, 1.0, 401), np.full(401, 0.3)], axis=-1)
    found = time_to_contact(OBLONG, wall, (0.0, 1.0), horizon=1.0)
    assert 0.3948 - 0.08 <= found <= 0.3948


def test_padding_and_obstacles_that_come_nearer_count():
    place = points((0.7, 0.0))
    padded = time_to_contact(DISC, place, (0.5, 0.0), 2.0, padding=0.1)
    assert 0.8 - 0.07 <= padded <= 0.8
    # The gap of 0.5 m closes at 0.5 + 0.5 m/s.
    meeting = time_to_contact(DISC, place, (0.5, 0.0), 2.0, obstacle_speed=0.5)
    assert 0.5 - 0.07 <= meeting <= 0.5


def test_from_too_close_the_robot_may_only_go_away():
    inside = points((0.19, 0.0))
    assert time_to_contact(DISC, inside, (0.5, 0.0), 1.0) == 0.0
    assert time_to_contact(DISC, inside, (-0.5, 0.0), 1.0) == math.inf


def test_nothing_to_touch_and_nothing_that_moves():
    assert time_to_contact(DISC, points(), (0.5, 0.0), 1.0) == math.inf
    assert time_to_contact(DISC, points((0.3, 0.0)), (0.0, 0.0), 1.0) == math.inf


def test_allowed_share():
    assert allowed_share(math.inf, 0.2, 0.25, 0.6) == 1.0
    # Two seconds away: no reason to slow down.
    assert allowed_share(2.0, 0.2, 0.25, 0.6) == 1.0
    # In the slow-down zone: 0.3 s away, 0.6 s wanted, and stopping takes 0.2 + 0.125 s.
    # s 0.2 + s^2 0.125 = 0.3 gives s = 0.944; the zone asks for 0.5.
    assert allowed_share(0.3, 0.2, 0.25, 0.6) == pytest.approx(0.5)
    # Without a zone it is the way to stop that counts: s 0.2 + s^2 0.125 = 0.15 at s = 0.5565.
    assert allowed_share(0.15, 0.2, 0.25, 1e-9) == pytest.approx(0.5565, abs=1e-4)
    assert allowed_share(0.0, 0.2, 0.25, 0.6) == 0.0


def test_returns_by_rep_117_and_the_mount():
    inf, nan = math.inf, math.nan
    ranges = np.array([1.0, inf, nan, -inf, 0.05, 9.0], dtype=np.float32)
    scan = Scan(0.0, 0.0, math.pi / 2, 0.1, 3.0, ranges)
    # Beam 0 looks ahead of a lidar that is turned by 90 deg and mounted 0.1 m forward: (0.1, 1.0).
    # Beam 3 (270 deg, in base_link straight ahead) is too close: 0.1 m beyond the mount.
    found = returns_as_points(scan, np.array([0.1, 0.0, math.pi / 2]))
    assert found == pytest.approx(np.array([[0.1, 1.0], [0.2, 0.0]]), abs=1e-7)


def test_seen_share():
    # Eight beams 45 deg apart from behind on. The quarter circle ahead has room for two; it has
    # those at -45, 0 and 45 deg, of which one says nothing. Behind are -180, -135 and 135 deg.
    ranges = np.array([math.inf, 1.0, 1.0, math.nan, 1.0, math.inf, 1.0, 1.0], dtype=np.float32)
    scan = Scan(0.0, -math.pi, math.pi / 4, 0.1, 3.0, ranges)
    assert seen_share(scan, 0.0) == pytest.approx((1.0, 1.5), abs=1e-5)
    # The same lidar, turned to look back.
    assert seen_share(scan, math.pi) == pytest.approx((1.5, 1.0), abs=1e-5)
