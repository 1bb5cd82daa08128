# SPDX-License-Identifier: Apache-2.0
"""Notice robots that turn on the spot again and again instead of going anywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

TURNS = 2.0
"""A robot spins once it has turned so often to the same side without leaving the spot."""
SPOT = 0.3
"""Radius of a spot [m]."""


class SpinMeter:
    """How much of their time robots spin: more than ``TURNS`` full turns within ``SPOT``."""

    def __init__(self, pose: NDArray[np.float64]) -> None:
        """Begin with robots at ``pose`` (n, 3): x, y [m] and yaw [rad]."""
        self._place = pose[:, :2].copy()
        self._yaw = pose[:, 2].copy()
        self._turned = np.zeros(len(pose))
        self._spinning = self._steps = 0

    def note(self, pose: NDArray[np.float64], begun: NDArray[np.bool_] | None = None) -> None:
        """Note one step; ``begun`` (n,) marks robots that have begun a new episode at ``pose``."""
        turn = (pose[:, 2] - self._yaw + np.pi) % (2.0 * np.pi) - np.pi
        self._turned += turn
        away = pose[:, :2] - self._place
        left = away[:, 0] ** 2 + away[:, 1] ** 2 > SPOT**2
        if begun is not None:
            left |= begun
        self._place[left] = pose[left, :2]
        self._turned[left] = 0.0
        self._yaw[:] = pose[:, 2]
        self._spinning += int((np.abs(self._turned) > TURNS * 2.0 * np.pi).sum())
        self._steps += len(pose)

    def share(self) -> float:
        """Return the part of the steps since the last call in which robots spun, 0 to 1."""
        share = self._spinning / self._steps if self._steps else 0.0
        self._spinning = self._steps = 0
        return share

    def state_dict(self) -> dict[str, Any]:
        """Return plain data to go on from, after a call of ``share``."""
        parts = {"place": self._place, "yaw": self._yaw, "turned": self._turned}
        return {name: array.tolist() for name, array in parts.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``."""
        self._place[:] = state["place"]
        self._yaw[:] = state["yaw"]
        self._turned[:] = state["turned"]
