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
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.envs.devices import arrays_on
from pm01_nav.errors import InputError
from pm01_nav.sim.cuda_simulator import CudaSimulator
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

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


def test_too_many_environments_for_the_gpu_are_refused_with_how_many_fit():
    task = task_config("static").model_copy(update={"num_worlds": 2})
    robot, pool = task.robot_spec(), world_pool(task, "train", 2)
    small = replace(NUMPY, device="cuda", free_bytes=lambda: 3e6)
    with pytest.raises(InputError, match="environments fit") as refused:
        CudaSimulator(robot, pool, 5000, arrays=small)
    # 360 float32 ranges and 360 float32 readings alone are 2880 bytes an environment.
    fit = int(re.findall(r"at most (\d+)", str(refused.value))[0])
    assert 500 < fit < 3e6 / 2880
    CudaSimulator(robot, pool, fit, arrays=small)


def test_unknown_device_is_refused():
    with pytest.raises(InputError, match="allowed: cpu, cuda"):
        arrays_on("tpu")


def test_static_worlds_in_the_cuda_simulator():
    check(agreement("static", "5", "24", simulated=True))


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [("crowd",), ("mixed",), ("crowd", "--errors", "--omni")])
def test_other_kernels_in_the_cuda_simulator(arguments):
    check(agreement(arguments[0], "5", "24", *arguments[1:], simulated=True))


@pytest.mark.gpu
@pytest.mark.skipif(gpu_missing(), reason="no NVIDIA GPU")
@pytest.mark.parametrize("arguments", [("static",), ("crowd",), ("mixed",), ("crowd", "--errors")])
def test_kernels_on_a_gpu(arguments):
    check(agreement(arguments[0], "512", "24", *arguments[1:], simulated=False))
