# SPDX-License-Identifier: Apache-2.0
"""Learning curves of many seeds as one picture."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.rendering.training_plot import HELD_OUT, INK, STYLE


def plot_sweep(report: dict[str, Any], path: str | Path) -> None:
    """Draw the report of a sweep into a PNG: IQM and interval, and each evaluation of each seed.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("a plot needs: pip install 'pm01-nav[viz]'") from error
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 4.5), dpi=120, layout="constrained")
        axes = figure.subplots()
        _draw(axes, report["training_curve"], INK, "episodes in training, with exploration")
        _draw(axes, report["curve"], HELD_OUT, "greedy policy on held-out worlds; dots: each seed")
        for seconds, rates in report["curve"]["seeds"].values():
            percent = 100.0 * np.array(rates)
            axes.plot(seconds, percent, "o-", color=HELD_OUT, alpha=0.5, linewidth=0.8, ms=3.0)
        for level in (95.0, 99.0):
            axes.axhline(level, color="#b4bcc8", linewidth=0.8, linestyle="--")
        count = len(report["curve"]["seeds"])
        axes.set_title(f"{report['algorithm']} on {report['task']}, {count} seeds")
        axes.set_xlabel("training time [s]")
        axes.set_ylabel("success [%]")
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 101.0)
        axes.legend(loc="lower right", title="IQM over seeds, 95 % bootstrap interval")
        try:
            figure.savefig(partial, format="png")
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)


def _draw(axes: Any, curve: dict[str, Any], color: str, label: str) -> None:
    """Draw an interquartile mean and the band of its interval."""
    low_high = [pair or (np.nan, np.nan) for pair in curve["ci95"]]
    low, high = 100.0 * np.array(low_high, dtype=np.float64).reshape(-1, 2).T
    axes.fill_between(curve["seconds"], low, high, color=color, alpha=0.2, linewidth=0.0)
    iqm = 100.0 * np.array(curve["iqm"], dtype=np.float64)
    axes.plot(curve["seconds"], iqm, color=color, linewidth=2.0, label=label)
