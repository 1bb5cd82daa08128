# SPDX-License-Identifier: Apache-2.0
"""The supervisor: each reason to stop, the way ahead, and that nothing unsafe gets by."""

from __future__ import annotations

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.deploy.safety import SafetyConfig, SafetySupervisor
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
    # Within 0.31 m of contact by the new place; by the place of the scan it would be 0.41 m.
    assert verdict.time_to_contact <= 0.31 / verdict.command[0]


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
    rates=st.tuples(*[st.floats(0.0, 0.5)] * 6),
    delay=st.floats(0.0, 0.9),
)
def test_no_sequence_of_messages_leads_to_an_unsafe_command(
    safety_fuzz, seed, robot_name, rates, delay
):
    drop, double, corrupt, jump, policy, operator = rates
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


def test_the_judge_finds_what_is_unsafe(safety_fuzz, monkeypatch):
    """Without the check of the way ahead, the same judge must object."""
    monkeypatch.setattr(
        SafetySupervisor, "_share", lambda self, points, twist, slow_down=True: (1.0, math.inf)
    )
    found = set()
    for seed in range(12):
        sequence = safety_fuzz.Sequence(
            seed, safety_fuzz.robot_with("pm01", 360), safety_fuzz.HONEST
        )
        sequence.run()
        found.update(sequence.violations)
    assert found == {"drives into a disc"}
