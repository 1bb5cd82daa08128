# SPDX-License-Identifier: Apache-2.0
"""Figures of merit of many episodes, as plain data."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.metrics import barn_score, spl, wilson_interval
from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.provenance import shown_path
from pm01_nav.task.config import TaskConfig
from pm01_nav.worlds.suites import world_source_of

FloatArray = NDArray[np.float64]


def evaluated_in(backend: str) -> str:
    """Say where BARN scores are from, so that nobody takes them for official ones."""
    where = "planar simulator" if backend == "planar" else f"backend {backend}"
    return f"pm01 {where}, not the official BARN evaluation"


def summarize(results: EpisodeResults, config: TaskConfig) -> dict[str, Any]:
    """Return the figures of merit of episodes of one task."""
    n = len(results.success)
    won = results.success
    failed = results.failure != ""
    timeout = ~(won | results.collision | failed)
    known, crowded = np.isfinite(results.shortest_path), np.isfinite(results.intrusion)
    steps = results.steps
    summary: dict[str, Any] = {
        "task": config.name,
        "robot": shown_path(config.robot),
        "backend": config.backend,
        "episodes": n,
    }
    for name, outcome in (
        ("success_rate", won),
        ("collision_rate", results.collision),
        ("timeout_rate", timeout),
    ):
        summary[name] = float(outcome.mean())
        summary[f"{name}_ci95"] = list(wilson_interval(int(outcome.sum()), n))
    if failed.any():
        summary["failure_rate"] = float(failed.mean())
        summary["failures"] = dict(Counter(results.failure[failed].tolist()).most_common(5))
    summary |= {
        "spl": spl(won[known], results.shortest_path[known], results.path_length[known])
        if known.any()
        else None,
        "time_to_goal_s": _mean(steps[won] * config.control_dt),
        "path_length_m": _mean(results.path_length[won]),
        "min_clearance_m": _mean(results.min_clearance),
        "mean_clearance_m": _mean(results.mean_clearance),
        "mean_jerk": _mean(results.jerk),
        "turn_reversals_per_min": _mean(results.turn_reversals),
        "personal_space_intrusion": _mean(results.intrusion[crowded]),
        # A share alone would flatter who takes long.
        "personal_space_time_s": _mean(config.control_dt * (results.intrusion * steps)[crowded]),
    }
    if np.isfinite(results.reference_path).all():
        summary |= summarize_barn(results, config.backend)
    return summary | world_source_of(config.suite).figures(won)


def summarize_barn(results: EpisodeResults, backend: str) -> dict[str, Any]:
    """Return the BARN challenge's scores, labelled as ours: means of each world's mean.

    On DynaBARN the reference is the way's true length, not that of the challenge's script.
    """
    length = results.reference_path
    worlds, index = np.unique(results.world, return_inverse=True)
    runs = np.bincount(index)

    def mean_over_worlds(scores: FloatArray) -> float:
        return float(np.mean(np.bincount(index, scores) / runs))

    scores = {
        "barn_score_2024": barn_score(results.success, length, results.moving_time, (2, 8)),
        "barn_score_2022": barn_score(results.success, length, results.moving_time, (4, 8)),
    }
    won = results.success & (results.moving_time > 0)
    ratio = length[won] / 2.0 / results.moving_time[won]
    return {name: mean_over_worlds(s) for name, s in scores.items()} | {
        "barn_optimal_over_actual_time": _mean(ratio),
        "barn_worlds": len(worlds),
        "barn_evaluated_in": evaluated_in(backend),
    }


def _mean(values: NDArray[Any]) -> float | None:
    return None if len(values) == 0 or math.isnan(values.mean()) else float(values.mean())
