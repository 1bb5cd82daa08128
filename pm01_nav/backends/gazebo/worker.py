# SPDX-License-Identifier: Apache-2.0
"""A process for each of Gazebo's servers: their crashes are not ours, and each has a partition."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import Scenario, View
from pm01_nav.backends.gazebo.messages import SilentError
from pm01_nav.errors import InputError
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Setup:
    """What a server has to know of the robot and its steps."""

    num_beams: int
    wheel_radius: float
    """Height of ``base_link`` [m]."""
    ticks: int
    """Set points of movers in a control step."""
    iterations: int
    """Steps of the physics in a tick."""
    physics_dt: float
    """[s]"""

    @property
    def control_dt(self) -> float:
        """Time between two commands [s]."""
        return self.ticks * self.iterations * self.physics_dt


@dataclass(frozen=True)
class Reading:
    """What came of a control step or a reset."""

    pose: FloatArray
    """x, y, yaw of ``base_link`` [m, m, rad], shape (3,)."""
    twist: FloatArray
    """v, w in ``base_link`` [m/s, rad/s], shape (2,)."""
    odometry_pose: FloatArray
    """Where the wheels say that it is; at a reset, where it is. Like ``pose``."""
    odometry_twist: FloatArray
    """What the wheels say of v and w. Like ``twist``."""
    contact: bool
    """Whether the hull touched something."""
    ranges: NDArray[np.float32]
    """Of the beams, infinity where nothing is hit [m], shape (num_beams,)."""


class Server(Protocol):
    """A Gazebo with one robot, whether it runs here or elsewhere."""

    def reset(self, scenario: Scenario, world: World | None) -> Reading:
        """Put the robot at rest where its scenario says.

        Obstacles and movers of ``world`` replace those that are there; None leaves all as it is.
        """
        ...

    def step(self, command: FloatArray, movers: FloatArray) -> Reading:
        """Drive for a control step by v and w (2,) [m/s, rad/s].

        ``movers`` (ticks, at least n, 2) [m] says where movers are at each tick's end.
        """
        ...

    def picture(self, view: View) -> NDArray[np.uint8]:
        """Return a picture of the world, (height, width, 3)."""
        ...


Opener = Callable[[Path, Setup], Server]
"""Starts a server on an SDF file, in the process that it is called in."""

Cores = frozenset[int]
"""Numbers of the processor's cores that a server runs on; none leaves that to the system."""

ANSWER_TIMEOUT_S = 60.0
"""A server that does not answer for so long has died in a way of its own."""
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
"""What a terminal makes colours of."""
LAST_LINES = 3
"""Of the log, in messages."""
_NUMBERS = count()


class ServerLostError(Exception):
    """The server's process died, or does not answer."""


class GazeboWorker:
    """A server that answers from a process of its own."""

    def __init__(self, world: str, setup: Setup, opener: Opener, cores: Cores) -> None:
        """Start the process; ``world`` is the SDF text that the server begins with.

        It is ready when ``receive`` returns for the first time.
        """
        folder = tempfile.TemporaryDirectory(prefix="pm01_gazebo_")
        path, self._log = Path(folder.name) / "world.sdf", Path(folder.name) / "log.txt"
        path.write_text(world, encoding="utf-8")
        ours, theirs = socket.socketpair()
        own = {
            "GZ_PARTITION": f"pm01_{os.getpid()}_{next(_NUMBERS)}",
            # The server finds the modules that we find.
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        with self._log.open("wb") as log, theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={"GZ_IP": "127.0.0.1"} | os.environ | own,
                # A terminal's Ctrl-C is for the command, which then closes the connection.
                start_new_session=True,
            )
        self._connection = Connection(ours.detach())
        self._waiting = 0
        self._close = weakref.finalize(self, _stop, self._process, self._connection, folder)
        self.send(opener, cores, path, setup)

    @property
    def process_id(self) -> int:
        """Return the number of the server's process."""
        return self._process.pid

    @property
    def memory_mb(self) -> float:
        """Return what the server's process holds in memory [MB]; 0 where that cannot be known."""
        try:
            pages = Path(f"/proc/{self._process.pid}/statm").read_text(encoding="ascii").split()[1]
        except OSError:
            return 0.0
        return int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6

    @property
    def idle(self) -> bool:
        """Tell whether the server lives and owes no answer."""
        return self._process.poll() is None and not self._waiting

    def send(self, what: Opener | str, *arguments: Any) -> None:
        """Let the server call one of its functions; ``receive`` brings the answer."""
        # Where there is no server any more, there will be no answer.
        with suppress(OSError):
            self._connection.send((what, arguments))
        self._waiting += 1

    def receive(self) -> Any:
        """Return the latest answer, once it and all before it are there.

        Raises:
            ServerLostError: the server died or does not answer.
            InputError: the server could not do what it was told.
        """
        answer: Any = None
        while self._waiting:
            try:
                if not self._connection.poll(ANSWER_TIMEOUT_S):
                    self._process.kill()
                    raise ServerLostError(f": no answer in {ANSWER_TIMEOUT_S:g} s")
                answer = self._connection.recv()
            except (EOFError, OSError) as error:
                raise ServerLostError(self._last_words()) from error
            self._waiting -= 1
            if isinstance(answer, Exception):
                raise InputError(f"{answer}{self._last_words()}")
        return answer

    def close(self) -> None:
        """Stop the process."""
        self._close()

    def _last_words(self) -> str:
        """Return how the process ended and the end of what the server wrote."""
        try:
            ended = f" (exit code {self._process.wait(timeout=1.0)})"
        except subprocess.TimeoutExpired:
            ended = ""
        text = self._log.read_text(encoding="utf-8", errors="replace")
        lines = [line.strip() for line in COLOURS.sub("", text).splitlines() if line.strip()]
        said = "; ".join(lines[-LAST_LINES:])
        return ended + (f"; Gazebo says: {said}" if said else "")


def cores_of(number: int, num_servers: int) -> Cores:
    """Return the cores for one of so many servers that run at the same time.

    A server's threads wait for each other hundreds of times in a control step. On a core of its own
    that is quicker than across cores, and servers do not get into each other's way. Half of the
    cores are left to those who step them, where there are enough.
    """
    if not hasattr(os, "sched_getaffinity"):
        return frozenset()
    allowed = sorted(os.sched_getaffinity(0))
    each = max(1, len(allowed) // (2 * num_servers))
    first = number * each
    return frozenset(allowed[(first + k) % len(allowed)] for k in range(each))


def open_gazebo(world: Path, setup: Setup) -> Server:
    """Start Gazebo's server in this process; see ``GazeboServer``."""
    from pm01_nav.backends.gazebo.server import GazeboServer

    return GazeboServer(world, setup)


def serve(connection: Connection) -> None:
    """Open a server, then answer one request after the other until nobody asks any more."""
    try:
        opener, (cores, *arguments) = connection.recv()
        if cores:
            os.sched_setaffinity(0, cores)
        server = opener(*arguments)
        connection.send(None)
        while True:
            name, arguments = connection.recv()
            connection.send(getattr(server, name)(*arguments))
    except (EOFError, ConnectionError):
        return
    except (InputError, SilentError) as error:
        connection.send(InputError(str(error)))


def _stop(
    process: subprocess.Popen[bytes],
    connection: Connection,
    folder: tempfile.TemporaryDirectory[str],
) -> None:
    connection.close()
    try:
        process.wait(timeout=2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    folder.cleanup()


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
    sys.stderr.flush()
    # Gazebo's threads may take long to end, or crash as they do.
    os._exit(0)
