# SPDX-License-Identifier: Apache-2.0
"""Tune the classical planners on training worlds: the same number of trials for each.

python benchmarks/tune_planners.py --trials 20 --episodes 12 \
    --out benchmarks/results/tune_planners.json

Needs the extra ``tune``. The first trial is what stands in ``planners/parameters/``. A trial's
score is the mean over the tasks of: success, less 0.1 times the part of the time limit used. After
each task a trial is given up whose score so far is below the median of the trials before it.
"""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

import numpy as np
import optuna  # pyright: ignore[reportMissingImports]  # of the extra tune alone
from report import write_report

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.config import merge
from pm01_nav.planners import PLANNERS, planner_params
from pm01_nav.policy.protocol import Policy
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

TASKS = ("static", "rooms", "maze", "crowd", "barn_like")
TIME_PRICE = 0.1
"""For using all of the time limit; half of it costs as much as 5 % of the successes."""
VALIDATION_SEED = 1
"""Of the training worlds on which the best trials are compared with the first one."""
FINALISTS = 2


class Range(NamedTuple):
    """What values a parameter may take."""

    low: float
    high: float
    log: bool = False


LOOK_AHEAD = Range(0.4, 2.0, log=True)
MARGIN = Range(0.01, 0.06)
SPACES: dict[str, dict[str, Range]] = {
    "pure_pursuit": {
        "look_ahead": LOOK_AHEAD,
        "speed": Range(0.5, 1.0),
        "rotate_angle": Range(0.3, 1.5),
        "rotate_gain": Range(1.0, 4.0),
    },
    "regulated_pure_pursuit": {
        "look_ahead": LOOK_AHEAD,
        "rotate_angle": Range(0.3, 1.5),
        "least_radius": Range(0.2, 1.2),
        "proximity": Range(0.1, 0.5),
        "proximity_gain": Range(0.4, 1.0),
        "least_speed": Range(0.05, 0.4),
        "collision_time": Range(0.4, 1.5),
        "collision_margin": MARGIN,
    },
    "dwa": {
        "look_ahead": LOOK_AHEAD,
        "window": Range(0.1, 0.5),
        "horizon": Range(0.8, 2.5),
        "margin": MARGIN,
        "heading_weight": Range(0.02, 1.0, log=True),
        "progress_weight": Range(1.0, 6.0, log=True),
        "clearance_weight": Range(0.05, 1.0, log=True),
        "velocity_weight": Range(0.02, 0.5, log=True),
    },
    "mppi": {
        "look_ahead": Range(0.8, 3.0, log=True),
        "linear_std": Range(0.1, 0.5),
        "angular_std": Range(0.3, 1.2),
        "temperature": Range(0.03, 1.0, log=True),
        "gamma": Range(0.0005, 0.03, log=True),
        "repulsion_weight": Range(0.3, 5.0, log=True),
        "follow_weight": Range(2.0, 20.0, log=True),
        "angle_weight": Range(0.1, 3.0, log=True),
    },
    "vfh": {
        "look_ahead": LOOK_AHEAD,
        "active_range": Range(0.6, 2.0),
        "safety": Range(0.0, 0.1),
        "free_below": Range(0.2, 0.7),
        "blocked_above": Range(0.3, 0.95),
        "target_weight": Range(2.0, 8.0),
        "previous_weight": Range(0.5, 4.0),
        "rotate_angle": Range(0.4, 1.5),
    },
    "gap_following": {
        "reach": Range(0.6, 3.0),
        "safety": Range(0.0, 0.1),
        "gap_weight": Range(0.05, 2.0, log=True),
        "field_of_view": Range(1.2, 3.1),
        "turn_gain": Range(1.0, 4.0),
        "rotate_angle": Range(0.4, 1.5),
        "slow_distance": Range(0.2, 1.0),
        "least_speed": Range(0.05, 0.4),
    },
}


class TrainingEvaluator(Evaluator):
    """The same episodes for every trial, in training worlds."""

    def __init__(self, task: str, episodes: int, seed: int) -> None:
        """Make the worlds."""
        super().__init__(task_config(task), episodes, seed)
        self.pool = world_pool(self.config, "train", episodes, seed)

    def score(self, policy: Policy) -> dict[str, float]:
        """Return the score and what it is made of."""
        results, _ = self.run(policy)
        limit = self.config.time_limit_steps
        used = np.where(results.success, results.steps, limit) / limit
        return {
            "score": float(results.success.mean() - TIME_PRICE * used.mean()),
            "success_rate": float(results.success.mean()),
            "collision_rate": float(results.collision.mean()),
        }


def build(name: str, changes: dict[str, float], evaluator: Evaluator) -> Policy:
    """Return a planner for the task's robot, with some of its parameters changed."""
    planner, config = PLANNERS[name], evaluator.config
    params = planner.params(**merge(planner_params(name).model_dump(), changes))
    return planner.build(config.robot_spec(), config.control_dt, params)


def rounded(value: float) -> float:
    """Return a value with two digits: more would be noise."""
    return float(f"{value:.2g}")


def tune(name: str, evaluators: dict[str, TrainingEvaluator], trials: int) -> optuna.Study:
    """Search a planner's space, beginning with its present parameters."""
    space = SPACES[name]

    def objective(trial: optuna.Trial) -> float:
        changes = {
            key: rounded(trial.suggest_float(key, r.low, r.high, log=r.log))
            for key, r in space.items()
        }
        trial.set_user_attr("changes", changes)
        scores = []
        for step, evaluator in enumerate(evaluators.values()):
            scores.append(evaluator.score(build(name, changes, evaluator))["score"])
            trial.report(float(np.mean(scores)), step)
            if trial.should_prune():
                raise optuna.TrialPruned
        return float(np.mean(scores))

    pruner = optuna.pruners.MedianPruner(n_startup_trials=4)
    sampler = optuna.samplers.TPESampler(seed=0, n_startup_trials=8, multivariate=True)
    study = optuna.create_study(direction="maximize", sampler=sampler, pruner=pruner)
    present = planner_params(name).model_dump()
    study.enqueue_trial({key: present[key] for key in space})
    study.optimize(objective, n_trials=trials)
    return study


def finalists(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """Return the first trial and the best of the others."""
    first, *others = study.get_trials(states=[optuna.trial.TrialState.COMPLETE])
    others.sort(key=lambda trial: trial.value or 0.0, reverse=True)
    return [first, *others[:FINALISTS]]


def report(name: str, study: optuna.Study, episodes: int, tasks: list[str]) -> dict[str, Any]:
    """Return the finalists with their scores on other training worlds, and all trials."""
    evaluators = [TrainingEvaluator(task, 2 * episodes, VALIDATION_SEED) for task in tasks]
    final = []
    for trial in finalists(study):
        changes = trial.user_attrs["changes"]
        scores = {
            evaluator.config.name: evaluator.score(build(name, changes, evaluator))
            for evaluator in evaluators
        }
        mean = float(np.mean([score["score"] for score in scores.values()]))
        final.append({"trial": trial.number, "params": changes, "validation": mean} | scores)
    trials = [
        {"params": t.user_attrs["changes"], "state": t.state.name, "score": t.value}
        for t in study.trials
    ]
    return {"best": max(final, key=lambda f: f["validation"]), "finalists": final, "trials": trials}


def main() -> None:
    """Tune and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--planners", nargs="+", choices=list(SPACES), default=list(SPACES))
    parser.add_argument("--tasks", nargs="+", default=list(TASKS))
    parser.add_argument("--trials", type=int, default=20, help="of each planner")
    parser.add_argument("--episodes", type=int, default=12, help="of each task in a trial")
    options = parser.parse_args()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    evaluators = {task: TrainingEvaluator(task, options.episodes, 0) for task in options.tasks}
    results: dict[str, Any] = {}
    for name in options.planners:
        began = time.perf_counter()
        study = tune(name, evaluators, options.trials)
        results[name] = report(name, study, options.episodes, options.tasks)
        results[name]["seconds"] = round(time.perf_counter() - began, 1)
        write_report(options.out, {"optuna": optuna.__version__, "planners": results})


if __name__ == "__main__":
    main()
