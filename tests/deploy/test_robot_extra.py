# SPDX-License-Identifier: Apache-2.0
"""The extra ``robot`` suffices to read robots, tasks and policies and to drive, without numba."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WITHOUT = """
import sys

ABSENT = {
    "gymnasium", "matplotlib", "numba", "onnx", "PIL", "pandas", "rich", "sb3_contrib", "scipy",
    "stable_baselines3", "tensorboard", "torch",
}

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
"""
DRIVE = """
import sys

import numpy as np
from click.testing import CliRunner

from pm01_nav import OnnxPolicy, TaskConfig, load_robot
from pm01_nav.arrays import NUMPY
from pm01_nav.backends import backend
from pm01_nav.cli import pm01
from pm01_nav.task.config import observation_layout
from pm01_nav.task.observation import Observer
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.tasks import TASKS

# `mixed` has a trail and earlier scans, too.
for name in ("pm01-static", "pm01-mixed"):
    policy = OnnxPolicy(f"zoo:{name}", load_robot("pm01"))
    task = TASKS[policy.metadata["task"]["name"]]()
    layout = observation_layout(task, task.robot_spec())
    assert layout == policy.layout
    Observer(layout, lambda part: part.memory(1, 0.1, NUMPY))
    for k in range(5):
        command = policy.act(np.full(360, 3.0), (2.0, 0.1), (0.05 * k, 0.0))
        assert command.shape == (2,) and np.isfinite(command).all()

perturbed = TaskConfig(**{**TASKS["static"]().model_dump(), "randomization": {"slip": (0.0, 0.1)}})
assert perturbed.randomization.ranges(load_robot("pm01"), 0.1).slip.tolist() == [0.0, 0.1]

backend("ice")(lambda *_: None)
assert TaskConfig(**{**TASKS["static"]().model_dump(), "backend": "ice"}).backend == "ice"

for words in (["--help"], ["drive", "--help"]):
    said = CliRunner().invoke(pm01, words)
    assert said.exit_code == 0, said.output
print("driven without", *sorted({"numba", "scipy", "torch"} - set(sys.modules)))
"""
SAID = "driven without numba scipy torch"


def run(*command: object, cwd: Path) -> str:
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_robots_tasks_and_policies_are_read_where_the_simulator_is_not_installed():
    assert run(sys.executable, "-c", WITHOUT + DRIVE, cwd=ROOT) == SAID


@pytest.mark.slow
def test_an_environment_with_that_extra_alone_drives(tmp_path):
    run(sys.executable, "-m", "venv", tmp_path / "env", cwd=tmp_path)
    python = tmp_path / "env" / "bin" / "python"
    pins = ("-c", ROOT / "constraints.txt")
    run(python, "-m", "pip", "install", "--quiet", *pins, f"{ROOT}[robot]", cwd=tmp_path)
    # Not from the checkout, which PYTHONPATH may name.
    assert run(python, "-I", "-c", DRIVE, cwd=tmp_path) == SAID
    assert "--goal" in run(tmp_path / "env" / "bin" / "pm01", "drive", "--help", cwd=tmp_path)
