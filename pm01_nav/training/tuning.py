# SPDX-License-Identifier: Apache-2.0
"""Search for hyper-parameters with Optuna: a study that many processes share and that goes on."""

from __future__ import annotations

import json
import logging
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import model_validator

from pm01_nav.config import FrozenModel, make_folder, merge, validate, write_atomically
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.provenance import provenance, shown
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.config import RunConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train

try:
    import optuna
    from optuna.pruners import MedianPruner
    from optuna.samplers import TPESampler
    from optuna.storages import BaseStorage, JournalStorage, RDBStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.study import MaxTrialsCallback
    from optuna.trial import FrozenTrial, Trial, TrialState
except ImportError as _error:
    raise InputError("tune: pip install 'pm01-nav[tune]'") from _error

SPACES = Path(__file__).parent / "hyperparameters"
STUDY = "pm01"
SUBJECT = "subject"
"""The study's attribute that says what it is about."""
NOT_SUBJECT = {"seed", "threads", "workers", "checkpoint_every", "track"}
"""Settings of ``train`` that may change while a search goes on."""
DIFFERENCES_NAMED = 4
OPTUNA_TRIALS = "optuna.study._optimize"
"""The logger on which Optuna tells how a trial ended."""
STARTUP_TRIALS = 5
"""Trials that are never cut short, and before which values are drawn at random."""


class Range(FrozenModel):
    """What one hyper-parameter may be: between two numbers, or one of several."""

    low: float | None = None
    high: float | None = None
    log: bool = False
    """Whether orders of magnitude are equally likely."""
    integer: bool = False
    choices: list[Any] | None = None

    @model_validator(mode="after")
    def _can_be_drawn_from(self) -> Range:
        if (self.low is not None and self.high is not None) == (self.choices is not None):
            raise ValueError("give low and high, or choices")
        if self.choices is not None and not self.choices:
            raise ValueError("choices: give one or more")
        if self.low is not None and self.high is not None:
            _check_limits(self.low, self.high, log=self.log, integer=self.integer)
        return self

    def suggest(self, trial: Trial, name: str) -> Any:
        """Let Optuna choose."""
        if self.choices is not None:
            # Optuna wants plain values; lists are told apart by their text.
            texts = [json.dumps(choice) for choice in self.choices]
            return json.loads(str(trial.suggest_categorical(name, texts)))
        assert self.low is not None
        assert self.high is not None
        if self.integer:
            return trial.suggest_int(name, int(self.low), int(self.high), log=self.log)
        return trial.suggest_float(name, self.low, self.high, log=self.log)


def _check_limits(low: float, high: float, *, log: bool, integer: bool) -> None:
    """Refuse limits between which Optuna cannot draw.

    Raises:
        ValueError: they are in the wrong order, or not of the kind that is asked for.
    """
    if low > high:
        raise ValueError(f"low = {low:g} must not exceed high = {high:g}")
    if log and low <= 0.0:
        raise ValueError(f"low = {low:g} must be positive where log is true")
    if integer and not (low.is_integer() and high.is_integer()):
        raise ValueError("low and high must be whole numbers where integer is true")


def load_space(path: str | Path, algorithm: str) -> dict[str, Range]:
    """Read a search space: the names of an algorithm's hyper-parameters and what each may be.

    Raises:
        InputError: the file is unusable, the algorithm has no such hyper-parameter, or a range
            cannot be drawn from.
    """
    allowed = ALGORITHMS[algorithm].model_fields
    space = {}
    for name, data in load_yaml(path).items():
        if name not in allowed:
            raise InputError(
                f"{path}: {name}: {algorithm} has no such hyper-parameter; "
                f"allowed here: {', '.join(allowed)}"
            )
        if not isinstance(data, dict):
            raise InputError(f"{path}: {name}: must be a mapping with low and high, or choices")
        space[name] = validate(Range, data, str(path), inside=name)
    return space


def default_space(algorithm: str) -> dict[str, Range]:
    """Return the search space that belongs to an algorithm."""
    family = "off_policy" if ALGORITHMS[algorithm].off_policy else "on_policy"
    return load_space(SPACES / f"space_{family}.yaml", algorithm)


def subject(config: RunConfig, space: dict[str, Range]) -> dict[str, Any]:
    """Return what must be the same for the success rates of two searches to compare."""
    algo = config.train.algo
    task = config.task.model_dump(mode="json")
    for name in ("robot", "map", "worlds"):
        # Another machine may have the file in another place.
        task[name] = task[name] and Path(task[name]).name
    settings = config.train.model_dump(mode="json", exclude=NOT_SUBJECT)
    settings[algo] = {name: v for name, v in settings[algo].items() if name not in space}
    ranges = {name: range_.model_dump(mode="json") for name, range_ in space.items()}
    return {"task": task, "train": settings, "space": ranges}


def differences(one: dict[str, Any], other: dict[str, Any], inside: str = "") -> list[str]:
    """Name the keys whose values differ; a key that is missing is None."""
    found = []
    for key in dict.fromkeys([*one, *other]):
        mine, its = one.get(key), other.get(key)
        if isinstance(mine, dict) and isinstance(its, dict):
            found += differences(mine, its, f"{inside}{key}.")
        elif mine != its:
            found.append(inside + key)
    return found


@dataclass(frozen=True)
class Tuning:
    """A search: what is trained, over which space, where it is kept."""

    folder: Path
    config: RunConfig
    space: dict[str, Range]
    storage_url: str | None = None
    """An SQL database for several machines; None keeps a file in ``folder``."""
    worker: int = 0
    """Which of those that work on the study at the same time this one is."""

    def study(self) -> optuna.Study:
        """Begin the study, or go on with it.

        Raises:
            InputError: the folder cannot be made, the storage cannot be used, or it holds a search
                for something else.
        """
        make_folder(self.folder)
        try:
            study = optuna.create_study(
                storage=self._storage(),
                study_name=STUDY,
                direction="maximize",
                load_if_exists=True,
                pruner=MedianPruner(n_startup_trials=STARTUP_TRIALS),
            )
        except Exception as error:  # SQLAlchemy's, Optuna's and the system's have no common base
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"storage = {self.storage_url or self.folder}: {reason}") from error
        self._check_subject(study)
        study.sampler = self._sampler(study)
        return study

    def _check_subject(self, study: optuna.Study) -> None:
        """Make sure that success rates of this study and of this search can be compared.

        Raises:
            InputError: the study is about something else.
        """
        mine = subject(self.config, self.space)
        kept = study.user_attrs.get(SUBJECT)
        if kept is None:  # it is new, or older than this check
            study.set_user_attr(SUBJECT, mine)
            return
        if others := differences(kept, mine):
            where = f"storage = {self.storage_url}" if self.storage_url else f"out = {self.folder}"
            more = ", ..." if len(others) > DIFFERENCES_NAMED else ""
            named = ", ".join(others[:DIFFERENCES_NAMED]) + more
            raise InputError(f"{where}: holds a search with other settings ({named})")

    def _sampler(self, study: optuna.Study) -> TPESampler:
        """Return what proposes values.

        Each worker draws its own, and who goes on does not draw the first trials again.
        """
        seed: int | None = None
        if self.config.train.seed:
            trials = len(study.get_trials(deepcopy=False))
            words = (self.config.train.seed, self.worker, trials)
            seed = int(np.random.SeedSequence(words).generate_state(1)[0])
        return TPESampler(n_startup_trials=STARTUP_TRIALS, seed=seed)

    def _storage(self) -> BaseStorage:
        if self.storage_url is not None:
            return RDBStorage(self.storage_url)
        return JournalStorage(JournalFileBackend(str(self.folder / "study.journal")))

    def work(self, trials: int) -> None:
        """Try until the study, whoever works on it, has so many trials that came to an end."""
        study = self.study()
        ended = (TrialState.COMPLETE, TrialState.PRUNED)
        if len(study.get_trials(deepcopy=False, states=ended)) >= trials:
            return
        # Optuna logs a failed trial with its traceback; who presses Ctrl-C knows why it failed.
        logging.getLogger(OPTUNA_TRIALS).addFilter(_without_traceback)
        study.optimize(self._attempt, callbacks=[MaxTrialsCallback(trials, states=ended)])

    def _attempt(self, trial: Trial) -> float:
        """Train once; return the success of the last evaluation.

        Raises:
            TrialPruned: the trial was cut short, or its settings do not work.
            KeyboardInterrupt: Ctrl-C ended the training, in good order; it ends the search as well.
        """
        algo = self.config.train.algo
        chosen = {name: range_.suggest(trial, name) for name, range_ in self.space.items()}
        data = merge(self.config.model_dump(), {"train": {algo: chosen}})
        try:
            config = validate(RunConfig, data, f"trial {trial.number}")
        except InputError as error:
            # Some combinations are impossible, such as minibatches that do not divide a rollout.
            raise _given_up(trial, "impossible", error) from error
        folder = RunFolder(self.folder / f"trial_{trial.number}")
        watch = TrialProgress(trial)
        try:
            result = train(config, folder, watch, started_at=time.perf_counter(), force=True)
        except (ValueError, AssertionError) as error:
            # InputError is a ValueError; libraries refuse settings with either of the two.
            raise _given_up(trial, "failed", error) from error
        if result.interrupted:
            raise KeyboardInterrupt
        return watch.success

    def report(self) -> dict[str, Any]:
        """Return the trials from best to worst and how to train with the best of them.

        Raises:
            InputError: no trial came to its end.
        """
        study = self.study()
        trials = study.get_trials(deepcopy=False)
        complete = [t for t in trials if t.state == TrialState.COMPLETE and t.value is not None]
        if not complete:
            raise InputError(f"{self.folder}: no trial came to its end{_last_reason(trials)}")
        complete.sort(key=lambda trial: -(trial.value or 0.0))
        best = complete[0]
        return {
            "task": self.config.task.name,
            "algorithm": self.config.train.algo,
            "states": {s.name: sum(t.state == s for t in trials) for s in TrialState},
            "best": {"trial": best.number, "success_rate": best.value, "values": _values(best)},
            "trials": [
                {"trial": t.number, "success_rate": t.value, "values": _values(t)} for t in complete
            ],
            **provenance(),
        }

    def write_report(self) -> dict[str, Any]:
        """Write tuning.json, and best.yaml, which `pm01 train --config` takes."""
        from pm01_nav.config import to_yaml

        report = self.report()
        write_atomically(self.folder / "tuning.json", json.dumps(report, indent=2) + "\n")
        algo = self.config.train.algo
        best = {"train": {"algo": algo, algo: report["best"]["values"]}}
        write_atomically(self.folder / "best.yaml", to_yaml(best))
        return report


class TrialProgress:
    """Tell Optuna of each evaluation, and end a trial that is not worth its time."""

    def __init__(self, trial: Trial) -> None:
        """Watch one trial."""
        self._trial = trial
        self._evaluations = 0
        self._is_behind = False
        self.success = 0.0

    def started(self, message: str) -> None:
        """Say nothing: trials run beside each other."""

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """End a trial that was behind at its last evaluation.

        Not at the evaluation itself: it may be the final one, and a finished trial counts.

        Raises:
            TrialPruned: it was behind, and its budget is not spent yet.
        """
        if self._is_behind and fraction < 1.0:
            raise optuna.TrialPruned

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Report success on held-out worlds."""
        self.success = float(summary["success_rate"])
        self._evaluations += 1
        # The pruner compares equal numbers alone, and steps depend on what is searched.
        self._trial.report(self.success, self._evaluations)
        self._is_behind = self._trial.should_prune()

    def warned(self, steps: int, text: str) -> None:
        """Keep a warning with the trial."""
        self._trial.set_user_attr("warning", text)


def _without_traceback(record: logging.LogRecord) -> bool:
    """Take the traceback from the record of a trial that Ctrl-C ended."""
    if record.exc_info and isinstance(record.exc_info[1], KeyboardInterrupt):
        record.exc_info = None
    return True


def _given_up(trial: Trial, how: str, error: Exception) -> optuna.TrialPruned:
    """Keep with a trial why its settings do not work; return what tells Optuna to go on."""
    reason = shown(" ".join(str(error).split())) or type(error).__name__
    trial.set_user_attr(how, reason)
    return optuna.TrialPruned(reason)


def _last_reason(trials: list[FrozenTrial]) -> str:
    """Return why the last trial whose settings did not work was given up, if there is one."""
    for trial in reversed(trials):
        for how in ("failed", "impossible"):
            if how in trial.user_attrs:
                return f"; trial {trial.number} {how}: {trial.user_attrs[how]}"
    return ""


def _values(trial: Any) -> dict[str, Any]:
    return {
        name: json.loads(value) if isinstance(value, str) else value
        for name, value in trial.params.items()
    }
