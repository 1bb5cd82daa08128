# SPDX-License-Identifier: Apache-2.0
"""Measured and predicted speeds of a drive, their difference, and what was left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN_S = 30.0
"""So much of the drive is drawn large, from its middle on: more is too dense to see [s]."""


def save_identification_plot(
    times: NDArray[np.float64],
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
    used: NDArray[np.bool_],
    path: str,
) -> None:
    """Write a picture of v and w, shapes (n, 2), over ``times`` (n,), and of their residuals.

    The speeds are those in the middle of the drive, the residuals all; what was not ``used`` (n,)
    is marked.
    """
    from matplotlib.figure import Figure

    times = _running(times)
    begin = max(0.5 * (times[-1] - SHOWN_S), 0.0)
    shown = (times >= begin) & (times <= begin + SHOWN_S)
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = figure.subplots(4, 1)
    for axis, label in enumerate(("v [m/s]", "w [rad/s]")):
        speeds, residuals = axes[2 * axis], axes[2 * axis + 1]
        speeds.plot(times[shown], measured[shown, axis], label="measured", lw=1.0)
        speeds.plot(times[shown], predicted[shown, axis], label="predicted", lw=1.0, ls="--")
        error = measured[:, axis] - predicted[:, axis]
        most = _shown_errors(error[used])
        inside = np.clip(error, -0.98 * most, 0.98 * most)
        residuals.plot(times[used], inside[used], ".", ms=2.0, label="measured - predicted")
        residuals.plot(times[~used], inside[~used], "x", ms=4.0, c="C3", label="left out")
        residuals.set_ylim(-most, most)
        for panel in (speeds, residuals):
            _shade(panel, times, ~used)
            panel.grid(alpha=0.3)
        speeds.set_ylabel(label)
        residuals.set_ylabel(f"residual {label}")
        speeds.set_xlim(begin, min(begin + SHOWN_S, times[-1]))
        residuals.set_xlim(0.0, times[-1])
    for panel in axes[:2]:
        panel.legend(loc="upper right", fontsize="small")
    axes[3].set_xlabel("time since the first odometry [s]")
    figure.savefig(path, dpi=120)


def _running(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times since the first odometry, without the hours between two drives."""
    steps = np.diff(times, prepend=times[0])
    usual = np.median(steps)
    return np.cumsum(np.where((steps < 0.0) | (steps > 60.0), usual, steps))


def _shown_errors(used: NDArray[np.float64]) -> float:
    """Return the largest error that is drawn; larger ones stand at the edge."""
    return 2.0 * float(np.quantile(np.abs(used), 0.99)) + 1e-6 if len(used) else 1.0


def _shade(panel: Axes, times: NDArray[np.float64], left_out: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], left_out, [False]]).astype(int)))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        panel.axvspan(float(times[begin]), float(times[end - 1]), color="C3", alpha=0.15, lw=0.0)
