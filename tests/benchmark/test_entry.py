# SPDX-License-Identifier: Apache-2.0
"""Who takes part, under which name, and who is refused."""

from __future__ import annotations

import pytest

from pm01_nav.benchmark.entry import Entry, planner_entry, policy_entry
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.errors import InputError


def test_a_planner_is_known_by_its_parameters() -> None:
    assert planner_entry("dwa") == planner_entry("dwa")
    assert planner_entry("dwa").fingerprint != planner_entry("mppi").fingerprint
    with pytest.raises(InputError, match="planner = 'moon': unknown; allowed: dwa, gap_following"):
        planner_entry("moon")


def test_a_policy_is_called_like_its_folder_or_file(tmp_path) -> None:
    run = tmp_path / "my-run"
    run.mkdir()
    for file in (run / "policy.onnx", tmp_path / "best.onnx"):
        file.write_bytes(b"network")
    assert policy_entry(str(run / "policy.onnx")).name == "my-run"
    assert policy_entry(str(tmp_path / "best.onnx")).name == "best"
    named = policy_entry(f"ours={tmp_path / 'best.onnx'}")
    assert (named.name, named.kind) == ("ours", "policy")


def test_a_policy_is_known_by_its_content(tmp_path) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(b"network")
    before = policy_entry(str(file))
    file.write_bytes(b"network!")
    assert policy_entry(str(file)).fingerprint != before.fingerprint


@pytest.mark.parametrize("name", ["../up", "a b", ".hidden", "", "dwa", "x" * 65])
def test_names_that_make_no_folder_are_refused(name: str, tmp_path) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(b"network")
    with pytest.raises(InputError, match="cannot be called"):
        policy_entry(f"{name}={file}")


def test_a_missing_policy_is_refused() -> None:
    with pytest.raises(InputError, match="no such file or run folder"):
        policy_entry("nowhere.onnx")


def test_a_policy_that_is_none_is_refused_by_name_of_suite_and_policy(tmp_path) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(b"network")
    with pytest.raises(InputError, match=r"a on suite empty: .*a\.onnx: is not a readable ONNX"):
        policy_entry(str(file)).load(read_suite("empty", seed=1))


def test_a_policy_that_does_not_fit_the_robot_is_refused_by_all_three_names(policy_file) -> None:
    entry = Entry("ours", "policy", str(policy_file), "")
    entry.load(read_suite("static", seed=1))
    with pytest.raises(InputError, match=r"ours on suite barn_like: .* does not fit robot jackal"):
        entry.load(read_suite("barn_like", seed=1))
