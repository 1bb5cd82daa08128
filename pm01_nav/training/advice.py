# SPDX-License-Identifier: Apache-2.0
"""Look at a run's history for what goes wrong most often, and say it in plain words.

Each check compares the last quarter of a run with the quarter before, in training episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, Sequence[float]]

FEWEST_ROWS = 40
"""Iterations before which nothing is judged."""
ARRIVES = 0.9
"""With this success a run is on its way, whatever else it does."""
FLAT = 0.02
"""Success that changes by less has not changed."""
RISE = 0.1
"""A return that grows by less than this part of the terms' sum has not grown."""
SPINS = 0.1
"""More than this part of the time spent spinning is too much."""
FALLS = 0.15


def spinning(columns: Columns) -> str | None:
    """Robots turn on the spot."""
    if "spinning" not in columns:
        return None
    share = float(_quarters(columns, "spinning")[1].mean())
    if share <= SPINS:
        return None
    return (
        f"robots spend {share:.0%} of their time turning on the spot: spinning costs too little or "
        "driving too much; raise rewards.progress, or the price of rewards.turning"
    )


def reward_hacking(columns: Columns) -> str | None:
    """The return grows, but no more goals are reached."""
    before, now = _quarters(columns, "return")
    success = [float(q.mean()) for q in _quarters(columns, "success_rate")]
    if success[1] >= ARRIVES or abs(success[1] - success[0]) >= FLAT:
        return None
    rise = float(now.mean() - before.mean())
    error = np.sqrt(before.var() / len(before) + now.var() / len(now))
    sizes, rises = {}, {}
    for name in _terms(columns):
        first, second = (float(q.mean()) for q in _quarters(columns, name))
        sizes[name], rises[name] = abs(second), second - first
    if rise <= max(RISE * sum(sizes.values()), 3.0 * error):
        return None
    most = max(rises, key=lambda name: rises[name]).removeprefix("reward/")
    return (
        f"the return rose from {before.mean():.1f} to {now.mean():.1f}, most of it by the term "
        f"{most}, while success stayed at {success[1]:.0%}: this reward can be earned without "
        f"arriving; lower rewards.{most} or raise rewards.goal, and look at a film"
    )


def standing_still(columns: Columns) -> str | None:
    """Most episodes end by time, and no more goals are reached."""
    success = [float(q.mean()) for q in _quarters(columns, "success_rate")]
    late = float(_quarters(columns, "timeout_rate")[1].mean())
    if late <= 0.5 or success[1] - success[0] >= FLAT:
        return None
    return (
        f"{late:.0%} of the episodes end by time and success does not grow ({success[1]:.0%}): "
        "standing still costs less than a risk; raise the price of rewards.time, or lower that of "
        "rewards.collision"
    )


def forgetting(columns: Columns) -> str | None:
    """What was learned is lost again."""
    values = np.asarray(columns["success_rate"], dtype=np.float64)
    parts = np.array_split(values[np.isfinite(values)], 8)
    means = [float(part.mean()) for part in parts if len(part)]
    best, now = max(means), means[-1]
    if best - now <= FALLS:
        return None
    return (
        f"success fell from {best:.0%} to {now:.0%}: the updates are too large; lower the learning "
        "rate. policy.onnx is the best of the policies that were evaluated, not the last one"
    )


CHECKS: tuple[Callable[[Columns], str | None], ...] = (
    spinning,
    reward_hacking,
    standing_still,
    forgetting,
)


def findings(columns: Columns) -> dict[str, str]:
    """Return what is wrong with a run so far: the check's name -> what to say of it."""
    rows = np.isfinite(np.asarray(columns.get("success_rate", ()), dtype=np.float64)).sum()
    if rows < FEWEST_ROWS:
        return {}
    said = {check.__name__: check(columns) for check in CHECKS}
    return {name: text for name, text in said.items() if text is not None}


def _terms(columns: Columns) -> list[str]:
    return [name for name in columns if name.startswith("reward/")]


def _quarters(columns: Columns, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the quarter before the last one and the last one, without what is not known."""
    values = np.asarray(columns[name], dtype=np.float64)
    values = values[np.isfinite(values)]
    quarter = max(len(values) // 4, 1)
    return values[-2 * quarter : -quarter], values[-quarter:]
