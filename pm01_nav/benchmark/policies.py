# SPDX-License-Identifier: Apache-2.0
"""Find the policy that a command names: a file, a run's folder, the zoo's or a planner."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pm01_nav.config import validate
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.planners import PLANNERS, make_planner
from pm01_nav.policy import OnnxPolicy, Policy
from pm01_nav.robot import RobotSpec
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.given_files import located
from pm01_nav.zoo import PREFIX, resolved, zoo_names


def load_policy(name: str, robot: RobotSpec, control_dt: float) -> Policy:
    """Return a planner built for ``robot``, or a trained policy that fits it.

    Raises:
        InputError: there is no such policy, or it does not fit the robot or the control rate.
    """
    if name in PLANNERS:
        return make_planner(name, robot, control_dt)
    policy = OnnxPolicy(policy_file(name), robot)
    if abs(policy.control_dt - control_dt) > 1e-9:
        raise InputError(
            f"{name}: acts every {policy.control_dt:g} s, but the task every {control_dt:g} s"
        )
    return policy


DESCRIBED: dict[str, Any] = {"randomization": None, "backend": "planar"}


def trained_task(name: str) -> TaskConfig | None:
    """Return the task that a run's folder or a policy file was trained on, if it is known.

    Without its randomization and its backend: policies are measured on robots as described, in the
    planar simulator, unless one asks.
    """
    if name in PLANNERS:
        return None
    if Path(name).is_dir():
        return _stored_task(Path(name)).model_copy(update=DESCRIBED)
    file = policy_file(name)
    task = OnnxPolicy(file).metadata.get("task")
    if not isinstance(task, dict):
        return None
    # A robot from elsewhere is known by its name alone, but beside it is the copy of the run.
    return validate(TaskConfig, located(task, file.parent) | DESCRIBED, name, inside="task")


def _stored_task(folder: Path) -> TaskConfig:
    path = folder / "config.yaml"
    if not path.is_file():
        raise InputError(f"{folder}: is no run folder (it has no config.yaml)")
    task = located(load_yaml(path).get("task") or {}, folder)
    return validate(TaskConfig, task, str(path), inside="task")


def policy_file(name: str) -> Path:
    """Return the file of a policy that is named by it, by its run's folder or as ``zoo:NAME``.

    Raises:
        InputError: there is none.
    """
    path = resolved(name)
    if path.is_dir():
        _stored_task(path)
        policy = path / "policy.onnx"
        if not policy.is_file():
            raise InputError(f"{name}: has no policy.onnx yet; `pm01 export {name} -o {policy}`")
        return policy
    if path.is_file():
        return path
    planners = ", ".join(sorted(PLANNERS))
    raise InputError(
        f"policy = {name!r}: no such file or run folder, nor a planner ({planners}), nor a policy "
        f"of the zoo ({', '.join(PREFIX + known for known in zoo_names())})"
    )
