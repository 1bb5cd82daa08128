# SPDX-License-Identifier: Apache-2.0
"""Pieces of work beside each other: a lost one costs itself only."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from pm01_nav.executors import LocalProcesses, checked, make_executor


def square(number: int) -> int:
    """Square in a process of its own; 3 is killed on the way."""
    kill = f"import os; os.kill(os.getpid(), {int(signal.SIGKILL)})" if number == 3 else ""
    code = f"{kill}\nprint({number} ** 2)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_every_piece_is_done_once_and_a_killed_one_costs_itself():
    done = {d.index: d for d in LocalProcesses(2).run(square, [1, 2, 3, 4])}
    assert {k: d.result for k, d in done.items()} == {0: 1, 1: 4, 2: None, 3: 16}
    assert "SIGKILL" in (done[2].error or "")
    assert done[0].error is None


@pytest.mark.parametrize("kind", [KeyboardInterrupt, GeneratorExit])
def test_pieces_that_are_not_begun_stay_so_when_it_is_stopped(kind):
    begun = []

    def piece(number: int) -> None:
        begun.append(number)
        time.sleep(0.05)

    pieces = LocalProcesses(2).run(piece, range(100))
    next(pieces)
    with pytest.raises(kind):
        pieces.throw(kind)
    # Two at a time: those that ended, those under way, and what was begun meanwhile.
    assert len(begun) < 10


def test_worker_with_other_code_refuses():
    with pytest.raises(InputError, match="revision"):
        checked(square, 2, "0123456789ab")


def test_ray_that_is_not_there_is_said():
    try:
        import ray  # noqa: F401
    except ImportError:
        with pytest.raises(InputError, match=r"pm01-nav\[ray\]"):
            make_executor(1, "127.0.0.1:1")
    else:
        pytest.skip("Ray is installed; its own test covers this")


@pytest.mark.slow
def test_pieces_on_a_local_ray_cluster():
    ray = pytest.importorskip("ray")
    try:
        done = {d.index: d for d in make_executor(1, "local").run(pid_square, [1, 2, 5])}
        assert {k: d.result[0] for k, d in done.items()} == {0: 1, 1: 4, 2: 25}
        assert os.getpid() not in {d.result[1] for d in done.values()}
    finally:
        ray.shutdown()


@pytest.mark.slow
def test_piece_whose_worker_is_killed_is_done_again(tmp_path):
    ray = pytest.importorskip("ray")
    try:
        pieces = [str(tmp_path / "first"), str(tmp_path / "second")]
        done = {d.index: d for d in make_executor(1, "local").run(killed_once, pieces)}
        assert {k: d.result for k, d in done.items()} == {0: 2, 1: 2}
    finally:
        ray.shutdown()


def killed_once(path: str) -> int:
    """Kill the worker with SIGKILL the first time; return how often it was tried."""
    with open(path, "a", encoding="utf-8") as file:
        file.write("x")
    tried = os.path.getsize(path)
    if tried == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return tried


def pid_square(number: int) -> tuple[int, int]:
    return number**2, os.getpid()


@pytest.mark.slow
def test_a_node_that_is_killed_costs_its_pieces_a_second_try(tmp_path):
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    node = cluster.add_node(num_cpus=1)
    try:
        executor = make_executor(1, cluster.address)
        # Both nodes have a piece in hand when the second one is killed with SIGKILL.
        waiting = executor.run(slow_square, [(k, str(tmp_path)) for k in range(3)])
        killer = threading.Timer(0.0, kill_when_busy, (cluster, node, tmp_path))
        killer.start()
        done = {d.index: d for d in waiting}
        killer.join()
        assert {k: d.result for k, d in done.items()} == {0: 0, 1: 1, 2: 4}
        # One of the pieces was begun twice.
        assert len(list(tmp_path.iterdir())) == 4
    finally:
        ray.shutdown()
        cluster.shutdown()


def kill_when_busy(cluster, node, folder) -> None:
    """Kill a node's processes once two pieces have begun."""
    while len(list(folder.iterdir())) < 2:
        time.sleep(0.1)
    cluster.remove_node(node, allow_graceful=False)


def slow_square(piece: tuple[int, str]) -> int:
    """Leave a trace of the attempt, and square after a while."""
    number, folder = piece
    (Path(folder) / f"{number}_{os.getpid()}").touch()
    time.sleep(4.0)
    return number**2


@pytest.mark.parametrize("address", ["127.0.0.1:1", "127.0.0.1:99999"])
def test_an_address_that_does_not_answer_is_said_in_time(address):
    pytest.importorskip("ray")
    with pytest.raises(InputError, match=f"{address}.*no cluster answers"):
        make_executor(1, address)


def test_a_port_of_something_else_is_said_in_time(monkeypatch):
    """A server that takes connections and never answers."""
    pytest.importorskip("ray")
    monkeypatch.setattr("pm01_nav.executors.ANSWERS_WITHIN_S", 3.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InputError, match=f"{address}.*no status within 3 s"):
            make_executor(1, address)
