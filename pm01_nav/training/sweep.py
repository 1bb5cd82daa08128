# SPDX-License-Identifier: Apache-2.0
"""Train the same thing with many seeds, measure every policy, and say what they show together."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.benchmark.policies import DESCRIBED
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.config import make_folder, to_yaml, validate, write_atomically
from pm01_nav.documents import load_json, load_yaml
from pm01_nav.errors import InputError
from pm01_nav.executors import INTERRUPTED, Executor, run_pm01
from pm01_nav.provenance import provenance, shown
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.given_files import GIVEN, copy_given, stored_task
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import RunConfig
from pm01_nav.training.statistics import curves_at, iqm_with_interval, time_to

KEPT = ("config.yaml", "history.json", "run.json", "policy.onnx")
"""Files of a run that a sweep keeps."""
EVALUATIONS = "evaluations.json"
"""The last file of a seed to be written: a seed that has it is done."""
MEASURED = "evaluation.yaml"
"""What the policies of a sweep are measured on, beside its config.yaml."""
TRAINING_TASK = "training task"
LEVELS = (0.95, 0.99)
POINTS = 200
"""Points of the learning curves in the report."""


@dataclass(frozen=True)
class SeedJob:
    """One seed of a sweep: all that another machine must know to run it."""

    config: str
    """The run's configuration as YAML."""
    seed: int
    suites: tuple[str, ...]
    """Tasks to measure the policy on (``suite_task``); none means the one it was trained on."""
    episodes: int
    eval_seed: int
    threads: int
    """Threads of simulator and learner; 0 leaves it to them."""


def suite_task(text: str, config: RunConfig) -> TaskConfig:
    """Return the task that a suite, ``NAME`` or ``NAME=PATH``, is for the policy of a run.

    The robot is the one that the policy is trained for, not the suite's own.

    Raises:
        InputError: there is no such suite, its worlds cannot be had, or it has another rate.
    """
    trained = config.task
    if text == trained.name:
        task = trained.model_copy(update=DESCRIBED)
    else:
        # Every figure of the robot is given, so that none of the suite's own changes stays.
        whole = trained.robot_spec().model_dump(mode="json")
        robot = {"robot": trained.robot, "robot_changes": whole}
        task = read_suite(text, 0).task.model_copy(update=robot)
    if abs(task.control_dt - trained.control_dt) > 1e-9:
        rates = f"every {task.control_dt:g} s, the policy every {trained.control_dt:g} s"
        raise InputError(f"suite = {text!r}: acts {rates}")
    world_pool(task, "held_out", 1)
    return task


def run_seed(job: SeedJob) -> dict[str, bytes]:
    """Train and measure in processes of their own; return the files that are worth keeping.

    Raises:
        InputError: a suite cannot be had here.
        RuntimeError: a command failed or was interrupted; the text is its last words.
    """
    environment = dict(os.environ)
    if job.threads:
        environment["NUMBA_NUM_THREADS"] = str(job.threads)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "given.yaml").write_text(job.config, encoding="utf-8")
        # Before training, which takes minutes: another machine may lack the files of a suite.
        suites = _suite_options(job, folder)
        given = ("--config", str(folder / "given.yaml"), "--seed", str(job.seed))
        threads = ("--set", f"train.threads={job.threads}") if job.threads else ()
        out = folder / f"seed_{job.seed}"
        told = run_pm01(("train", *given, *threads, "--out", str(out)), environment)
        # Ctrl-C ends a training in good order, but half a training is no result of a seed.
        if told.startswith(INTERRUPTED):
            raise RuntimeError(told.splitlines()[0])
        files = {file: (out / file).read_bytes() for file in KEPT}
        for file in filter(Path.is_file, (out / GIVEN).rglob("*")):
            files[file.relative_to(out).as_posix()] = file.read_bytes()
        measured = {}
        for suite, chosen in suites.items():
            many = ("--episodes", str(job.episodes), "--seed", str(job.eval_seed), "--json", "-")
            text = run_pm01(("evaluate", str(out), *chosen, *many), environment)
            measured[shown(suite)] = json.loads(text)
    return files | {EVALUATIONS: json.dumps(measured, indent=2).encode()}


def _suite_options(job: SeedJob, folder: Path) -> dict[str, tuple[str, ...]]:
    """Return the options of `pm01 evaluate` for each suite; write tasks into ``folder``."""
    if not job.suites:
        return {TRAINING_TASK: ()}
    config = validate(RunConfig, load_yaml(folder / "given.yaml"), "sweep")
    options = {}
    for number, suite in enumerate(job.suites):
        task = suite_task(suite, config)
        file = folder / f"suite_{number}.yaml"
        file.write_text(to_yaml({"task": task.model_dump(mode="json")}), encoding="utf-8")
        options[suite] = ("--task", task.name, "--config", str(file))
    return options


class Sweep:
    """Many seeds of one configuration in a folder, which can be gone on with."""

    def __init__(self, folder: Path, config: RunConfig, seeds: Sequence[int]) -> None:
        """Name the folder and the runs; nothing is read or written."""
        self.folder, self.config, self.seeds = folder, config, list(seeds)

    def missing(self, job: SeedJob) -> list[int]:
        """Return the seeds that are not done, each to be measured as ``job`` says.

        Raises:
            InputError: the folder cannot be written, or holds a sweep of another configuration or
                one that was measured on other episodes.
        """
        shared = self.config.model_copy(update={"task": stored_task(self.config.task, self.folder)})
        mine = shared.model_dump(mode="json")
        stored = self.folder / "config.yaml"
        if stored.is_file():
            its = validate(RunConfig, load_yaml(stored), str(stored))
            if its.model_dump(mode="json") != mine:
                raise InputError(
                    f"out = {self.folder}: holds a sweep with other settings (see its config.yaml)"
                )
        elif self.folder.is_dir() and any(self.folder.iterdir()):
            raise InputError(f"out = {self.folder}: is not empty and no sweep")
        measured = _measurement(job.suites, job.episodes, job.eval_seed)
        before = self._measured_before()
        if before not in (None, measured):
            raise InputError(
                f"out = {self.folder}: its seeds were measured with {_as_options(before)}, not "
                f"{_as_options(measured)}; give the same again, or another --out"
            )
        make_folder(self.folder)
        copy_given(self.config.task, self.folder)
        write_atomically(stored, to_yaml(mine))
        write_atomically(self.folder / MEASURED, to_yaml(measured))
        return [s for s in self.seeds if not (self._seed_folder(s) / EVALUATIONS).is_file()]

    def _measured_before(self) -> dict[str, Any] | None:
        """Return what the seeds that are done were measured on; None if none is."""
        done = sorted(self.folder.glob(f"seed_*/{EVALUATIONS}"))
        if not done:
            return None
        if (self.folder / MEASURED).is_file():
            return load_yaml(self.folder / MEASURED)
        # Sweeps from before that file was written tell it by their figures.
        found = load_json(done[0])
        first = next(iter(found.values()))
        return _measurement(set(found) - {TRAINING_TASK}, first["episodes"], first["seed"])

    def run(
        self, executor: Executor, job: SeedJob, told: Callable[[int, str | None], None]
    ) -> dict[int, str]:
        """Run the missing seeds like ``job``; return errors, of which ``told`` hears at once."""
        missing = self.missing(job)
        jobs = [replace(job, seed=seed) for seed in missing]
        failed: dict[int, str] = {}
        for done in executor.run(run_seed, jobs):
            seed = missing[done.index]
            if done.error is None:
                self._keep(seed, done.result)
            else:
                failed[seed] = done.error
            told(seed, done.error)
        return failed

    def report(self) -> dict[str, Any]:
        """Return what the seeds that are done show, one by one and together.

        Raises:
            InputError: none is done.
        """
        done = [s for s in self.seeds if (self._seed_folder(s) / EVALUATIONS).is_file()]
        if not done:
            raise InputError(f"{self.folder}: no seed is done")
        runs = [self._describe(seed) for seed in done]
        suites = list(runs[0]["success_rate"])
        scores = np.array([[run["success_rate"][suite] for suite in suites] for run in runs])
        together: dict[str, Any] = {"all": iqm_with_interval(scores)}
        for k, suite in enumerate(suites):
            together[suite] = iqm_with_interval(scores[:, k : k + 1])
        return {
            "task": self.config.task.name,
            "algorithm": self.config.train.algo,
            "seeds_done": done,
            "seeds_missing": [s for s in self.seeds if s not in done],
            "success_rate": together,
            "runs": runs,
            **self._curves(done),
            **provenance(),
        }

    def _describe(self, seed: int) -> dict[str, Any]:
        history = load_json(self._seed_folder(seed) / "history.json")
        measured = load_json(self._seed_folder(seed) / EVALUATIONS)
        rates, seconds = history["eval_success_rate"], history["eval_seconds"]
        names = ("success_rate", "collision_rate", "timeout_rate", "spl")
        return {
            "seed": seed,
            "steps": int(history["steps"][-1]),
            "seconds": round(history["seconds"][-1], 1),
            **{name: {suite: m[name] for suite, m in measured.items()} for name in names},
            **{f"seconds_to_{level:.0%}": time_to(rates, seconds, level) for level in LEVELS},
        }

    def _curves(self, done: Sequence[int]) -> dict[str, Any]:
        """Return success over time, of all seeds: in training, and on held-out worlds."""
        histories = [load_json(self._seed_folder(s) / "history.json") for s in done]
        held_out = [(h["eval_seconds"], h["eval_success_rate"]) for h in histories]
        seeds = {str(s): [list(x), list(y)] for s, (x, y) in zip(done, held_out, strict=True)}
        return {
            "training_curve": _together([_known(h) for h in histories]),
            "curve": _together(held_out) | {"seeds": seeds},
        }

    def _keep(self, seed: int, files: dict[str, bytes]) -> None:
        folder = self._seed_folder(seed)
        for name, content in sorted(files.items(), key=lambda item: item[0] == EVALUATIONS):
            make_folder((folder / name).parent)
            write_atomically(folder / name, content)

    def _seed_folder(self, seed: int) -> Path:
        return self.folder / f"seed_{seed}"


def _known(history: dict[str, Any]) -> tuple[list[float], list[float]]:
    """Return seconds and success in training from the first episode that ended."""
    pairs = zip(history["seconds"], history["success_rate"], strict=True)
    known = [(x, y) for x, y in pairs if y is not None]
    return [x for x, _ in known], [y for _, y in known]


def _together(curves: Sequence[tuple[Sequence[float], Sequence[float]]]) -> dict[str, Any]:
    """Return the interquartile mean of curves (x, y) with its interval, once all have begun."""
    begun = [(x, y) for x, y in curves if len(x)]
    if not begun:
        return {"seconds": [], "iqm": [], "ci95": []}
    times = np.linspace(max(min(x) for x, _ in begun), max(max(x) for x, _ in begun), POINTS)
    rows = curves_at(times, begun)
    found = [iqm_with_interval(rows[:, [k]]) for k in range(len(times))]
    return {
        "seconds": times.round(2).tolist(),
        "iqm": [f["iqm"] for f in found],
        "ci95": [f["ci95"] for f in found],
    }


def _measurement(suites: Iterable[str], episodes: int, seed: int) -> dict[str, Any]:
    """Return what decides which episodes a policy is measured on, as plain data.

    Raises:
        InputError: two suites' files have the same name.
    """
    named = sorted({shown(suite) for suite in suites})
    if len(named) < len(set(suites)):
        raise InputError(f"suite: two have the same name ({', '.join(named)}); give each its own")
    return {"suites": named, "episodes": episodes, "seed": seed}


def _as_options(measurement: dict[str, Any]) -> str:
    suites = "".join(f"--suite {suite} " for suite in measurement["suites"])
    return f"{suites}--episodes {measurement['episodes']} (worlds of seed {measurement['seed']})"
