# SPDX-License-Identifier: Apache-2.0
"""What a policy sees. THE CONTRACT between training, the exported file and the robot.

The environments, the exporter and ``OnnxPolicy`` all build observations with this module, which
needs numpy alone. Functions work on any array of the array API standard, shaped ``(..., n)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cache, cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from pm01_nav.arrays import array_namespace
from pm01_nav.errors import InputError
from pm01_nav.readings import ZERO_MEANS, ZeroMeans, read_zeros
from pm01_nav.task.action import ActionLimits
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.trail import TrailLayout

if TYPE_CHECKING:
    from pm01_nav.robot import Lidar


class Part(NamedTuple):
    """Consecutive numbers of an observation that mean the same."""

    name: str
    size: int
    low: float
    high: float
    unit: str

    @property
    def scale(self) -> float:
        """What the part is divided by when normalised."""
        return max(abs(self.low), abs(self.high))


@dataclass(frozen=True)
class ScanGeometry:
    """Which way the beams of a scan look and how far, as in ``sensor_msgs/LaserScan``."""

    num_beams: int
    angle_min: float
    """Direction of beam 0 in the lidar frame [rad]."""
    angle_increment: float
    """From one beam to the next, counter-clockwise [rad]."""
    range_min: float
    """[m]"""
    range_max: float
    """[m]"""
    zero_means: ZeroMeans = field(default="invalid", compare=False)
    """What a 0 of the lidar's driver stands for. No part of what a policy was trained to see."""

    def __post_init__(self) -> None:
        """Refuse a meaning that there is not.

        Raises:
            InputError: ``zero_means`` is unknown.
        """
        if self.zero_means not in ZERO_MEANS:
            allowed = ", ".join(ZERO_MEANS)
            raise InputError(f"zero_means = {self.zero_means!r}: unknown; allowed: {allowed}")


def scan_geometry(lidar: Lidar, range_max: float | None = None) -> ScanGeometry:
    """Return how a robot's lidar looks around, as far as it does or only to ``range_max`` [m]."""
    return ScanGeometry(
        num_beams=lidar.num_beams,
        angle_min=lidar.angle_min,
        angle_increment=lidar.angle_increment,
        range_min=lidar.range_min,
        range_max=lidar.range_max if range_max is None else range_max,
        zero_means=lidar.zero_means,
    )


@dataclass(frozen=True)
class ObservationLayout:
    """The order, the size and the meaning of an observation's numbers."""

    scan: ScanGeometry
    limits: ActionLimits
    sectors: int = 0
    """The scan's nearest return in each of so many sectors; 0 keeps every beam."""
    nearness_distance: float = 0.3
    """A return at r metres is shown as (d - r) / (d + r) with this d [m]; 0 shows r itself.

    It spreads out the last decimetres, which decide whether a corner is cut or hit: with ranges
    themselves a policy went on scraping corners (94 % success), with nearness it learned not to
    (98 %), all else equal.
    """
    goal: Literal["polar", "polar_sin_cos"] = "polar_sin_cos"
    """Goal as distance and bearing, or as distance, sin and cos of the bearing."""
    previous_action: bool = True
    """Whether the last action (in [-1, 1]) is part of the observation."""
    goal_distance_max: float = 10.0
    """A goal further away than this [m] is shown at this distance."""
    trail: TrailLayout | None = None
    """How the places where the robot has been are shown; None does not show them."""
    frames: FramesLayout | None = None
    """Which earlier scans are shown; None shows the present one alone."""
    normalize: bool = True
    """Whether environments divide each part by its scale; exported policies do so themselves."""

    def __post_init__(self) -> None:
        """Refuse sectors without a beam.

        Raises:
            InputError: there are more sectors than beams.
        """
        if not 0 <= self.sectors <= self.scan.num_beams:
            raise InputError(
                f"sectors = {self.sectors}: must be from 0 to the number of beams, "
                f"{self.scan.num_beams}"
            )

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The observation's parts in order."""
        size, limits = self.sectors or self.scan.num_beams, self.limits
        scan = (
            Part("scan_nearness", size, -1.0, 1.0, "1")
            if self.nearness_distance > 0.0
            else Part("scan", size, 0.0, self.scan.range_max, "m")
        )
        parts = [scan]
        if self.frames is not None:
            earlier = f"earlier_{scan.name}"
            parts.append(scan._replace(name=earlier, size=self.frames.count * size))
        parts.append(Part("goal_distance", 1, 0.0, self.goal_distance_max, "m"))
        if self.goal == "polar":
            parts.append(Part("goal_bearing", 1, -math.pi, math.pi, "rad"))
        else:
            parts.append(Part("goal_sin_cos", 2, -1.0, 1.0, "1"))
        parts.append(Part("linear_velocity", 1, limits.linear_min, limits.linear_max, "m/s"))
        parts.append(Part("angular_velocity", 1, -limits.angular_max, limits.angular_max, "rad/s"))
        if self.previous_action:
            parts.append(Part("previous_action", 2, -1.0, 1.0, "1"))
        if self.trail is not None:
            parts.append(Part("visited", self.trail.sectors, 0.0, 1.0, "1"))
            parts.append(Part("familiarity", 1, 0.0, 1.0, "1"))
        return tuple(parts)

    @cached_property
    def size(self) -> int:
        """How many numbers an observation has."""
        return sum(part.size for part in self.parts)

    @cached_property
    def scale(self) -> list[float]:
        """What each number is divided by when normalised."""
        return [part.scale for part in self.parts for _ in range(part.size)]

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """Least and greatest value of each number as environments give them."""
        divisors = [part.scale if self.normalize else 1.0 for part in self.parts]
        low = [p.low / d for p, d in zip(self.parts, divisors, strict=True) for _ in range(p.size)]
        high = [
            p.high / d for p, d in zip(self.parts, divisors, strict=True) for _ in range(p.size)
        ]
        return low, high

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for an exported policy's metadata."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ObservationLayout:
        """Build a layout from exported metadata.

        Raises:
            InputError: a key is unknown or missing.
        """
        try:
            known = {f.name for f in fields(cls)}
            rest = {k: v for k, v in data.items() if k not in ("scan", "limits")}
            for name, layout in (("trail", TrailLayout), ("frames", FramesLayout)):
                if rest.get(name) is not None:
                    rest[name] = layout(**rest[name])
            if unknown := sorted(set(rest) - known):
                raise InputError(f"observation.{unknown[0]}: unknown key")
            return cls(ScanGeometry(**data["scan"]), ActionLimits(**data["limits"]), **rest)
        except (AttributeError, KeyError, TypeError) as error:
            raise InputError(f"observation layout: {error}") from error


def discard_invalid(scan: Any, geometry: ScanGeometry) -> Any:
    """Replace ranges that say nothing by +inf, so that none hides a nearer return; same shape [m].

    THE SANITISER: every scan passes it before anything else looks at it, the simulator's (where it
    is the kernel ``sim.lidar.sanitized``) as well as a robot's.

    A 0 is first read as ``geometry.zero_means`` says, whatever the limits.

    | raw range (REP-117 and ``sensor_msgs/LaserScan``) | means          | becomes |
    |---------------------------------------------------|----------------|---------|
    | +inf                                              | no return      | +inf    |
    | above range_max                                   | to be discarded| +inf    |
    | range_min to range_max, both included             | a return       | itself  |
    | finite and below range_min                        | to be discarded| +inf    |
    | -inf                                              | too close      | -inf    |
    | NaN                                               | invalid        | +inf    |

    Limits are compared in the precision of ``scan``: a driver's float32 range_min is valid.
    """
    xp = array_namespace(scan)
    scan = read_zeros(scan, geometry.zero_means)
    within = (scan >= geometry.range_min) & (scan <= geometry.range_max)
    return xp.where(within | (scan == -xp.inf), scan, xp.inf)


def sector_begins(num_beams: int, sectors: int) -> list[int]:
    """Return the first beam of each sector, and ``num_beams`` behind them, ``sectors`` + 1 numbers.

    Sector k holds beams floor(k num_beams / sectors) to floor((k + 1) num_beams / sectors) - 1:
    all have the same number where it divides, else one more or less.
    """
    return [k * num_beams // sectors for k in range(sectors + 1)]


def pool_sectors(ranges: Any, sectors: int) -> Any:
    """Return the nearest range in each of ``sectors`` sectors, shape (..., sectors).

    With 0 sectors every beam is one. Environments have this from the simulator.
    """
    if sectors == 0:
        return ranges
    xp = array_namespace(ranges)
    num_beams = ranges.shape[-1]
    if num_beams % sectors:
        beams = xp.asarray(_beams_of_sectors(num_beams, sectors), device=ranges.device)
        ranges = xp.take(ranges, beams, axis=-1)
    return xp.min(xp.reshape(ranges, (*ranges.shape[:-1], sectors, -1)), axis=-1)


@cache
def _beams_of_sectors(num_beams: int, sectors: int) -> tuple[int, ...]:
    """Return the beams of all sectors; where one lacks a beam, its last stands twice."""
    widest = -(-num_beams // sectors)
    begins = sector_begins(num_beams, sectors)
    return tuple(min(a + j, b - 1) for a, b in pairwise(begins) for j in range(widest))


def show_ranges(layout: ObservationLayout, nearest: Any, *, normalized: bool = False) -> Any:
    """Return ranges as observations show them, float32, in physical units or ``normalized``.

    ``nearest`` (..., sectors or num_beams) is the nearest range of each sector, by REP-117 with
    nothing invalid in it [m]. No return shows as range_max, and too close as range_min.
    """
    xp = array_namespace(nearest)
    shown = _clip(xp, nearest, layout.scan.range_min, layout.scan.range_max)
    if layout.nearness_distance > 0.0:
        # (d - r) / (d + r), in fewer passes.
        shown += layout.nearness_distance
        shown = (2.0 * layout.nearness_distance) / shown
        shown -= 1.0
    elif normalized:
        shown /= layout.scan.range_max
    return shown


def build_observation(
    layout: ObservationLayout,
    scans: Sequence[Any],
    goal: Any,
    velocity: Any,
    previous_action: Any,
    visited: Any = None,
    *,
    normalized: bool = False,
) -> Any:
    """Build observations, shape (..., layout.size), float32, in physical units or ``normalized``.

    ``scans`` are the present scan and, if the layout has frames, the earlier ones, newest first,
    each as ``show_ranges`` returns it, ``goal`` (..., 2) distance and bearing [m, rad],
    ``velocity`` (..., 2) v and w [m/s, rad/s], ``previous_action`` (..., 2) in [-1, 1],
    ``visited`` (..., trail.size) 0 to 1 if the layout has a trail.
    """
    xp = array_namespace(goal)
    scale = layout.scale if normalized else [1.0] * layout.size
    limits, bearing = layout.limits, goal[..., 1]
    # Column by column: numpy is slow on rows of one or two numbers.
    columns = [xp.minimum(goal[..., 0], layout.goal_distance_max)]
    columns += [bearing] if layout.goal == "polar" else [xp.sin(bearing), xp.cos(bearing)]
    columns.append(_clip(xp, velocity[..., 0], limits.linear_min, limits.linear_max))
    columns.append(_clip(xp, velocity[..., 1], -limits.angular_max, limits.angular_max))
    if layout.previous_action:
        columns += [previous_action[..., 0], previous_action[..., 1]]
    observation = xp.empty((*goal.shape[:-1], layout.size), dtype=xp.float32, device=goal.device)
    begin = 0
    for scan in scans:
        observation[..., begin : begin + scan.shape[-1]] = scan
        begin += scan.shape[-1]
    for k, column in enumerate(columns, start=begin):
        observation[..., k] = column if scale[k] == 1.0 else column / scale[k]
    if layout.trail is not None:
        observation[..., begin + len(columns) :] = visited
    return observation


def _clip(xp: Any, values: Any, low: float, high: float) -> Any:
    # Two plain calls: numpy's clip costs more than the rest of a small observation together.
    return xp.minimum(xp.maximum(values, low), high)
