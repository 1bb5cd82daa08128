# SPDX-License-Identifier: Apache-2.0
"""What a policy's memory believes on a robot: late calls, pauses, and commands not obeyed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.drives import DifferentialDrive
from pm01_nav.errors import InputError
from pm01_nav.policy.network_policy import NetworkPolicy
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.observation import ObservationLayout, UsualParts
from pm01_nav.task.scans import ScanGeometry
from pm01_nav.task.trail import TrailLayout

GOAL, REST, ANSWER = (3.0, 0.0), (0.0, 0.0), (0.125, 0.75)
GEOMETRY = ScanGeometry(4, -math.pi, math.pi / 2, 0.1, 10.0)
DRIVE = DifferentialDrive(-0.2, 0.5, 1.5)
TRAIL = TrailLayout(sectors=4, interval_s=0.2, capacity=8, reach=2.0, near=0.5)
# 4 beams, two earlier scans of 4, distance, sine, cosine, v, w; last action; 4 sectors, familiarity
EARLIER, ACTION, VISITED = [4, 8], slice(17, 19), slice(19, 23)


class Seen:
    """A policy with every memory, and what its network is shown; it always answers the same."""

    def __init__(self) -> None:
        frames = FramesLayout(count=2, interval_s=0.2)
        parts = UsualParts(nearness_distance=0.0, trail=TRAIL, frames=frames)
        layout = ObservationLayout(GEOMETRY, DRIVE, parts.made(GEOMETRY, DRIVE))
        self.observations, self.memories = [], []
        self.policy = NetworkPolicy(layout, self._network, 0.1, memory_size=1)

    def _network(self, batch, memory):
        self.observations.append(batch.copy())
        self.memories.append(memory.copy())
        return np.tile(np.float32(ANSWER), (len(batch), 1)), memory + 1

    def act(self, distance=1.0, velocity=REST, **told):
        """Let it see one range all around; return what its network was shown."""
        self.policy.act(np.full(4, distance), GOAL, velocity, **told)
        return self.observations[-1][0]

    def earlier(self):
        """Return the earlier ranges that were shown last."""
        return self.observations[-1][0][EARLIER].tolist()


@pytest.fixture
def seen():
    return Seen()


def test_calls_on_time_are_what_calls_without_a_time_are(seen):
    other = Seen()
    for k in range(12):
        # A clock that counts from 1970, with a jitter of 4 ms; standing, so that it moves nothing.
        jitter = 0.004 * (-1) ** k
        told = {"now": 1.7e9 + 0.1 * k + jitter, "applied": ANSWER if k else REST}
        with_time = seen.act(1.0 + 0.1 * k, **told)
        assert with_time.tolist() == other.act(1.0 + 0.1 * k).tolist()
    assert seen.memories[-1] == other.memories[-1] == 11.0


def test_the_last_action_is_the_command_that_was_applied(seen):
    # At rest at the beginning environments show 0; under way it is what the robot was given.
    assert seen.act(applied=REST)[ACTION].tolist() == [0.0, 0.0]
    # Asked for were (0.125 + 0.2) / 0.35 - 1 = -0.0714 and 0.75 / 1.5.
    assert seen.act()[ACTION] == pytest.approx([-0.0714286, 0.5], abs=1e-6)
    # The supervisor halved it: 0.2625 / 0.35 - 1 = -0.25 and 0.375 / 1.5; stopped it:
    # 0.2 / 0.35 - 1 = -0.4286; and an action is never beyond 1.
    assert seen.act(applied=(0.0625, 0.375))[ACTION] == pytest.approx([-0.25, 0.25])
    assert seen.act(applied=REST)[ACTION] == pytest.approx([-0.4285714, 0.0])
    assert seen.act(applied=(0.9, -9.0))[ACTION].tolist() == [1.0, -1.0]
    seen.policy.reset()
    assert seen.act(applied=(0.5, 0.0))[ACTION] == pytest.approx([1.0, 0.0])


def test_after_a_pause_scans_and_recurrent_memory_begin_anew(seen):
    for k in range(6):
        seen.act(1.0 + k, now=0.1 * k)
    assert seen.earlier() == [4.0, 2.0]
    # Two control steps are no pause: one call was left out, and the same was to be seen then.
    seen.act(7.0, now=0.7)
    assert (seen.earlier(), seen.memories[-1][0, 0]) == ([6.0, 4.0], 6.0)
    seen.act(8.0, now=0.8)
    # More than two are: what people did meanwhile is unknown, and so is what an LSTM would hold.
    shown = seen.act(9.0, now=1.01)
    assert (seen.earlier(), seen.memories[-1][0, 0]) == ([9.0, 9.0], 0.0)
    assert shown[ACTION].tolist() == [0.0, 0.0]
    # So does a clock that goes back; a stop that was told is remembered through a pause.
    shown = seen.act(5.0, now=0.5, applied=REST)
    assert (seen.earlier(), seen.memories[-1][0, 0]) == ([5.0, 5.0], 0.0)
    assert shown[ACTION] == pytest.approx([-0.4285714, 0.0])


def test_the_trail_follows_odometry_through_a_pause(seen):
    seen.act(now=0.0, pose=(5.0, 5.0, math.pi / 2))
    # Ten minutes later somebody has carried it: 1 m ahead (along y) and turned it to look back.
    # The noted place lies 1 m ahead of it then, between the middle sectors. It weighs 1 - 1 / 2,
    # half in each: 0.25 / 1.25.
    shown = seen.act(now=600.0, pose=(5.0, 6.0, -math.pi / 2))
    assert shown[VISITED] == pytest.approx([0.0, 0.2, 0.2, 0.0])
    # Its own place is noted with the next step that is due, once; time alone notes nothing.
    shown = seen.act(now=1200.0, pose=(5.0, 6.0, -math.pi / 2))
    assert shown[VISITED] == pytest.approx([0.0, 0.2, 0.2, 0.0])
    # Without odometry nobody knows where it is after a pause.
    assert seen.act(now=1800.0)[VISITED].tolist() == [0.0] * 4


def test_the_trail_takes_the_time_that_went_by_or_the_odometry(seen):
    shown = [seen.act(velocity=(1.0, 0.0), now=now)[VISITED] for now in (0.0, 0.15, 0.3, 0.5)]
    # The first place is 0.15 m behind: 0.15 / 0.5 x (1 - 0.15 / 2) = 0.2775, half to each side.
    assert shown[1] == pytest.approx([0.13875 / 1.13875, 0, 0, 0.13875 / 1.13875], abs=1e-6)
    # 0.3 s are three steps, so that a place is noted at 0.3 m. From 0.5 m the first one weighs
    # 0.75, that one (0.2 m away) 0.4 x 0.9 = 0.36: in all half of 1.11 to each side.
    assert shown[3] == pytest.approx([0.555 / 1.555, 0, 0, 0.555 / 1.555], abs=1e-6)
    # Wheels that slip: the velocity says 0.1 m, odometry (0.2 m) knows better.
    seen.policy.reset()
    seen.act(velocity=(1.0, 0.0), pose=(1.0, 0.0, 0.0))
    # 0.2 m: 0.4 x 0.9 = 0.36, halved.
    shown = seen.act(velocity=(1.0, 0.0), pose=(1.2, 0.0, 0.0))[VISITED]
    assert shown == pytest.approx([0.18 / 1.18, 0, 0, 0.18 / 1.18], abs=1e-6)


@pytest.mark.parametrize(("period", "calls"), [(0.15, 8), (0.05, 24), (0.2, 6)])
def test_intervals_are_of_time_not_of_calls(seen, period, calls):
    for k in range(calls):
        now = period * k
        seen.act(1.0 + now, now=100.0 + now)
    # Shown are the scans of 0.2 and 0.4 s ago, to within a call and a control step.
    ago = [now - (distance - 1.0) for distance in seen.earlier()]
    assert ago == pytest.approx([0.2, 0.4], abs=max(period, 0.1) + 1e-6)


def test_a_robot_of_a_batch_keeps_its_odometry(seen):
    pair = np.array([[0.0, 0.0, 0.0], [9.0, 9.0, 0.0]])
    act = seen.policy.act
    act(np.ones((2, 4)), [GOAL] * 2, [REST] * 2, now=0.0, pose=pair, applied=[REST, (0.5, 0.0)])
    # Only the second one was under way: (0.5 + 0.2) / 0.35 - 1 = 1.
    assert seen.observations[-1][:, ACTION].tolist() == [[0.0, 0.0], [1.0, 0.0]]
    seen.policy.keep(np.array([1]))
    act(np.ones((1, 4)), [GOAL], [REST], now=9.0, pose=[[10.0, 9.0, 0.0]])
    # 1 m on, with the noted place behind: 0.25 to both sides.
    assert seen.observations[-1][0, VISITED] == pytest.approx([0.2, 0.0, 0.0, 0.2])


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"now": math.nan}, "now = nan"),
        ({"now": math.inf}, "now = inf"),
        ({"applied": (0.1,)}, "applied = .*two finite numbers"),
        ({"applied": (0.1, math.nan)}, "applied = .*two finite numbers"),
        ({"pose": (0.0, 0.0)}, "pose = .*three finite numbers"),
        ({"pose": (0.0, math.inf, 0.0)}, "pose = .*three finite numbers"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(seen, told, message):
    other = Seen()
    for policy in (seen, other):
        policy.act(1.0, (0.5, 0.0), now=0.0, pose=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=message):
        seen.act(2.0, (0.5, 0.0), **{"now": 0.05} | told)
    for policy in (seen, other):
        policy.act(1.0, (0.5, 0.0), now=0.1, pose=(0.05, 0.0, 0.0))
    assert seen.observations[-1].tolist() == other.observations[-1].tolist()
