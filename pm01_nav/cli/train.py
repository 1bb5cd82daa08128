# SPDX-License-Identifier: Apache-2.0
"""``pm01 train``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pm01_nav.cli import STARTED_AT
from pm01_nav.cli.imports import without_collecting
from pm01_nav.cli.options import (
    Command,
    given_settings,
    parse_changes,
    randomization_option,
    task_from_options,
    task_options,
)
from pm01_nav.cli.tables import TableOption

if TYPE_CHECKING:
    from pm01_nav.training.config import RunConfig

FLAGS = ("algo", "preset", "learner", "device", "curriculum", "seed")
FLAGS += ("time_budget", "steps", "track", "workers")
"""Options that are keys of ``train``."""
KEPT_BY_RESUME = ("algo", "preset", "learner", "device", "curriculum", "seed", "workers")
KEPT_PARAMETERS = ("n_envs", "buffer_size")
"""Hyper-parameters that a checkpoint holds arrays of."""


OPTIONS = (
    click.option(
        "--algo",
        metavar="NAME",
        cls=TableOption,
        help="The algorithm: {algorithms}.  [default: ppo]",
    ),
    click.option(
        "--preset",
        metavar="NAME",
        help="Hyper-parameters to begin with: default, or quick, PPO for budgets of some seconds.",
    ),
    click.option(
        "--learner",
        metavar="NAME",
        help="Who implements it: sb3, or rsl_rl, made for thousands of robots.  [default: sb3; "
        "rsl_rl on cuda]",
    ),
    click.option(
        "--device",
        metavar="NAME",
        help="Where robots are simulated and the policy learns: cpu, or cuda, an NVIDIA GPU.  "
        "[default: cpu]",
    ),
    click.option(
        "--n-envs",
        type=click.IntRange(1),
        metavar="N",
        help="Robots that drive side by side.  [default: the algorithm's; one a core in Gazebo]",
    ),
    click.option(
        "--curriculum",
        metavar="NAME",
        help="Which worlds come when: none (all alike), staged (easy ones first), automatic (those "
        "in which the policy can learn most).  [default: none]",
    ),
    click.option(
        "--time-budget",
        type=float,
        metavar="SECONDS",
        help="Stop after so many seconds, start-up included. [default: 60, unless --steps]",
    ),
    click.option("--steps", type=int, metavar="N", help="Stop after so many environment steps."),
    click.option(
        "--track",
        metavar="NAME",
        help="Where metrics go beside TensorBoard: none, or wandb (Weights & Biases; with "
        "WANDB_MODE=offline nothing is sent).  [default: none]",
    ),
)


def training_options(command: Command) -> Command:
    """Add the options that are keys of ``train``, but for the seed."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


@click.command("train", short_help="Train a policy.")
@task_options
@randomization_option
@training_options
@click.option("--seed", type=int, metavar="N", help="Seed of everything random. [default: 0]")
@click.option(
    "--workers",
    type=click.IntRange(1),
    metavar="N",
    help="Processes that collect the experience, beside the one that learns (ppo).",
)
@click.option(
    "--ray",
    "ray",
    metavar="ADDRESS",
    help="Put the workers on a Ray cluster (host:port, auto, or local to start one).",
)
@click.option("--out", metavar="DIR", help="Folder of the run; must be new or empty.")
@click.option("--force", is_flag=True, help="Replace a run that is already in --out.")
@click.option("--resume", metavar="DIR", help="Go on with a run as if it had never stopped.")
def command(**options: Any) -> None:
    """Train a policy and export it as policy.onnx.

    The folder of the run holds config.yaml (the effective configuration), last.pt and best.pt
    (checkpoints), history.json, tensorboard/ and policy.onnx. Ctrl-C saves and leaves; --resume
    goes on from there. With --steps the same seed gives the same learning curve; a --time-budget
    ends wherever this machine has come to.

    \b
    Examples:
      pm01 train --task static --time-budget 60 --out runs/x
      pm01 train --task static --preset quick --time-budget 15 --out runs/quick
      pm01 train --task static --randomization on --out runs/robust
      pm01 train --task mixed --curriculum automatic --time-budget 600 --out runs/mixed
      pm01 train --task barn_like --steps 20000000 --out runs/barn
      pm01 train --task static --algo sac --time-budget 300 --out runs/sac
      pm01 train --config my.yaml --set train.ppo.gamma=0.97 --out runs/y
      pm01 train --resume runs/x --time-budget 120
      pm01 train --task static --device cuda --time-budget 15 --out runs/gpu
      pm01 train --task mixed --backend mujoco --workers 8 --ray HOST:6379 --out runs/cluster
      pm01 train --task static --backend gazebo --n-envs 4 --time-budget 3600 --out runs/gazebo
    """
    from pm01_nav.errors import InputError

    with without_collecting():
        from pm01_nav.training.run_folder import RunFolder

    resume, out = options.pop("resume"), options.pop("out")
    force, ray = options.pop("force"), options.pop("ray")
    if resume:
        if out or force:
            raise InputError("--resume goes on in its own folder; leave --out and --force away")
        config = _resumed(resume, options)
    else:
        if not out:
            raise InputError("out: give --out DIR, the folder of the run")
        config = fresh_config(options)
    if ray and config.train.workers is None:
        raise InputError("--ray is for the workers; give --workers N as well")
    folder = RunFolder(resume or out)
    run_training(config, folder, resume=bool(resume), force=force, ray=ray)


def run_training(
    config: RunConfig,
    folder: Any,
    *,
    resume: bool = False,
    force: bool = False,
    ray: str | None = None,
) -> Any:
    """Train with a progress display; say what came of it."""
    from pm01_nav.cli.display import TrainingDisplay
    from pm01_nav.executors import INTERRUPTED

    with without_collecting():
        from pm01_nav.training.trainer import train

    with TrainingDisplay() as display:
        result = train(
            config,
            folder,
            display,
            started_at=STARTED_AT,
            resume=resume,
            force=force,
            ray=ray,
        )
    ended = INTERRUPTED if result.interrupted else "done"
    click.echo(f"{ended}: {result.steps:,} steps in {result.seconds:.0f} s")
    if result.best_steps:
        rate = 100.0 * result.best_success_rate
        click.echo(f"best: {rate:.1f} % success on held-out worlds, at {result.best_steps:,} steps")
    click.echo(f"wrote {folder.policy}")
    if result.interrupted:
        click.echo(f"go on with: pm01 train --resume {folder.path}")
    return result


def fresh_config(options: dict[str, Any], defaults: dict[str, Any] | None = None) -> RunConfig:
    """Return the configuration that the options of a new run describe; they are used up.

    ``defaults`` are settings of ``train`` that anything else goes before.

    Raises:
        InputError: something is unknown or not allowed.
    """
    from pm01_nav.config import merge
    from pm01_nav.training.config import preset_defaults, run_config, with_flags

    flags = {name: options.pop(name, None) for name in FLAGS}
    n_envs, file = options.pop("n_envs"), options["config_file"]
    settings: dict[str, Any] = {}
    for layer in given_settings(file, options["changes"]):
        settings = merge(settings, layer.get("train") or {})
    settings = with_flags(settings, n_envs, flags)
    preset = preset_defaults(settings.get("preset") or "default")
    task = task_from_options(None, defaults=preset.get("task"), **options)
    return run_config(task, settings, file or "configuration", defaults)


def _resumed(resume: str, options: dict[str, Any]) -> RunConfig:
    from pm01_nav.config import merge
    from pm01_nav.errors import InputError
    from pm01_nav.task.given_files import stored_task
    from pm01_nav.training.config import run_config, with_flags
    from pm01_nav.training.run_folder import RunFolder

    if options["config_file"]:
        raise InputError("--resume goes on with its own config.yaml; leave --config away")
    stored = RunFolder(resume).load_config()
    flags = {name: options.pop(name) for name in FLAGS}
    n_envs = options.pop("n_envs")
    named, task = options["task"], task_from_options(stored.task, **options)
    same = stored_task(task, Path(resume)) == stored_task(stored.task, Path(resume))
    if (named and named != stored.task.name) or not same:
        raise InputError(
            f"--resume {resume}: was made with another task ({stored.task.name}, see its "
            "config.yaml); leave the task's options away"
        )
    given = {name: value for name, value in flags.items() if value is not None}
    settings = stored.train.model_dump()
    if "steps" in given or "time_budget" in given:
        settings |= {"steps": None, "time_budget": None}
    settings = with_flags(settings, n_envs, given)
    settings = merge(settings, parse_changes(options["changes"]).get("train") or {})
    _check_kept(stored, settings, resume)
    return run_config(stored.task, settings, f"--resume {resume}")


def _check_kept(stored: RunConfig, settings: dict[str, Any], resume: str) -> None:
    """Make sure that a run goes on with what its checkpoint is of.

    Raises:
        InputError: flags or ``--set`` change it.
    """
    from pm01_nav.errors import InputError

    before, algo = stored.train.model_dump(), stored.train.algo
    section = settings[algo] if isinstance(settings[algo], dict) else before[algo]
    kept = [(name, before[name], settings[name]) for name in KEPT_BY_RESUME]
    kept += [(name, before[algo].get(name), section.get(name)) for name in KEPT_PARAMETERS]
    for name, was, now in kept:
        if now != was:
            raise InputError(f"{name}: {resume} was made with {name} {was}; it stays so")
