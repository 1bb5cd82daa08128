# SPDX-License-Identifier: Apache-2.0
"""How near those who move are to the robot."""

from __future__ import annotations

from typing import Any

from pm01_nav.arrays import array_namespace


def mover_gaps(state: Any, radius: float) -> Any:
    """Return the gaps from a circle of ``radius`` [m] around robots to all movers.

    Shape (num_envs, most movers) [m]; infinity stands for movers that are not there.
    """
    xp = array_namespace(state.pose)
    offset = state.mover_position - state.pose[:, None, :2]
    gaps = xp.sqrt(xp.sum(offset * offset, axis=-1)) - state.mover_radius - radius
    row = xp.arange(gaps.shape[1], device=gaps.device)
    return xp.where(row[None] < state.mover_count[:, None], gaps, xp.inf)


def nearest_mover(state: Any, radius: float) -> Any:
    """Return the least of ``mover_gaps``, shape (num_envs,) [m]; infinity without movers."""
    gaps, xp = mover_gaps(state, radius), array_namespace(state.pose)
    return xp.min(gaps, axis=1) if gaps.shape[1] else xp.full_like(state.clearance, xp.inf)
