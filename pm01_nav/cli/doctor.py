# SPDX-License-Identifier: Apache-2.0
"""``pm01 doctor``."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import click

MIN_STEPS_PER_SECOND = 100_000
"""A simulator slower than this says that something is wrong with the machine."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    name: str
    state: str
    """``ok``, ``missing`` (optional) or ``wrong``."""
    detail: str


SYMPTOMS = (
    (
        "the robot falls through the floor or shakes",
        "masses or inertias in the robot's model",
        "train here first: the planar simulator has no such model; docs/troubleshooting.md",
    ),
    (
        "the environment cannot be imported or is not registered",
        "gym.register did not run",
        'gym.make("pm01_nav.envs:PM01Nav-v1"): the prefix registers it',
    ),
    (
        "the reward does not rise",
        "reward, learning rate or network",
        "pm01 train ...; then look at reward/* and eval/* in tensorboard --logdir RUN",
    ),
    (
        "the robot spins in place or hits walls",
        "the goal's bearing is not seen, or corners are cut",
        "pm01 replay RUN -o replay.mp4; the default observation holds both",
    ),
    (
        "training is very slow",
        "a simulator that sleeps in real time",
        "see the steps/s above; pm01 train shows its own",
    ),
    (
        "ROS topics do not arrive",
        "another ROS_DOMAIN_ID or namespace",
        "see ROS 2 above; ros2 topic list",
    ),
    (
        "it drives differently when loaded",
        "another observation, normaliser or random actions",
        "use policy.onnx: it holds all three and refuses a robot that does not fit",
    ),
    (
        'the robot stands: "the scan is unusable", "the lidar does not see"',
        "the lidar's driver sends 0 or ranges beyond range_max for no return",
        "pm01 drive says which; for 0 set lidar.zero_means in the robot's YAML",
    ),
)


@click.command("doctor", short_help="Check this machine and explain what is missing.")
def command() -> None:
    """Check versions, threads, speed, GPU and optional parts, and list common troubles.

    Leaves with exit code 1 if something that training needs is wrong.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    table = Table("what", "", "detail", title="pm01 doctor")
    failed = False
    marks = {"ok": "[green]ok[/]", "missing": "[yellow]-[/]", "wrong": "[red]wrong[/]"}
    checks: tuple[Callable[[], list[Finding]], ...] = (
        _versions,
        _optional,
        _gpu,
        _ros,
        _gazebo,
        _threads,
        _speed,
    )
    for check in checks:
        for finding in check():
            failed |= finding.state == "wrong"
            table.add_row(finding.name, marks[finding.state], escape(finding.detail))
    console.print(table)
    troubles = Table("trouble", "usual cause", "what to do", title="common troubles")
    for row in SYMPTOMS:
        troubles.add_row(*row)
    console.print(troubles)
    if failed:
        raise SystemExit(1)


def _versions() -> list[Finding]:
    from pm01_nav.provenance import PACKAGES, installed_version

    good = sys.version_info >= (3, 10)
    python = Finding("Python", "ok" if good else "wrong", sys.version.split()[0])
    found = [python]
    extras = {"torch": "train", "stable-baselines3": "train", "onnxruntime": "deploy"}
    for package in PACKAGES:
        version = installed_version(package)
        hint = f"pip install 'pm01-nav[{extras.get(package, 'sim')}]'"
        found.append(Finding(package, "ok" if version else "wrong", version or hint))
    return found


def _optional() -> list[Finding]:
    parts = (
        ("matplotlib", "plots", "pip install 'pm01-nav[viz]'"),
        ("imageio_ffmpeg", "videos", "pip install 'pm01-nav[viz]'"),
        ("pygame", 'windows (render_mode="human")', "pip install 'pm01-nav[viz]'"),
        ("mujoco", "--backend mujoco", "pip install 'pm01-nav[physics]'"),
        ("pybullet", "--backend pybullet", "pip install 'pm01-nav[pybullet]'"),
    )
    return [
        Finding(name, "ok", purpose)
        if find_spec(name)
        else Finding(name, "missing", f"{purpose}: {command}")
        for name, purpose, command in parts
    ]


def _gpu() -> list[Finding]:
    if not shutil.which("nvidia-smi"):
        return [Finding("GPU", "missing", "none; not needed, training runs on the CPU")]
    query = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
    try:
        answer = subprocess.run(query, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return [Finding("GPU", "missing", "nvidia-smi does not answer; training uses the CPU")]
    return [Finding("GPU", "ok", f"{answer.stdout.strip()}; not used yet, training is on the CPU")]


def _ros() -> list[Finding]:
    found = []
    if find_spec("rclpy"):
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        found.append(Finding("ROS 2", "ok", f"rclpy found; ROS_DOMAIN_ID is {domain}"))
    else:
        hint = "not found; not needed to train (source /opt/ros/<distro>/setup.bash)"
        found.append(Finding("ROS 2", "missing", hint))
    return found


def _gazebo() -> list[Finding]:
    from pm01_nav.backends.gazebo.config import how_to_install, what_is_missing

    missing = what_is_missing()
    if missing is None:
        return [Finding("Gazebo", "ok", "Harmonic, with Python bindings: --backend gazebo")]
    detail = f"--backend gazebo: {missing}. Not needed to train. {how_to_install()}"
    return [Finding("Gazebo", "missing", detail)]


def _threads() -> list[Finding]:
    if not find_spec("torch"):
        return []
    import numba

    from pm01_nav.task.config import observation_layout
    from pm01_nav.task.tasks import task_config
    from pm01_nav.training.algorithms.ppo import PPOConfig
    from pm01_nav.training.runtime import choose_threads

    ppo, task = PPOConfig.model_validate({}), task_config("static")
    size = observation_layout(task, task.robot_spec()).size
    choice = choose_threads(0, ppo.batch_size, size, ppo.net_arch)
    simulator = f"{numba.get_num_threads()} (all cores)"
    return [
        Finding("learner threads", "ok", f"{choice.threads}: {choice.reason}"),
        Finding("simulator threads", "ok", simulator),
    ]


def _speed() -> list[Finding]:
    if not (find_spec("numba") and find_spec("gymnasium")):
        return []
    import time

    import numpy as np

    from pm01_nav.task.navigation import NavigationBatch
    from pm01_nav.task.tasks import task_config
    from pm01_nav.task.worlds import world_pool

    task = task_config("static")
    batch = NavigationBatch(task, world_pool(task, "train", 64), 256)
    batch.reset(np.arange(256))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (256, 2))
    batch.step(actions)
    began = time.perf_counter()
    for _ in range(100):
        batch.step(actions)
    rate = 100 * 256 / (time.perf_counter() - began)
    state = "ok" if rate > MIN_STEPS_PER_SECOND else "wrong"
    return [Finding("simulator", state, f"{rate:,.0f} steps/s on task static, 256 robots")]
