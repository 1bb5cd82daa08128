# SPDX-License-Identifier: Apache-2.0
"""The zoo: every policy is found by its name, fits its robot, and has a card."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml

from pm01_nav.benchmark.entry import policy_entry
from pm01_nav.benchmark.policies import load_policy, policy_file, trained_task
from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.publish import card_of, readme, write_repository
from pm01_nav.robot import load_robot
from pm01_nav.zoo import FOLDER, zoo_names

MEGABYTES = 4.0


def test_zoo_is_not_empty_and_small():
    pm01 = {"pm01-static", "pm01-mixed", "pm01-crowd"}
    assert set(zoo_names()) == pm01 | {"turtlebot3-mixed", "jackal-barn", "jackal-dynabarn"}
    size = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file())
    assert size < MEGABYTES * 1e6


@pytest.mark.parametrize("name", zoo_names())
def test_policy_is_loaded_by_its_name_and_drives(name):
    task = trained_task(f"zoo:{name}")
    assert task is not None
    policy = load_policy(f"zoo:{name}", task.robot_spec(), task.control_dt)
    assert isinstance(policy, OnnxPolicy)
    assert policy.metadata["robot"] == load_robot(task.robot).name
    scan = np.full(policy.layout.scan.num_beams, policy.layout.scan.range_max)
    # Free space and a goal ahead: it goes there.
    assert policy.act(scan, (3.0, 0.0), (0.0, 0.0))[0] > 0.0
    assert policy_entry(f"zoo:{name}").name == name


@pytest.mark.parametrize("name", zoo_names())
def test_card_says_how_it_was_made_and_what_was_measured(name):
    card = card_of(f"zoo:{name}")
    metadata = OnnxPolicy(f"zoo:{name}").metadata
    assert card["name"] == name
    assert card["robot"] == metadata["robot"]
    assert card["training"]["command"] == metadata["command"]
    assert card["training"]["command"].startswith("pm01 train ")
    assert "/tmp" not in json.dumps(metadata)
    assert card["results"]
    for result in card["results"]:
        low, high = result["success_rate_ci95"]
        assert low <= result["success_rate"] <= high
        assert result["episodes"] >= 100
    assert card["limits"]
    # No policy of the zoo spins.
    assert card["spinning"]["share"] < 0.01


def test_file_is_measured_on_the_whole_task_of_its_training():
    """As docs/guide/evaluate.md has it; the task by default fixes nothing."""
    task = trained_task("zoo:pm01-crowd")
    assert task is not None
    assert task.suite_params == {"pedestrians": 20}


def test_unknown_name_lists_what_there_is():
    with pytest.raises(InputError, match=r"zoo:nobody.*pm01-static"):
        policy_file("zoo:nobody")
    with pytest.raises(InputError, match=r"zoo:nobody.*pm01-static"):
        OnnxPolicy("zoo:nobody")
    with pytest.raises(InputError, match=r"zoo:\.\./robots"):
        policy_file("zoo:../robots")


def test_repository_has_the_layout_of_hugging_face(tmp_path):
    files = write_repository("zoo:pm01-static", tmp_path / "x")
    assert {p.name for p in files} == {"policy.onnx", "README.md", "config.json", "results.json"}
    assert (tmp_path / "x" / "policy.onnx").read_bytes() == policy_file(
        "zoo:pm01-static"
    ).read_bytes()
    text = (tmp_path / "x" / "README.md").read_text()
    _, front, body = text.split("---\n", 2)
    header = yaml.safe_load(front)
    assert header["license"] == "apache-2.0"
    assert header["model-index"][0]["name"] == "pm01-static"
    assert header["model-index"][0]["results"][0]["metrics"][0]["type"] == "success_rate"
    assert "| static | 1000 |" in body
    assert OnnxPolicy(tmp_path / "x" / "policy.onnx").layout.size > 0
    with pytest.raises(InputError, match="not an empty folder"):
        write_repository("zoo:pm01-static", tmp_path / "x")


def test_card_of_a_policy_that_was_not_measured_says_so(tmp_path):
    file = tmp_path / "mine.onnx"
    file.write_bytes(policy_file("zoo:pm01-static").read_bytes())
    card = card_of(str(file))
    assert card["name"] == "mine"
    assert "Not measured" in readme(card)


EXTRAS = {
    "train": {"torch", "stable_baselines3", "sb3_contrib", "onnx", "onnxscript", "tensorboard"},
    "viz": {"matplotlib", "imageio", "imageio_ffmpeg", "jinja2", "pygame"},
    "deploy": {"onnxruntime"},
    "sim": {
        "click",
        "defusedxml",
        "gymnasium",
        "numba",
        "PIL",
        "pydantic",
        "yaml",
        "rich",
        "scipy",
    },
}
"""What each extra of pyproject.toml has alone, as it is imported."""
WITHOUT = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in set(sys.argv[1].split(",")):
            raise ImportError(name)
sys.meta_path.insert(0, Without())
from pm01_nav.cli import pm01
pm01(sys.argv[2:])
"""


def test_card_installs_what_its_command_needs(tmp_path):
    """The command of the card runs where nothing but its extras can be imported."""
    write_repository("zoo:pm01-static", tmp_path / "x")
    card = (tmp_path / "x" / "README.md").read_text()
    extras, command = re.findall(r"pip install 'pm01-nav\[(.*)\]'\npm01 (.*)\n", card)[0]
    missing = set().union(*(EXTRAS[name] for name in EXTRAS.keys() - set(extras.split(","))))
    words = command.replace("1000", "1").split()
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, ",".join(missing), *words],
        capture_output=True,
        text=True,
        cwd=tmp_path / "x",
    )
    assert done.returncode == 0, done.stderr
    assert "success" in done.stdout
