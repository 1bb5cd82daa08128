# SPDX-License-Identifier: Apache-2.0
"""Thousands of goals, preempted, canceled and reached: each ends once, as what was done to it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_each_of_5000_goals_ends_as_it_should(rclpy, policy_file, tmp_path):
    out = tmp_path / "actions.json"
    command = [sys.executable, str(ROOT / "benchmarks" / "deploy_actions.py")]
    command += ["--policy", str(policy_file), "--goals", "5000", "--out", str(out)]
    subprocess.run(command, check=True, timeout=900)
    found = json.loads(out.read_text())
    # Of 5000 goals every hundredth is reached (4), of the rest every fifth is canceled (5), the
    # others are preempted (6).
    expected = {"reached": {"4": 50}, "canceled": {"5": 950}, "preempted": {"6": 4000}}
    assert found["ends_by_kind_and_status"] == expected
