# SPDX-License-Identifier: Apache-2.0
"""Refuse what no policy could drive by, whether it is learned or planned."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.errors import InputError
from pm01_nav.readings import is_valid, read_zeros
from pm01_nav.task.scans import ScanGeometry


def check_scan(scan: ArrayLike, expected: ScanGeometry) -> NDArray[np.float32]:
    """Return ranges (..., num_beams) [m] as an array, if they are those of a lidar.

    A 0 is replaced by what it means; the rest stays raw.

    Raises:
        InputError: a length is wrong, a range is negative, or no range of a scan is valid.
    """
    ranges: NDArray[np.float32] = np.asarray(scan, dtype=np.float32)
    if ranges.ndim == 0 or ranges.shape[-1] != expected.num_beams:
        raise InputError(
            f"scan has shape {ranges.shape}: this policy needs {expected.num_beams} ranges, from "
            f"{expected.angle_min:.4f} rad in steps of {expected.angle_increment:.5f} rad"
        )
    negative = np.isfinite(ranges) & (ranges < 0.0)
    if negative.any():
        at = tuple(int(i) for i in np.argwhere(negative)[0])
        raise InputError(f"scan[{at[-1]}] = {ranges[at]:g}: a range must not be negative")
    ranges = read_zeros(ranges, expected.zero_means)
    # A policy may look less far than its lidar: what lies beyond is no return to it.
    if not is_valid(ranges, expected.range_min, np.inf).any(axis=-1).all():
        raise InputError(
            "scan: every range is NaN, 0 or below range_min; at least one must be valid "
            "(where the lidar's driver sends 0 for no return, set lidar.zero_means)"
        )
    return ranges


def finite_pair(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return two numbers (..., 2) as an array.

    Raises:
        InputError: there are not two, or one is not finite; it names the argument.
    """
    return finite_numbers(value, name, 2)


def finite_numbers(value: ArrayLike, name: str, count: int) -> NDArray[np.float64]:
    """Return ``count`` numbers, two or three, (..., count) as an array.

    Raises:
        InputError: there are not so many, or one is not finite; it names the argument.
    """
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.ndim == 0 or numbers.shape[-1] != count or not np.isfinite(numbers).all():
        words = {2: "two", 3: "three"}
        raise InputError(f"{name} = {value!r}: must be {words[count]} finite numbers")
    return numbers
