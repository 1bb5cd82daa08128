# SPDX-License-Identifier: Apache-2.0
"""The observation contract: every part at values worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pm01_nav.drives import DifferentialDrive
from pm01_nav.envs.spaces import observation_space
from pm01_nav.errors import InputError
from pm01_nav.sim.lidar import sanitized
from pm01_nav.task.config import observation_layout
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.observation import ObservationLayout, Observer, UsualParts
from pm01_nav.task.parts.base import NO_MEMORY, Elapsed, Seen
from pm01_nav.task.randomization import RandomizationConfig
from pm01_nav.task.scans import ScanGeometry, discard_invalid, pool_sectors, sector_begins
from pm01_nav.task.tasks import TASKS, task_config
from pm01_nav.task.trail import TrailLayout
from pm01_nav.task.worlds import world_pool

INF, NAN = np.inf, np.nan
GEOMETRY = ScanGeometry(
    num_beams=6, angle_min=-np.pi, angle_increment=np.pi / 3, range_min=0.1, range_max=3.5
)
DRIVE = DifferentialDrive(linear_min=-0.2, linear_max=0.5, angular_max=1.5)


def layout_of(geometry: ScanGeometry = GEOMETRY, **keys) -> ObservationLayout:
    return ObservationLayout(geometry, DRIVE, UsualParts(**keys).made(geometry, DRIVE))


WITH_RANGES = {"nearness_distance": 0.0, "goal": "polar", "previous_action": False}
PLAIN = layout_of(**WITH_RANGES)
RICH = layout_of(sectors=3)
SCAN = np.array([0.5, 1.0, INF, 3.5, -INF, 2.0], dtype=np.float32)
EXACT = {"abs": 1e-6}
"""Observations are float32: numbers up to 10 are rounded to 5e-7."""


def show(layout: ObservationLayout, scans, goals, velocities, actions):
    """Return observations of n robots that all begin."""
    seen = Seen(scans, goals, velocities, actions, Elapsed(0.1))
    return Observer(layout, lambda part: NO_MEMORY).show(seen)


def build(layout: ObservationLayout, scan=SCAN, goal=(2.0, 0.5), velocity=(0.1, -0.4)):
    rows = (np.array(row)[None] for row in (scan, goal, velocity, (0.25, -1.0)))
    return show(layout, *rows)[0]


def test_plain_layout() -> None:
    # No return reads range_max, too close reads range_min; the rest stands as it is.
    expected = [0.5, 1.0, 3.5, 3.5, 0.1, 2.0, 2.0, 0.5, 0.1, -0.4]
    observation = build(PLAIN)
    assert observation.dtype == np.float32
    assert observation == pytest.approx(expected, **EXACT)


def test_rich_layout() -> None:
    # Sectors of two beams: nearest 0.5, 3.5, and too close = 0.1; (0.3 - r) / (0.3 + r) is
    # -0.2 / 0.8, -3.2 / 3.8 and 0.2 / 0.4.
    expected = [-0.25, -0.8421053, 0.5, 2.0, np.sin(0.5), np.cos(0.5), 0.1, -0.4, 0.25, -1.0]
    assert build(RICH) == pytest.approx(expected, **EXACT)


def test_parts_and_sizes_agree() -> None:
    names = [(part.name, part.size) for part in RICH.parts]
    assert names == [
        ("scan", 3),
        ("goal_distance", 1),
        ("goal_sin_cos", 2),
        ("linear_velocity", 1),
        ("angular_velocity", 1),
        ("previous_action", 2),
    ]
    assert [(p.name, p.size) for p in PLAIN.parts][:3] == [
        ("scan", 6),
        ("goal_distance", 1),
        ("goal_bearing", 1),
    ]
    for layout, size in ((PLAIN, 10), (RICH, 10)):
        assert layout.size == len(layout.scale) == len(layout.bounds[0]) == size
        assert build(layout).shape == (size,)


def test_values_beyond_the_limits_are_clipped() -> None:
    observation = build(PLAIN, goal=(25.0, -3.0), velocity=(0.7, -2.0))
    assert observation[6:] == pytest.approx([10.0, -3.0, 0.5, -1.5], **EXACT)
    observation = build(PLAIN, goal=(0.0, 3.0), velocity=(-0.7, 2.0))
    assert observation[6:] == pytest.approx([0.0, 3.0, -0.2, 1.5], **EXACT)


def test_range_shown_may_be_shorter_than_the_lidars() -> None:
    layout = layout_of(replace(GEOMETRY, range_max=1.5), **WITH_RANGES)
    assert build(layout)[:6] == pytest.approx([0.5, 1.0, 1.5, 1.5, 0.1, 1.5], **EXACT)


def test_robots_beside_each_other_are_seen_alone() -> None:
    scans = np.stack([SCAN, SCAN[::-1], SCAN + 1, SCAN * 0.5, SCAN, SCAN])
    goals = np.random.default_rng(0).uniform(0.0, 3.0, (6, 2))
    rest = np.zeros((6, 2))
    together = show(RICH, scans, goals, rest, rest)
    assert together.shape == (6, 10)
    for i in range(6):
        row = slice(i, i + 1)
        alone = show(RICH, scans[row], goals[row], rest[row], rest[row])
        assert (together[i] == alone[0]).all()


def test_invalid_ranges_say_nothing() -> None:
    # REP-117: NaN is invalid. LaserScan: finite ranges outside [range_min, range_max] are to be
    # discarded; the limits themselves are valid.
    scan = np.array([NAN, 0.05, 0.0, -2.0, -INF, INF, 0.2, 3.51, 0.1, 3.5], dtype=np.float32)
    expected = [INF, INF, INF, INF, -INF, INF, 0.2, INF, 0.1, 3.5]
    assert discard_invalid(scan, GEOMETRY).tolist() == pytest.approx(expected)
    assert scan[1] == np.float32(0.05)  # The argument is left as it was.


@settings(deadline=None)  # The first call may compile the kernel.
@given(
    scan=arrays(np.float32, 6, elements=st.floats(width=32)),
    limits=st.tuples(st.floats(0.0, 2.0, width=32), st.floats(2.5, 50.0, width=32)),
)
def test_simulator_and_policy_sanitise_alike(scan, limits) -> None:
    geometry = replace(GEOMETRY, range_min=limits[0], range_max=limits[1])
    shortest, longest = np.float32(limits[0]), np.float32(limits[1])
    kernel = np.array([sanitized(value, shortest, longest) for value in scan], dtype=np.float32)
    # NaN never comes out, so that the bits can be compared.
    assert discard_invalid(scan, geometry).tobytes() == kernel.tobytes()


@pytest.mark.parametrize("value", [0.12, 3.5, 0.1, 5.0, 30.0])
def test_simulator_and_policy_sanitise_alike_at_the_limits(value: float) -> None:
    at = np.float32(value)
    scan = np.array([np.nextafter(at, -INF), at, np.nextafter(at, INF)] * 2, dtype=np.float32)
    for low, high in ((value, 2 * value), (0.5 * value, value)):
        geometry = replace(GEOMETRY, range_min=low, range_max=high)
        kernel = [sanitized(v, np.float32(low), np.float32(high)) for v in scan]
        assert discard_invalid(scan, geometry).tolist() == kernel


def test_simulated_scans_are_clean() -> None:
    # However much its lidar lies, a simulated scan holds nothing that a policy would discard.
    lies = RandomizationConfig(lidar_noise_std=(1.0, 1.0), lidar_dropout=(0.2, 0.2))
    config = task_config("static").model_copy(update={"randomization": lies})
    batch = NavigationBatch(config, world_pool(config, "train", 2), 20)
    batch.reset(np.arange(20))
    scan = batch.simulator.scan
    assert (discard_invalid(scan, batch.layout.scan) == scan).all()
    # It has returns, beams without, and some that are too close.
    assert np.isfinite(scan).any()
    assert (scan == INF).any()
    assert (scan == -INF).any()


def test_an_invalid_range_hides_no_nearer_return() -> None:
    scan = discard_invalid(np.array([NAN, 0.7, 0.01, 0.9, INF, NAN], dtype=np.float32), GEOMETRY)
    layout = layout_of(sectors=3, nearness_distance=0.0)
    assert build(layout, scan)[:3] == pytest.approx([0.7, 0.9, 3.5], **EXACT)


def test_range_at_range_min_is_valid_in_float32() -> None:
    # float32(0.12) is below the float64 0.12, but it is what a driver sends for it.
    geometry = replace(GEOMETRY, range_min=0.12)
    scan = np.full(6, 0.12, dtype=np.float32)
    assert (discard_invalid(scan, geometry) == scan).all()


def test_pool_sectors_takes_the_nearest() -> None:
    ranges = np.array([[3.0, 1.0, 2.0, 5.0, 4.0, 6.0], [1.0, 9.0, 9.0, 9.0, 9.0, 2.0]])
    assert pool_sectors(ranges, 2).tolist() == [[1.0, 4.0], [1.0, 2.0]]
    assert pool_sectors(ranges, 6).tolist() == ranges.tolist()
    assert pool_sectors(ranges, 0) is ranges
    assert pool_sectors(ranges, 1).tolist() == [[1.0], [1.0]]
    # floor(6 k / 4) = 0, 1, 3, 4, 6: beams 0 | 1, 2 | 3 | 4, 5.
    assert sector_begins(6, 4) == [0, 1, 3, 4, 6]
    assert pool_sectors(ranges, 4).tolist() == [[3.0, 1.0, 5.0, 4.0], [1.0, 9.0, 9.0, 2.0]]
    # 541 = 36 x 15 + 1: one sector has one beam more.
    sizes = np.diff(sector_begins(541, 36))
    assert sorted(sizes.tolist()) == [15] * 35 + [16]


@pytest.mark.parametrize("sectors", [7, -1, 12])
def test_sectors_without_a_beam_are_refused(sectors: int) -> None:
    with pytest.raises(InputError, match="must be from 0 to the number of beams, 6"):
        layout_of(sectors=sectors)


@pytest.mark.parametrize(
    "layout", [PLAIN, RICH, layout_of(trail=TrailLayout(7), frames=FramesLayout(1, 2))]
)
def test_layout_survives_json(layout: ObservationLayout) -> None:
    assert ObservationLayout.from_dict(json.loads(json.dumps(layout.to_dict()))) == layout


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colour": 1}, "observation.colour: unknown key"),
        ({"scan": {"num_beams": 3}}, "observation layout"),
        ({"scan": GEOMETRY.__dict__ | {"fov": 1}}, "observation layout"),
        ({"limits": {}}, "observation layout"),
        ({"limits": None}, "observation layout"),
        ({"parts": [{"part": "scan", "sectors": 7}]}, "sectors"),
        ({"parts": [{"part": "scan", "frames": {"count": 0}}]}, "frames.count = 0"),
        ({"parts": [{"part": "sonar"}]}, "observation.parts.sonar: unknown; allowed: angular"),
        ({"parts": [{"part": "scan", "colour": 1}]}, "observation.parts.scan.colour: unknown"),
        ({"parts": [{"part": "goal_bearing"}] * 2}, "observation.parts.goal_bearing: is there tw"),
        ({"parts": None}, "observation layout"),
    ],
)
def test_foreign_metadata_is_refused(change, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ObservationLayout.from_dict(RICH.to_dict() | change)


def test_metadata_of_format_1_lists_no_parts() -> None:
    keys = {"sectors": 3, "nearness_distance": 0.3, "goal": "polar_sin_cos", "normalize": True}
    keys |= {"previous_action": True, "goal_distance_max": 10.0, "trail": None, "frames": None}
    plain = RICH.to_dict()
    earlier = {"scan": plain["scan"], "limits": plain["limits"]} | keys
    assert ObservationLayout.from_dict(json.loads(json.dumps(earlier))) == RICH
    earlier["frames"] = {"count": 1, "interval_steps": 4}
    earlier["trail"] = {"sectors": 5}
    layout = ObservationLayout.from_dict(earlier)
    # Two scans of 3; distance, sine, cosine, v, w; the action; 5 sectors and the familiarity.
    assert [part.size for part in layout.parts] == [6, 1, 2, 1, 1, 2, 6]
    assert layout.part("scan").frames.interval_s == 0.4
    assert ObservationLayout.from_dict(earlier, 0.05).part("scan").frames.interval_s == 0.2
    listed = layout.to_dict()
    listed["parts"][0]["frames"] = earlier["frames"]
    assert ObservationLayout.from_dict(listed) == layout
    listed["parts"][0]["frames"] = earlier["frames"] | {"interval_s": 0.4}
    with pytest.raises(InputError, match=r"parts\.scan\.frames\.interval_steps: stands beside"):
        ObservationLayout.from_dict(listed)
    with pytest.raises(InputError, match=r"observation\.colour: unknown key"):
        ObservationLayout.from_dict(earlier | {"colour": 1})


def test_missing_metadata_is_refused() -> None:
    data = RICH.to_dict()
    del data["scan"]
    with pytest.raises(InputError, match="scan"):
        ObservationLayout.from_dict(data)


@pytest.mark.parametrize("layout", [PLAIN, RICH, replace(PLAIN, normalize=False)])
def test_bounds_hold_and_are_reached(layout: ObservationLayout) -> None:
    rng = np.random.default_rng(0)
    n = 500
    scan = rng.choice([-INF, 0.1, 0.3, 3.5, INF], (n, 6)).astype(np.float32)
    goal = np.column_stack([rng.choice([0.0, 10.0, 99.0], n), rng.choice([-np.pi, 0, np.pi], n)])
    velocity = np.column_stack([rng.choice([-9.0, 9.0], n), rng.choice([-9.0, 9.0], n)])
    observation = show(layout, scan, goal, velocity, rng.choice([-1.0, 1.0], (n, 2)))
    if layout.normalize:
        observation = observation / np.array(layout.scale, dtype=np.float32)
    low, high = (np.array(bound, dtype=np.float32) for bound in layout.bounds)
    assert ((observation >= low) & (observation <= high)).all()
    # Each part but the scan, whose least value is range_min and not 0, fills its bounds.
    rest = slice(layout.parts[0].size, None)
    if layout.part("goal_bearing"):
        assert observation.min(axis=0)[rest] == pytest.approx(low[rest], **EXACT)
        assert observation.max(axis=0)[rest] == pytest.approx(high[rest], **EXACT)


def test_normalised_bounds_by_hand() -> None:
    low, high = PLAIN.bounds
    # 6 ranges in [0, 3.5] / 3.5, distance / 10, bearing / pi, v in [-0.2, 0.5] / 0.5, w / 1.5.
    assert low == pytest.approx([0.0] * 7 + [-1.0, -0.4, -1.0])
    assert high == pytest.approx([1.0] * 10)
    low, high = replace(PLAIN, normalize=False).bounds
    assert low == pytest.approx([0.0] * 7 + [-np.pi, -0.2, -1.5])
    assert high == pytest.approx([3.5] * 6 + [10.0, np.pi, 0.5, 1.5])


def test_article_has_24_numbers() -> None:
    config = task_config("article")
    layout = observation_layout(config, config.robot_spec())
    assert [(p.name, p.size) for p in layout.parts] == [
        ("scan", 20),
        ("goal_distance", 1),
        ("goal_bearing", 1),
        ("linear_velocity", 1),
        ("angular_velocity", 1),
    ]
    space = observation_space(layout)
    assert space.low == pytest.approx([0.0] * 21 + [-np.pi, -0.2, -1.5])
    assert space.high == pytest.approx([3.5] * 20 + [10.0, np.pi, 0.5, 1.5])


@pytest.mark.parametrize("name", sorted(TASKS))
def test_layout_of_every_task(name: str) -> None:
    config = task_config(name)
    layout = observation_layout(config, config.robot_spec())
    assert layout.size == sum(part.size for part in layout.parts)
    space = observation_space(layout)
    assert space.shape == (layout.size,)
    assert space.dtype == np.float32
    assert (space.low < space.high).all()
