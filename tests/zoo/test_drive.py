# SPDX-License-Identifier: Apache-2.0
"""Each policy of the zoo drives its own robot, by every way that leads to one."""

from __future__ import annotations

import re

import pytest
from click.testing import CliRunner

from pm01_nav.cli import pm01
from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.driver import Driver
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.zoo import zoo_names

LAB = """
name: lab
bounds: [0, 0, 4, 4]
discs: [[2, 2, 0.2]]
"""


@pytest.mark.parametrize("name", zoo_names())
def test_policy_drives_its_own_simulated_robot_to_a_goal(name, tmp_path):
    (tmp_path / "lab.yaml").write_text(LAB)
    ways = ("--world", str(tmp_path / "lab.yaml"), "-o", str(tmp_path / "drive"))
    # A goal is 2 to 5 m away; the slowest robot, 0.22 m/s, goes 5.5 m in that time.
    done = CliRunner().invoke(pm01, ["record", f"zoo:{name}", *ways, "--seconds", "25"])
    assert done.exit_code == 0, done.output
    goals, collisions = map(int, re.findall(r"(\d+) (?:goals|collisions)", done.output))
    assert goals >= 1
    assert collisions == 0


@pytest.mark.parametrize("name", zoo_names())
def test_drive_takes_the_robot_of_the_training(name, monkeypatch):
    driven = []
    monkeypatch.setattr(Driver, "run", lambda driver, *_: driven.append(driver.controller))
    given = ["drive", f"zoo:{name}", "--rosbridge", "ws://127.0.0.1:9090"]
    own = load_robot(load_controller(f"zoo:{name}").robot.name)
    for robot in ([], ["--robot", own.name]):
        done = CliRunner().invoke(pm01, [*given, *robot])
        assert done.exit_code == 0, done.output
    limits = [controller.robot.limits for controller in driven]
    # The Jackal drives backwards at 2 m/s; these two learned to at 0.5 m/s.
    slow = -0.5 if name.startswith("jackal-") else own.limits.linear_min
    assert limits == [own.limits.model_copy(update={"linear_min": slow})] * 2


def test_another_robot_is_refused_with_and_without_changes():
    with pytest.raises(InputError, match="does not fit robot pm01"):
        load_controller("zoo:jackal-barn", "pm01")
    with pytest.raises(InputError, match="does not fit robot jackal"):
        load_controller("zoo:pm01-static", "jackal")
