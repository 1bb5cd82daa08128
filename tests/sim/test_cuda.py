# SPDX-License-Identifier: Apache-2.0
"""The kernels on a GPU agree with those on the CPU; without one, numba's CUDA simulator runs them.

The simulator calls the functions as compiled for the CPU, so there everything is the same but for
the least bits of what torch computes. It covers which thread does what, and the task on torch's
arrays. A GPU fuses a multiplication and an addition into one rounding: ten steps later numbers of
ten metres may be apart by some 1e-14 m, and the float32 of a scan by one unit in its last place.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("array_api_compat", reason="needs the extra `gpu`")

SCRIPT = Path(__file__).parent / "cuda_agreement.py"
SMALL = {"float64": 1e-9, "float32": 2e-6}
FLOAT32 = ("ranges", "nearest", "visited", "path_field", "scan", "true_scan", "observation")


def agreement(*arguments: str, simulated: bool) -> dict[str, float]:
    """Return the differences that the script finds."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": str(int(simulated))}
    command = [sys.executable, str(SCRIPT), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.strip().splitlines()[-1])


def check(found: dict[str, float]) -> None:
    """Compare differences with what rounding may cause; whole numbers and flags must be equal."""
    for name, apart in found.items():
        limit = SMALL["float32" if name.endswith(FLOAT32) else "float64"]
        assert apart <= limit, f"{name} differs by {apart}"


def gpu_missing() -> bool:
    """Tell whether there is no GPU that torch and numba can use."""
    if importlib.util.find_spec("torch") is None:
        return True
    import torch

    return not torch.cuda.is_available()


def test_static_worlds_in_the_cuda_simulator():
    check(agreement("static", "5", "24", simulated=True))


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("crowd",), ("mixed",), ("crowd", "--errors")])
def test_other_kernels_in_the_cuda_simulator(arguments):
    check(agreement(arguments[0], "5", "24", *arguments[1:], simulated=True))


@pytest.mark.gpu
@pytest.mark.skipif(gpu_missing(), reason="no NVIDIA GPU")
@pytest.mark.parametrize("arguments", [("static",), ("crowd",), ("mixed",), ("crowd", "--errors")])
def test_kernels_on_a_gpu(arguments):
    check(agreement(arguments[0], "512", "24", *arguments[1:], simulated=False))
