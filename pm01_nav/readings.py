# SPDX-License-Identifier: Apache-2.0
"""What a raw range says, by REP-117 and ``sensor_msgs/LaserScan``, and what a 0 stands for.

+inf is no return, -inf a return too close to measure, NaN invalid; so is a finite range outside the
limits. A 0 is none of these: some drivers, of the LDS class, send it for no return.
"""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

from pm01_nav.arrays import array_namespace

ZeroMeans = Literal["no_return", "too_close", "invalid"]
ZERO_MEANS: tuple[ZeroMeans, ...] = get_args(ZeroMeans)
_BY_REP_117 = {"no_return": math.inf, "too_close": -math.inf, "invalid": math.nan}


def read_zeros(ranges: Any, zero_means: ZeroMeans) -> Any:
    """Return ranges with what a 0 means by REP-117 in its place; same shape [m]."""
    xp = array_namespace(ranges)
    return xp.where(ranges == 0.0, _BY_REP_117[zero_means], ranges)


def is_valid(ranges: Any, range_min: Any, range_max: Any) -> Any:
    """Tell which ranges say something: those within the limits [m] and the infinite ones."""
    xp = array_namespace(ranges)
    return ((ranges >= range_min) & (ranges <= range_max)) | xp.isinf(ranges)
