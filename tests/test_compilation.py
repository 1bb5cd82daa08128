# SPDX-License-Identifier: Apache-2.0
"""What is compiled, and what is loaded from an earlier time."""

from __future__ import annotations

import subprocess
import sys
import time

FUNCTION = """
import sys
from pm01_nav import compilation
from pm01_nav.compilation import seconds_compiling
sys.path.insert(0, sys.argv[1])
compilation.kernel_cache = lambda sources: sys.argv[1]
import mine
before = seconds_compiling()
assert mine.add_twice(1, 2) == 5
print(before, seconds_compiling())
"""
MODULE = """
from pm01_nav.compilation import compiled

@compiled
def twice(x):
    return 2 * x

@compiled
def add_twice(a, b):
    return a + twice(b)
"""


def test_what_compiling_takes_is_counted_and_loading_is_not(tmp_path) -> None:
    (tmp_path / "mine.py").write_text(MODULE)

    def run() -> tuple[float, float, float]:
        began = time.perf_counter()
        command = [sys.executable, "-c", FUNCTION, str(tmp_path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        before, after = map(float, done.stdout.split())
        return before, after, time.perf_counter() - began

    before, after, wall = run()
    # The function within the function is not counted twice.
    assert before == 0.0 < after < wall
    assert run()[:2] == (0.0, 0.0)


def test_a_training_imports_nothing_that_it_does_not_use() -> None:
    code = "import sys, pm01_nav.training.trainer; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    unused = ("onnx", "onnxruntime", "scipy.ndimage", "scipy.spatial", "scipy.special")
    unused += ("matplotlib", "pm01_nav.planners", "sb3_contrib", "rsl_rl", "optuna", "wandb")
    assert not set(unused) & set(done.stdout.split())
