# SPDX-License-Identifier: Apache-2.0
"""Workers that stay: each keeps its process, and what it has loaded, from one call to the next.

They are processes of this machine or actors on a Ray cluster. One that is lost is replaced, and
what it was doing is done again.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from typing import Any, Protocol

from pm01_nav.errors import InputError
from pm01_nav.executors import Piece, RayCluster, checked
from pm01_nav.provenance import git_revision

logger = logging.getLogger(__name__)
PLACED_WITHIN_S = 20.0
"""A cluster that has found no core for a worker by then has none that is free."""
REPLACEMENTS = 3
"""A piece that has lost so many workers in a row is given up: it is the piece that kills them."""


class LostWorkerError(Exception):
    """A worker's process, or its machine, is gone."""


class Host(Protocol):
    """Where standing workers live."""

    def start(self) -> Any:
        """Return a fresh worker."""
        ...

    def submit(self, worker: Any, function: Piece, argument: Any) -> Any:
        """Let a worker begin a piece; return what ``result`` takes.

        Raises:
            LostWorkerError: the worker is gone.
        """
        ...

    def result(self, ticket: Any) -> Any:
        """Wait for the outcome of a piece.

        Raises:
            LostWorkerError: the worker is gone.
        """
        ...

    def stop(self, worker: Any) -> None:
        """End a worker."""
        ...


class StandingWorkers:
    """A fixed number of workers, each with a piece of its own in every call."""

    def __init__(self, host: Host, count: int) -> None:
        """Start them."""
        self._host = host
        self._workers = [host.start() for _ in range(count)]
        self.fresh = [True] * count
        """Which have not done a piece yet."""
        self.replaced = 0
        """How many were lost so far."""

    def __enter__(self) -> StandingWorkers:
        """Return the workers."""
        return self

    def __exit__(self, *_: object) -> None:
        """End them."""
        for worker in self._workers:
            self._host.stop(worker)

    def run(
        self, function: Piece, arguments: Sequence[Any], anew: Callable[[int], Any]
    ) -> list[Any]:
        """Give worker i the i-th argument; return all results in their order.

        A worker that takes the place of a lost one gets ``anew(i)`` instead.

        Raises:
            InputError: a piece failed, or lost one worker after the other.
        """
        tickets = [self._begin(i, function, argument) for i, argument in enumerate(arguments)]
        return [self._finish(i, ticket, function, anew) for i, ticket in enumerate(tickets)]

    def _begin(self, i: int, function: Piece, argument: Any) -> Any:
        try:
            return self._host.submit(self._workers[i], function, argument)
        except LostWorkerError:
            return None

    def _finish(self, i: int, ticket: Any, function: Piece, anew: Callable[[int], Any]) -> Any:
        for _ in range(REPLACEMENTS + 1):
            with suppress(LostWorkerError):
                if ticket is None:
                    raise LostWorkerError
                result = self._host.result(ticket)
                self.fresh[i] = False
                return result
            self.replaced += 1
            self._host.stop(self._workers[i])
            self._workers[i] = self._host.start()
            ticket = self._begin(i, function, anew(i))
        raise InputError(f"worker {i}: was lost {REPLACEMENTS + 1} times in a row with one piece")


class LocalHost:
    """Processes of this machine, each of which imports everything for itself."""

    def start(self) -> ProcessPoolExecutor:
        """Return a fresh worker."""
        return ProcessPoolExecutor(1, get_context("spawn"), initializer=_stay_with_parent)

    def submit(self, worker: ProcessPoolExecutor, function: Piece, argument: Any) -> Future[Any]:
        """Let a worker begin a piece."""
        try:
            return worker.submit(function, argument)
        except BrokenProcessPool as error:
            raise LostWorkerError from error

    def result(self, ticket: Future[Any]) -> Any:
        """Wait for the outcome of a piece."""
        try:
            return ticket.result()
        except BrokenProcessPool as error:
            raise LostWorkerError from error

    def stop(self, worker: ProcessPoolExecutor) -> None:
        """End a worker."""
        worker.shutdown(wait=False, cancel_futures=True)


def _stay_with_parent() -> None:
    """Leave Ctrl-C to the parent, and end when it does, however that happens."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


class _Actor:
    """What a worker is on a Ray cluster."""

    def do(self, function: Piece, argument: Any, revision: str | None) -> Any:
        """Do a piece, if this machine has the same code."""
        return checked(function, argument, revision)

    def ready(self) -> None:
        """Answer that the worker runs."""


@dataclass
class _RayWorker:
    actor: Any
    ready: Any
    """Answered when the cluster has found a place for the actor, and asked for once."""


class RayHost:
    """Actors on a Ray cluster, a core each; where none is free they share the cores of others."""

    def __init__(self, address: str) -> None:
        """Join the cluster.

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        self._ray = RayCluster(address).ray

    def start(self) -> _RayWorker:
        """Return a fresh worker."""
        return self._start(num_cpus=1)

    def _start(self, num_cpus: int) -> _RayWorker:
        actor = self._ray.remote(num_cpus=num_cpus)(_Actor).remote()
        return _RayWorker(actor, actor.ready.remote())

    def submit(self, worker: _RayWorker, function: Piece, argument: Any) -> Any:
        """Let a worker begin a piece."""
        if worker.ready is not None:
            self._find_place(worker)
        return worker.actor.do.remote(function, argument, git_revision())

    def _find_place(self, worker: _RayWorker) -> None:
        """Wait for a core; Ray itself would wait for ever where a lost machine took the last."""
        placed, _ = self._ray.wait([worker.ready], timeout=PLACED_WITHIN_S)
        if not placed:
            logger.warning("the cluster has no free core for a worker: it shares one with others")
            self.stop(worker)
            worker.actor = self._start(num_cpus=0).actor
        worker.ready = None

    def result(self, ticket: Any) -> Any:
        """Wait for the outcome of a piece."""
        try:
            return self._ray.get(ticket)
        except self._ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, InputError):
                raise error.cause from error
            raise
        except self._ray.exceptions.RayError as error:
            raise LostWorkerError from error

    def stop(self, worker: _RayWorker) -> None:
        """End a worker."""
        self._ray.kill(worker.actor)


def make_host(ray_address: str | None) -> Host:
    """Return a Ray cluster if one is named, else this machine; no worker is started yet.

    Raises:
        InputError: there is no such cluster.
    """
    return RayHost(ray_address) if ray_address else LocalHost()
