# SPDX-License-Identifier: Apache-2.0
"""Where the robot has been in this episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from pm01_nav.arrays import Arrays
from pm01_nav.task.parts.base import Elapsed, Memory, ObservationPart, Seen, observation_part
from pm01_nav.task.trail import Trail, TrailLayout

if TYPE_CHECKING:
    from pm01_nav.sim.simulator import Simulator

DEFAULT = TrailLayout()


@observation_part
@dataclass(frozen=True)
class Visited(ObservationPart):
    """How much of the way so far lies in each sector, then how familiar the present place is."""

    name = "trail"

    layout: TrailLayout = DEFAULT
    """How the places are kept and shown."""

    def __post_init__(self) -> None:
        """Read ``layout`` from plain data.

        Raises:
            InputError: it is not allowed.
        """
        if isinstance(self.layout, Mapping):
            object.__setattr__(self, "layout", TrailLayout(**self.layout))

    @property
    def shape(self) -> tuple[int, ...]:
        """Sectors, and one more."""
        return (self.layout.size,)

    @property
    def bounds(self) -> tuple[float, float]:
        """They are parts of one."""
        return 0.0, 1.0

    @property
    def needs(self) -> Mapping[str, Any]:
        """The simulator keeps the places."""
        return {"trail": asdict(self.layout)}

    def memory(self, count: int, control_dt: float, arrays: Arrays) -> Memory:
        """Return the places where robots have been by their odometry."""
        return TrailMemory(Trail(self.layout, control_dt, count))

    def simulated_memory(self, simulator: Simulator, arrays: Arrays) -> Memory:
        """Return what the simulator keeps."""
        return SimulatedTrail(simulator)

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        """Return the sectors and the familiarity as one block."""
        return (memory.visited[seen.robots],)


class TrailMemory(Memory):
    """The trails of robots."""

    def __init__(self, trail: Trail) -> None:
        """Begin where the robots stand."""
        self._trail = trail
        self.visited: Any = None

    def push(self, seen: Seen) -> None:
        """Move on, and look back."""
        seconds, steps, _, motion = seen.elapsed
        self.visited = self._trail.follow(
            seen.velocity, seconds=seconds, steps=steps, motion=motion
        )

    def survives(self, elapsed: Elapsed) -> bool:
        """Tell whether odometry says how far the robot came meanwhile."""
        return elapsed.motion is not None

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""
        self._trail.keep(robots)


class SimulatedTrail(Memory):
    """The trails that a simulator keeps in its state."""

    def __init__(self, simulator: Simulator) -> None:
        """Read from ``simulator``."""
        self._simulator = simulator

    @property
    def visited(self) -> Any:
        """What is to be shown of all robots."""
        return self._simulator.state.visited
