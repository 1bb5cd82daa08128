# SPDX-License-Identifier: Apache-2.0
"""Do pieces of work beside each other: in processes of this machine, or on a Ray cluster.

A piece is a function and its argument, both of which can be pickled; what it needs and returns goes
through these alone, so that it does not matter where it runs.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from pm01_nav.errors import InputError
from pm01_nav.provenance import git_revision

ANSWERS_WITHIN_S = 20.0
"""A cluster that does not answer by then is taken to be away."""
INTERRUPTED = "interrupted"
"""What `pm01 train` prints first if Ctrl-C ended it."""


@dataclass(frozen=True)
class Done:
    """How a piece of work ended."""

    index: int
    result: Any = None
    error: str | None = None
    """Why there is no result."""


Piece = Callable[[Any], Any]


def run_pm01(arguments: Sequence[str], environment: Mapping[str, str] | None = None) -> str:
    """Run `pm01` with these arguments in a process of its own; return what it prints.

    Raises:
        RuntimeError: it failed; the text is its last words.
    """
    code = "from pm01_nav.cli import main; main()"
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        words = " ".join((done.stderr or done.stdout).split())[-300:]
        raise RuntimeError(f"pm01 {arguments[0]} ended with {done.returncode}: {words}")
    return done.stdout


class Executor(Protocol):
    """Something that does pieces of work beside each other."""

    def run(self, function: Piece, arguments: Sequence[Any]) -> Iterator[Done]:
        """Call ``function`` with each argument; give the outcomes as they come.

        A piece that fails costs its own result only.
        """
        ...


class LocalProcesses:
    """So many pieces at a time on this machine; each must start a process of its own."""

    def __init__(self, jobs: int) -> None:
        """Do ``jobs`` pieces at a time."""
        self._jobs = jobs

    def run(self, function: Piece, arguments: Sequence[Any]) -> Iterator[Done]:
        """Call ``function`` with each argument; give the outcomes as they come.

        Whoever stops early, as Ctrl-C does, waits for the pieces under way; no other is begun.
        """
        pool = ThreadPoolExecutor(self._jobs)
        try:
            waiting: dict[Future[Any], int] = {}
            for index, argument in enumerate(arguments):
                waiting[pool.submit(function, argument)] = index
            while waiting:
                finished, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield _outcome(waiting.pop(future), future.result)
        finally:
            # A terminal sends Ctrl-C to the processes of the pieces as well.
            pool.shutdown(cancel_futures=True)


class RayCluster:
    """Pieces on the machines of a Ray cluster; one that is lost with its machine is done again."""

    def __init__(self, address: str, retries: int = 3) -> None:
        """Join the cluster at ``address`` (``host:port``, ``auto``, or ``local`` to start one).

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        try:
            ray: Any = import_module("ray")
        except ImportError as error:
            raise InputError("ray: pip install 'pm01-nav[ray]'") from error
        self.ray, self._retries = ray, retries
        if ray.is_initialized():
            return
        _knock(address)
        os.environ.setdefault("RAY_raylet_start_wait_time_s", str(int(ANSWERS_WITHIN_S)))
        os.environ.setdefault("RAY_gcs_rpc_server_reconnect_timeout_s", str(int(ANSWERS_WITHIN_S)))
        settings: dict[str, Any] = {"address": address}
        if address == "local":
            settings["include_dashboard"] = False
        try:
            ray.init(log_to_driver=False, **settings)
        except (ConnectionError, RuntimeError, ValueError, OSError) as error:
            raise _no_answer(address, error) from error

    def run(self, function: Piece, arguments: Sequence[Any]) -> Iterator[Done]:
        """Call ``function`` with each argument; give the outcomes as they come."""
        ray = self.ray
        remote = ray.remote(num_cpus=1, max_retries=self._retries)(checked)
        revision = git_revision()
        waiting = {remote.remote(function, a, revision): k for k, a in enumerate(arguments)}
        while waiting:
            finished, _ = ray.wait(list(waiting), num_returns=1)
            for reference in finished:
                yield _outcome(waiting.pop(reference), lambda ref=reference: ray.get(ref))


def _knock(address: str) -> None:
    """See whether a cluster answers at ``host:port``: Ray itself asks for minutes, then aborts.

    Raises:
        InputError: none does.
    """
    host, colon, port = address.rpartition(":")
    if not (colon and port.isdigit()):
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), ANSWERS_WITHIN_S).close()
    except (OSError, OverflowError) as error:
        raise _no_answer(address, error) from error
    # Something listens; only Ray can tell whether it is Ray, and a process of its own can be ended.
    status = [sys.executable, "-m", "ray.scripts.scripts", "status", "--address", address]
    try:
        subprocess.run(status, check=True, capture_output=True, timeout=ANSWERS_WITHIN_S)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        reason = OSError(f"what listens there gave no status within {ANSWERS_WITHIN_S:g} s")
        raise _no_answer(address, reason) from error


def _no_answer(address: str, error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:200]
    return InputError(
        f"ray = {address!r}: no cluster answers: {reason}; `ray start --head` starts one, "
        "and RAY_AUTH_MODE=token joins one that wants a token"
    )


def make_executor(jobs: int, ray_address: str | None) -> Executor:
    """Return what does the work: a Ray cluster if one is named, else ``jobs`` processes.

    Raises:
        InputError: there is no such cluster.
    """
    return RayCluster(ray_address) if ray_address else LocalProcesses(jobs)


def checked(function: Piece, argument: Any, revision: str | None) -> Any:
    """Do a piece on a worker, if it has the same code.

    Raises:
        InputError: it has another revision.
    """
    mine = git_revision()
    if mine != revision:
        raise InputError(f"this worker has revision {mine}, the command {revision}; update it")
    return function(argument)


def _outcome(index: int, result: Callable[[], Any]) -> Done:
    try:
        return Done(index, result())
    except Exception as error:  # whatever a piece fails with must not end the others
        return Done(index, error=" ".join(str(error).split())[-400:] or type(error).__name__)
