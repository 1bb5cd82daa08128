# SPDX-License-Identifier: Apache-2.0
"""How far a robot moved between two scans: point-to-line ICP (Censi, ICRA 2008)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import to_world

FloatArray = NDArray[np.float64]
ITERATIONS = 30
REACH = 0.15
"""Points further apart than this do not belong together [m]."""
MIN_POINTS = 30
GAP = 0.1
"""Neighbours on one surface are no further apart than this [m]."""


def match(before: FloatArray, after: FloatArray, guess: FloatArray) -> FloatArray | None:
    """Return the pose of the second scan in the first one's frame, (3,) [m, m, rad].

    ``before`` (n, 2) and ``after`` (m, 2) are returns in base_link [m], in the order of the beams.
    None where the two have too little in common, or nothing that tells along from across.
    """
    from scipy.spatial import KDTree

    normals, flat = _normals(before)
    if flat.sum() < MIN_POINTS:
        return None
    before, normals = before[flat], normals[flat]
    tree = KDTree(before)
    pose = guess.astype(np.float64)
    for _ in range(ITERATIONS):
        moved = to_world(after, pose)
        distance, found = tree.query(moved)
        closest = np.asarray(found)
        near = np.asarray(distance) < REACH
        if near.sum() < MIN_POINTS:
            return None
        # Half of the pairs fit worse than the median: what moves, and the edges of surfaces.
        error = ((moved - before[closest]) * normals[closest]).sum(axis=1)
        near &= np.abs(error) <= 3.0 * np.median(np.abs(error[near])) + 1e-6
        step = _step(moved[near], pose, normals[closest[near]], error[near])
        if step is None:
            return None
        pose = pose + step
        if np.abs(step).max() < 1e-6:
            break
    return pose


def evenness(points: FloatArray) -> float:
    """Return how well points tell along from across: 0 in a corridor, 0.5 in a round room."""
    normals, flat = _normals(points)
    if flat.sum() < MIN_POINTS:
        return 0.0
    return float(np.linalg.eigvalsh(normals[flat].T @ normals[flat])[0] / flat.sum())


def _step(
    moved: FloatArray, pose: FloatArray, normals: FloatArray, error: FloatArray
) -> FloatArray | None:
    """Return the change of pose that makes the errors least, to first order."""
    arm = moved - pose[:2]
    turn = normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]
    jacobian = np.concatenate([normals, turn[:, None]], axis=1)
    information = jacobian.T @ jacobian
    if np.linalg.eigvalsh(information)[0] < 1.0:
        return None
    return -np.linalg.solve(information, jacobian.T @ error).astype(np.float64)


def _normals(points: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return each point's normal by its neighbours, (n, 2), and whether it has both nearby."""
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    length = np.hypot(along[:, 0], along[:, 1])
    steps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    flat = (steps < GAP) & (np.roll(steps, 1) < GAP) & (length > 1e-6)
    normals = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.maximum(length, 1e-9)[:, None]
    return normals.astype(np.float64), flat
