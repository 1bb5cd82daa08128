# SPDX-License-Identifier: Apache-2.0
"""What a policy sees of a scan, as places that can be drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import to_world
from pm01_nav.task.observation import ObservationLayout, discard_invalid, pool_sectors


def seen_ends(
    layout: ObservationLayout, ranges: NDArray[np.float32], mount: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where each beam or sector of a policy ends, in base_link, shape (n, 2) [m].

    ``ranges`` (num_beams,) are raw ones of the layout's lidar, ``mount`` (3,) is its pose in
    base_link. A sector is drawn along its middle; no return ends at range_max, too close at
    range_min.
    """
    scan = layout.scan
    nearest = pool_sectors(discard_invalid(ranges, scan), layout.sectors)
    shown = np.clip(nearest, scan.range_min, scan.range_max)
    per_sector = scan.num_beams // len(shown)
    middle = per_sector * np.arange(len(shown)) + 0.5 * (per_sector - 1)
    angle = scan.angle_min + scan.angle_increment * middle
    ends = np.stack([shown * np.cos(angle), shown * np.sin(angle)], axis=-1)
    return to_world(ends, mount)
