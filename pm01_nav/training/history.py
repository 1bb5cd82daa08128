# SPDX-License-Identifier: Apache-2.0
"""What happened in a run, one entry an iteration: for the plot, the log and the progress bar."""

from __future__ import annotations

import json
from collections import deque
from typing import Any

import numpy as np
import torch

from pm01_nav.task.outcomes import Episodes

WINDOW = 2000
"""Episodes that training rates are averaged over."""


class History:
    """Training episodes summed up an iteration at a time, and evaluations as they come."""

    def __init__(self) -> None:
        """Start with nothing."""
        self.columns: dict[str, list[float]] = {}
        self._recent: deque[tuple[bool, bool]] = deque(maxlen=WINDOW)
        self._episodes: list[Episodes] = []

    def add_episodes(self, episodes: Episodes) -> None:
        """Note the episodes that ended in one step."""
        self._episodes.append(episodes)
        endings = zip(episodes.success.tolist(), episodes.collision.tolist(), strict=True)
        self._recent.extend(endings)

    def end_iteration(
        self,
        seconds: float,
        steps: int,
        curriculum: dict[str, float],
        more: dict[str, float] | None = None,
    ) -> dict[str, float]:
        """Close an iteration and return its row; rates are over the last ``WINDOW`` episodes.

        The metrics of a ``curriculum`` are put down as ``curriculum/<name>``, ``more`` as they are.
        """
        row: dict[str, float] = {"seconds": seconds, "steps": float(steps)}
        recent = np.array(self._recent, dtype=np.float64).reshape(-1, 2)
        if len(recent):
            success, collision = recent.mean(axis=0)
            row |= {
                "success_rate": float(success),
                "collision_rate": float(collision),
                "timeout_rate": float(1.0 - success - collision),
            }
        else:
            row |= dict.fromkeys(("success_rate", "collision_rate", "timeout_rate"), float("nan"))
        row |= self._episode_means()
        row |= {f"curriculum/{name}": value for name, value in curriculum.items()}
        row |= more or {}
        self._episodes.clear()
        # What only became known now was not known before.
        before = [float("nan")] * len(self.columns.get("seconds", ()))
        for name, value in row.items():
            self.columns.setdefault(name, list(before)).append(value)
        return row

    def add_evaluation(self, seconds: float, summary: dict[str, Any]) -> None:
        """Note an evaluation on held-out worlds."""
        low, high = summary["success_rate_ci95"]
        row = {
            "eval_seconds": seconds,
            "eval_success_rate": summary["success_rate"],
            "eval_success_low": low,
            "eval_success_high": high,
        }
        for name, value in row.items():
            self.columns.setdefault(name, []).append(value)

    def to_json(self) -> str:
        """Return the columns as JSON; null where nothing was known yet."""
        columns = {
            name: [None if value != value else value for value in values]
            for name, values in self.columns.items()
        }
        return json.dumps(columns)

    def state_dict(self) -> dict[str, Any]:
        """Return tensors and plain data to go on from."""
        # A million numbers are written at once as tensors; one by one it would take seconds.
        columns = {n: torch.tensor(v, dtype=torch.float64) for n, v in self.columns.items()}
        return {"columns": columns, "recent": torch.tensor(list(self._recent), dtype=torch.bool)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``."""
        # Checkpoints of early versions hold lists.
        columns = state["columns"].items()
        self.columns = {n: torch.as_tensor(v, dtype=torch.float64).tolist() for n, v in columns}
        recent = torch.as_tensor(state["recent"]).tolist()
        self._recent.extend((bool(success), bool(collision)) for success, collision in recent)

    def _episode_means(self) -> dict[str, float]:
        if not self._episodes:
            names = [n for n in self.columns if n in ("return", "length") or "/" in n]
            return {name: self.columns[name][-1] for name in names}
        terms = self._episodes[0].terms
        means = {
            f"reward/{name}": float(np.concatenate([e.terms[name] for e in self._episodes]).mean())
            for name in terms
        }
        total = sum(abs(mean) for mean in means.values()) or 1.0
        shares = {f"reward_share/{name}": abs(means[f"reward/{name}"]) / total for name in terms}
        returns = np.concatenate([e.returns for e in self._episodes])
        steps = np.concatenate([e.steps for e in self._episodes])
        return {"return": float(returns.mean()), "length": float(steps.mean()), **means, **shares}
