# SPDX-License-Identifier: Apache-2.0
"""Measured and predicted speeds of a drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SHOWN_S = 30.0
"""So much of the drive is drawn, from its middle on: more is too dense to see [s]."""


def save_identification_plot(
    times: NDArray[np.float64],
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
    path: str,
) -> None:
    """Write a picture of v and w, shapes (n, 2), over ``times`` (n,)."""
    from matplotlib.figure import Figure

    middle = 0.5 * (times[0] + times[-1] - SHOWN_S)
    shown = (times >= middle) & (times <= middle + SHOWN_S)
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for axis, label in enumerate(("v [m/s]", "w [rad/s]")):
        axes[axis].plot(times[shown], measured[shown, axis], label="measured", lw=1.0)
        axes[axis].plot(times[shown], predicted[shown, axis], label="predicted", lw=1.0, ls="--")
        axes[axis].set_ylabel(label)
        axes[axis].grid(alpha=0.3)
    axes[0].legend(loc="upper right")
    axes[1].set_xlabel("time [s]")
    figure.savefig(path, dpi=120)
