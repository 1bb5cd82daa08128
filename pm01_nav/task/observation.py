# SPDX-License-Identifier: Apache-2.0
"""What a policy sees. THE CONTRACT between training, the exported file and the robot.

An observation is a list of parts (``task/parts/``). The environments, the exporter and
``OnnxPolicy`` all build it with this module, which needs numpy alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, Literal

from pm01_nav.arrays import array_namespace
from pm01_nav.drives import Drive, drive_from_dict, drive_to_dict
from pm01_nav.durations import CONTROL_DT, in_seconds
from pm01_nav.errors import InputError
from pm01_nav.task.parts import Memory, ObservationPart, Seen, make_part
from pm01_nav.task.parts.goal import GoalBearing, GoalDistance, GoalSinCos
from pm01_nav.task.parts.motion import (
    AngularVelocity,
    LateralVelocity,
    LinearVelocity,
    PreviousAction,
)
from pm01_nav.task.parts.scan import Scan
from pm01_nav.task.parts.trail import Visited
from pm01_nav.task.scans import ScanGeometry

GoalKind = Literal["polar", "polar_sin_cos"]
SpaceKind = Literal["flat", "dict"]
INTERVAL = {"interval_steps": "interval_s"}
"""What early memories counted in control steps, and the present key."""


@dataclass(frozen=True)
class ObservationLayout:
    """The parts of an observation in order, for robots with one lidar and the same drive."""

    scan: ScanGeometry
    drive: Drive
    parts: tuple[ObservationPart, ...]
    normalize: bool = True
    """Whether environments divide each part by its scale; exported policies do so themselves."""
    space: SpaceKind = "flat"
    """Whether environments give one array, or each part by its name; files always take one."""

    def __post_init__(self) -> None:
        """Refuse a part that is there twice.

        Raises:
            InputError: names it.
        """
        names = [part.name for part in self.parts]
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"observation.parts.{twice[0]}: is there twice")

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
        low, high = [], []
        for part in self.parts:
            divisor = part.scale if self.normalize else 1.0
            low += [part.bounds[0] / divisor] * part.size
            high += [part.bounds[1] / divisor] * part.size
        return low, high

    def part(self, name: str) -> Any:
        """Return the part of this name; None if there is none."""
        return next((part for part in self.parts if part.name == name), None)

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each part lies in an observation, by its name."""
        ends = list(accumulate(part.size for part in self.parts))
        return {p.name: slice(end - p.size, end) for p, end in zip(self.parts, ends, strict=True)}

    def split(self, observation: Any) -> dict[str, Any]:
        """Return the parts of observations (..., size) by their names, each (..., *shape)."""
        rows = tuple(observation.shape[:-1])
        return {
            part.name: observation[..., self.places[part.name]].reshape(rows + part.shape)
            for part in self.parts
        }

    def as_space(self, observation: Any) -> Any:
        """Return observations (..., size) as environments give them; see ``space``."""
        return observation if self.space == "flat" else self.split(observation)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for an exported policy's metadata."""
        return {
            "scan": asdict(self.scan),
            "limits": drive_to_dict(self.drive),
            "parts": [{"part": part.name} | _plain(part.parameters()) for part in self.parts],
            "normalize": self.normalize,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], control_dt: float = CONTROL_DT) -> ObservationLayout:
        """Build a layout from exported metadata, that of format 1 as well, which had no parts.

        ``control_dt`` [s] is for early metadata, which counted control steps.

        Raises:
            InputError: a key is unknown or missing.
        """
        try:
            rest = memories_in_seconds(data, control_dt, "observation.")
            lidar, drive = ScanGeometry(**rest.pop("scan")), drive_from_dict(rest.pop("limits"))
            if "parts" not in rest:
                return cls._of_format_1(lidar, drive, rest)
            _refuse_unknown(rest, ("parts", "normalize"))
            parts = tuple(_read_part(row, lidar, drive) for row in rest["parts"])
            return cls(lidar, drive, parts, rest.get("normalize", True))
        except (AttributeError, KeyError, TypeError) as error:
            raise InputError(f"observation layout: {error}") from error

    @classmethod
    def _of_format_1(
        cls, lidar: ScanGeometry, drive: Drive, data: dict[str, Any]
    ) -> ObservationLayout:
        _refuse_unknown(data, [*(f.name for f in fields(UsualParts)), "normalize"])
        normalize = data.pop("normalize", True)
        return cls(lidar, drive, UsualParts(**data).made(lidar, drive), normalize)


def _plain(parameters: dict[str, Any]) -> dict[str, Any]:
    return {
        name: asdict(v) if is_dataclass(v) and not isinstance(v, type) else v
        for name, v in parameters.items()
    }


def _refuse_unknown(data: Mapping[str, Any], known: Any) -> None:
    if unknown := sorted(set(data) - set(known)):
        raise InputError(f"observation.{unknown[0]}: unknown key")


def memories_in_seconds(given: Mapping[str, Any], control_dt: Any, source: str) -> dict[str, Any]:
    """Return keys of an observation, with seconds where early memories counted control steps.

    ``given`` is a task's or exported metadata; see ``in_seconds``.
    """
    found = dict(given)
    for key in ("trail", "frames", "layout"):
        if isinstance(found.get(key), Mapping):
            found[key] = in_seconds(found[key], INTERVAL, control_dt, f"{source}{key}.")
    parts = found.get("parts")
    if isinstance(parts, Mapping):
        found["parts"] = {
            name: _in_seconds(name, part, control_dt, source) for name, part in parts.items()
        }
    elif isinstance(parts, list):
        found["parts"] = [
            _in_seconds(row.get("part"), row, control_dt, source) if isinstance(row, dict) else row
            for row in parts
        ]
    return found


def _in_seconds(name: Any, part: Any, control_dt: Any, source: str) -> Any:
    # Parts of one's own count as they like.
    ours = name in (Scan.name, Visited.name) and isinstance(part, Mapping)
    return memories_in_seconds(part, control_dt, f"{source}parts.{name}.") if ours else part


def _read_part(row: dict[str, Any], lidar: ScanGeometry, drive: Drive) -> ObservationPart:
    parameters = dict(row)
    return make_part(parameters.pop("part"), parameters, lidar, drive)


@dataclass(frozen=True)
class UsualParts:
    """The keys by which configurations and files of format 1 ask for parts."""

    sectors: int = 0
    nearness_distance: float = 0.3
    goal: GoalKind = "polar_sin_cos"
    previous_action: bool = True
    goal_distance_max: float = 10.0
    trail: Any = None
    """A ``TrailLayout``, as plain data or not, or None."""
    frames: Any = None
    """A ``FramesLayout``, likewise."""

    def made(self, lidar: ScanGeometry, drive: Drive) -> tuple[ObservationPart, ...]:
        """Return the parts.

        Raises:
            InputError: a value is not allowed.
        """
        robot = lidar, drive
        bearing = GoalBearing if self.goal == "polar" else GoalSinCos
        return (
            Scan(*robot, self.sectors, self.nearness_distance, self.frames),
            GoalDistance(*robot, self.goal_distance_max),
            bearing(*robot),
            LinearVelocity(*robot),
            *([LateralVelocity(*robot)] if "y" in drive.axes else []),
            AngularVelocity(*robot),
            *([PreviousAction(*robot)] if self.previous_action else []),
            *([Visited(*robot, self.trail)] if self.trail else []),
        )


class Observer:
    """Build the observations of some robots, and remember for their parts what these need."""

    def __init__(
        self, layout: ObservationLayout, remember: Callable[[ObservationPart], Memory]
    ) -> None:
        """Ask ``remember`` for the memory of each part; ``begin`` fills them."""
        self.layout = layout
        self._remember = remember
        memories = [remember(part) for part in layout.parts]
        ends = accumulate(part.size for part in layout.parts)
        self._rows = list(zip(layout.parts, memories, ends, strict=True))
        self._remembering = [memory for memory in memories if type(memory) is not Memory]

    @property
    def period(self) -> int:
        """After so many steps everything lies in memory where it lay before."""
        return math.lcm(*(memory.period for memory in self._remembering))

    def begin(self, seen: Seen) -> None:
        """Let the robots ``seen.robots`` begin anew."""
        for memory in self._remembering:
            memory.begin(seen)

    def begin_where(self, begins: Any, seen: Seen) -> None:
        """Let the robots of a mask begin anew; ``seen`` has all of them."""
        for memory in self._remembering:
            memory.begin_where(begins, seen)

    def forget(self, seen: Seen) -> None:
        """Begin anew after a pause what does not survive it."""
        for k, (part, memory, end) in enumerate(self._rows):
            if not memory.survives(seen.elapsed):
                fresh = self._remember(part)
                fresh.begin(seen)
                self._rows[k] = part, fresh, end
        self._remembering = [m for _, m, _ in self._rows if type(m) is not Memory]

    def push(self, seen: Seen) -> None:
        """Take note of what all robots see now."""
        for memory in self._remembering:
            memory.push(seen)

    def show(self, seen: Seen, *, normalized: bool = False) -> Any:
        """Return observations, shape (n, layout.size), float32, physical or ``normalized``."""
        xp, goal = array_namespace(seen.goal), seen.goal
        shape = (goal.shape[0], self.layout.size)
        observation = xp.empty(shape, dtype=xp.float32, device=goal.device)
        begin = 0
        for part, memory, end in self._rows:
            scale = part.scale if normalized else 1.0
            for shown in part.show(seen, memory):
                values = shown if scale == 1.0 else shown / scale
                # Column by column: numpy is slow on rows of one or two numbers.
                if values.ndim == 1:
                    observation[:, begin] = values
                    begin += 1
                    continue
                width = math.prod(values.shape[1:])
                observation[:, begin : begin + width] = (
                    values if values.ndim == 2 else xp.reshape(values, (-1, width))
                )
                begin += width
            if begin != end:
                raise InputError(
                    f"observation.parts.{part.name}: shows {begin - end + part.size} numbers, "
                    f"its shape says {part.size}"
                )
        return observation

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""
        for memory in self._remembering:
            memory.keep(robots)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that make up all memories by name, not copied."""
        found: dict[str, Any] = {}
        for memory in self._remembering:
            found |= memory.arrays()
        return found
