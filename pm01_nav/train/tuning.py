# SPDX-License-Identifier: Apache-2.0
"""Search for hyper-parameters with Optuna: a study that many processes share and that goes on."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pm01_nav.config import FrozenModel, make_folder, merge, validate, write_atomically
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.provenance import provenance
from pm01_nav.train.config import RunConfig
from pm01_nav.train.run_folder import RunFolder
from pm01_nav.train.trainer import train

try:
    import optuna
    from optuna.pruners import MedianPruner
    from optuna.samplers import TPESampler
    from optuna.storages import BaseStorage, JournalStorage, RDBStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.study import MaxTrialsCallback
    from optuna.trial import Trial, TrialState
except ImportError as _error:
    raise InputError("tune: pip install 'pm01-nav[tune]'") from _error

SPACES = Path(__file__).parent / "hyperparameters"
STUDY = "pm01"
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


def load_space(path: str | Path) -> dict[str, Range]:
    """Read a search space: the names of hyper-parameters and what each may be.

    Raises:
        InputError: the file is unusable, or a range is neither ``low`` and ``high`` nor choices.
    """
    space = {}
    for name, data in load_yaml(path).items():
        if not isinstance(data, dict):
            raise InputError(f"{path}: {name}: must be a mapping with low and high, or choices")
        space[name] = validate(Range, data, str(path), inside=name)
        numbers = space[name].low is not None and space[name].high is not None
        if numbers == (space[name].choices is not None):
            raise InputError(f"{path}: {name}: give low and high, or choices")
    return space


def default_space(algorithm: str) -> dict[str, Range]:
    """Return the search space that belongs to an algorithm."""
    family = "on_policy" if algorithm.startswith("ppo") else "off_policy"
    return load_space(SPACES / f"space_{family}.yaml")


@dataclass(frozen=True)
class Tuning:
    """A search: what is trained, over which space, where it is kept."""

    folder: Path
    config: RunConfig
    space: dict[str, Range]
    storage_url: str | None = None
    """An SQL database for several machines; None keeps a file in ``folder``."""

    def study(self) -> optuna.Study:
        """Begin the study, or go on with it.

        Raises:
            InputError: the folder or the storage cannot be used.
        """
        make_folder(self.folder)
        seed = self.config.train.seed
        try:
            return optuna.create_study(
                storage=self._storage(),
                study_name=STUDY,
                direction="maximize",
                load_if_exists=True,
                sampler=TPESampler(n_startup_trials=STARTUP_TRIALS, seed=seed or None),
                pruner=MedianPruner(n_startup_trials=STARTUP_TRIALS),
            )
        except Exception as error:  # SQLAlchemy's, Optuna's and the system's have no common base
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"storage = {self.storage_url or self.folder}: {reason}") from error

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
        study.optimize(self._attempt, callbacks=[MaxTrialsCallback(trials, states=ended)])

    def _attempt(self, trial: Trial) -> float:
        """Train once; return the success of the last evaluation."""
        algo = self.config.train.algo
        chosen = {name: range_.suggest(trial, name) for name, range_ in self.space.items()}
        data = merge(self.config.model_dump(), {"train": {algo: chosen}})
        try:
            config = validate(RunConfig, data, f"trial {trial.number}")
        except InputError as error:
            # Some combinations are impossible, such as minibatches that do not divide a rollout.
            trial.set_user_attr("impossible", str(error))
            raise optuna.TrialPruned from error
        folder = RunFolder(self.folder / f"trial_{trial.number}")
        watch = TrialProgress(trial)
        train(config, folder, watch, started_at=time.perf_counter(), force=True)
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
            raise InputError(f"{self.folder}: no trial came to its end")
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
        self.success = 0.0

    def started(self, message: str) -> None:
        """Say nothing: trials run beside each other."""

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """Say nothing."""

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Report success on held-out worlds.

        Raises:
            TrialPruned: other trials did better by this time.
        """
        self.success = float(summary["success_rate"])
        self._trial.report(self.success, steps)
        if self._trial.should_prune():
            raise optuna.TrialPruned

    def warned(self, steps: int, text: str) -> None:
        """Keep a warning with the trial."""
        self._trial.set_user_attr("warning", text)


def _values(trial: Any) -> dict[str, Any]:
    return {
        name: json.loads(value) if isinstance(value, str) else value
        for name, value in trial.params.items()
    }
