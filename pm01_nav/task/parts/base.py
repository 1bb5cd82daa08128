# SPDX-License-Identifier: Apache-2.0
"""What a part of an observation is: numbers that mean the same, from simulator and robot alike.

A part is one class, entered in the table by ``@observation_part``. Its fields are its parameters;
they stand in an exported policy's metadata. What it shows comes from ``Seen`` alone, which the
simulator and a robot's messages fill in; what it remembers is a ``Memory``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

from pm01_nav.arrays import Arrays
from pm01_nav.drives import Drive
from pm01_nav.errors import InputError
from pm01_nav.task.scans import ScanGeometry, pool_sectors

if TYPE_CHECKING:
    from pm01_nav.sim.simulator import Simulator

ALL = slice(None)


class Elapsed(NamedTuple):
    """What lies between two observations of a robot."""

    seconds: float
    """Time [s]; a control step where no time was given."""
    steps: int = 1
    """Control steps, by the clock: 0 where a call comes too soon, 2 where one was left out."""
    paused: bool = False
    """Whether it was so long that what lies between is unknown, or the clock went back."""
    motion: Any = None
    """Each robot's pose now in base_link as it was, shape (n, 3) [m, m, rad]; None if unknown."""


@dataclass
class Seen:
    """What n robots measure, and what they were told last."""

    ranges: Any
    """Sanitised scans (``discard_invalid``), shape (n, num_beams) [m]."""
    goal: Any
    """Distance and bearing of the goal, shape (n, 2) [m, rad]."""
    velocity: Any
    """Speed of each of the drive's axes, shape (n, axes) [m/s, rad/s]."""
    previous_action: Any
    """The last action, shape (n, axes) in [-1, 1]."""
    elapsed: Elapsed
    """What lies between this and the last time."""
    robots: Any = field(default_factory=lambda: ALL)
    """Which robots of all these are."""

    def nearest(self, sectors: int) -> Any:
        """Return the nearest range of each sector [m], shape (n, sectors); 0 keeps every beam."""
        return pool_sectors(self.ranges, sectors)


class Memory:
    """What a part remembers of robots. This one remembers nothing."""

    period: int = 1
    """After so many steps everything lies in memory where it lay before."""

    def begin(self, seen: Seen) -> None:
        """Begin anew for the robots ``seen.robots``, which see this."""

    def begin_where(self, begins: Any, seen: Seen) -> None:
        """Begin anew for the robots of a mask; ``seen`` has all of them."""

    def push(self, seen: Seen) -> None:
        """Take note of what all robots see after ``seen.elapsed``."""

    def survives(self, elapsed: Elapsed) -> bool:
        """Tell whether it is still true after a pause; else it begins anew."""
        return False

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that make up the memory by name, not copied."""
        return {}


NO_MEMORY = Memory()


@dataclass(frozen=True)
class ObservationPart:
    """Numbers of an observation that mean the same, of a robot with this lidar and this drive."""

    name: ClassVar[str]
    """By which tasks and policy files call it."""
    unit: ClassVar[str] = "1"

    lidar: ScanGeometry
    drive: Drive

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one robot's numbers; one number by default. Three are channels, height and width."""
        return (1,)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and greatest value."""
        raise NotImplementedError

    @property
    def needs(self) -> Mapping[str, Any]:
        """What the simulator must compute for it, as keys of ``sim.settings.Features``."""
        return {}

    def memory(self, count: int, control_dt: float, arrays: Arrays) -> Memory:
        """Return a fresh memory for ``count`` robots that are seen every ``control_dt`` [s]."""
        return NO_MEMORY

    def simulated_memory(self, simulator: Simulator, arrays: Arrays) -> Memory:
        """Return the memory of all robots of a simulator, which may keep it itself."""
        return self.memory(simulator.num_envs, simulator.control_dt, arrays)

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return columns (n,) or blocks (n, ...) that together are the part, in physical units.

        Blocks are flattened in row-major order; one of the part's own shape is the whole of it.
        """
        raise NotImplementedError

    @cached_property
    def size(self) -> int:
        """How many numbers it has."""
        return math.prod(self.shape)

    @cached_property
    def scale(self) -> float:
        """What it is divided by when normalised."""
        return max(abs(bound) for bound in self.bounds)

    def parameters(self) -> dict[str, Any]:
        """Return its own fields, which with its name are all that a file says of it."""
        of_robot = {f.name for f in fields(ObservationPart)}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in of_robot}


PARTS: dict[str, type[ObservationPart]] = {}
PartClass = TypeVar("PartClass", bound=type[ObservationPart])


def observation_part(part: PartClass) -> PartClass:
    """Enter a class in the table of parts by its ``name``."""
    PARTS[part.name] = part
    return part


def check_part(name: str, parameters: Mapping[str, Any]) -> None:
    """Make sure that there is such a part with such parameters.

    Raises:
        InputError: names what is unknown.
    """
    if name not in PARTS:
        raise InputError(f"observation.parts.{name}: unknown; allowed: {', '.join(sorted(PARTS))}")
    allowed = [f.name for f in fields(PARTS[name])][2:]
    if unknown := sorted(set(parameters) - set(allowed)):
        known = ", ".join(allowed) or "none"
        raise InputError(f"observation.parts.{name}.{unknown[0]}: unknown; allowed: {known}")


def make_part(
    name: str, parameters: Mapping[str, Any], lidar: ScanGeometry, drive: Drive
) -> ObservationPart:
    """Build a part by its name.

    Raises:
        InputError: no such part, or a parameter is unknown or not allowed.
    """
    check_part(name, parameters)
    return PARTS[name](lidar, drive, **parameters)


def clip(xp: Any, values: Any, low: float, high: float) -> Any:
    """Return values within bounds."""
    # Two plain calls: numpy's clip costs more than the rest of a small observation together.
    return xp.minimum(xp.maximum(values, low), high)
