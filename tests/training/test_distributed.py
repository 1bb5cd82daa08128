# SPDX-License-Identifier: Apache-2.0
"""Experience from workers: the same policy wherever they are, and whichever of them are killed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import threading
from collections.abc import Callable

import pytest
import torch

from pm01_nav.errors import InputError
from pm01_nav.training.config import TrainConfig
from tests.training.progress import Quiet
from tests.training.test_training import SAMPLES, config, curve, parameters, run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """A run of four iterations with two workers of 16 robots each."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    run(config(4, workers=2), folder)
    return folder


class Killing(Quiet):
    """Kill a worker with SIGKILL after the second iteration."""

    killed = 0

    def iteration(self, *arguments):
        super().iteration(*arguments)
        if self.iterations == 2:
            os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)
            self.killed += 1


def assert_same(one, other):
    mine, theirs = parameters(one), parameters(other)
    assert all(torch.equal(mine[name], theirs[name]) for name in mine)
    assert curve(one) == curve(other)


def test_experience_of_all_robots_is_learned_from(undisturbed):
    history = curve(undisturbed)
    assert history["steps"] == [SAMPLES, 2 * SAMPLES, 3 * SAMPLES, 4 * SAMPLES]
    checkpoint = torch.load(undisturbed / "last.pt", weights_only=True)
    assert checkpoint["last_obs"].shape[0] == 32
    assert {name.split("/")[0] for name in checkpoint["batch"]} == {"0", "1"}
    # Each worker's robots have random streams of their own.
    assert not torch.equal(checkpoint["batch"]["0/pose"], checkpoint["batch"]["1/pose"])
    assert (undisturbed / "policy.onnx").exists()


def test_killed_worker_is_replaced_and_changes_nothing(undisturbed, tmp_path):
    progress = Killing()
    run(config(4, workers=2), tmp_path / "x", progress)
    assert progress.killed == 1
    assert_same(tmp_path / "x", undisturbed)


def test_resumed_run_equals_the_uninterrupted_one(undisturbed, tmp_path):
    stopped = run(config(4, workers=2), tmp_path / "x", Quiet(interrupt_after=2))
    assert stopped.interrupted
    run(config(4, workers=2), tmp_path / "x", resume=True)
    assert_same(tmp_path / "x", undisturbed)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"algo": "sac"}, "algo ppo"),
        ({"learner": "rsl_rl"}, "learner sb3"),
        ({"icm": {}}, "icm"),
        ({"ppo": {"norm_obs": True}}, "norm_obs"),
        ({"workers": 3}, "must divide"),
    ],
)
def test_what_workers_cannot_do_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        TrainConfig.model_validate({"steps": 1, "workers": 2} | changes)


def test_a_cluster_that_is_not_there_leaves_the_former_run_alone(undisturbed):
    pytest.importorskip("ray")
    before = parameters(undisturbed)
    with pytest.raises(InputError, match="no cluster answers"):
        run(config(4, workers=2), undisturbed, force=True, ray="127.0.0.1:1")
    assert all(torch.equal(before[name], value) for name, value in parameters(undisturbed).items())


@pytest.fixture
def cluster():
    """A cluster of two nodes with a core each, so that both have a worker."""
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    yield cluster, cluster.add_node(num_cpus=1)
    ray.shutdown()
    cluster.shutdown()


@pytest.mark.slow
def test_worker_killed_on_a_cluster_of_two_nodes_changes_nothing(undisturbed, tmp_path, cluster):
    progress = Disturbing(kill_youngest_actor)
    run(config(4, workers=2), tmp_path / "x", progress, ray=cluster[0].address)
    progress.timer.join()
    assert progress.disturbed
    assert_same(tmp_path / "x", undisturbed)


@pytest.mark.slow
def test_lost_node_changes_nothing_though_no_core_is_left(undisturbed, tmp_path, cluster, caplog):
    both, second = cluster
    progress = Disturbing(lambda: both.remove_node(second, allow_graceful=False))
    run(config(4, workers=2), tmp_path / "x", progress, ray=both.address)
    progress.timer.join()
    assert progress.disturbed
    assert "no free core" in caplog.text
    assert_same(tmp_path / "x", undisturbed)


def kill_youngest_actor() -> None:
    """Kill one of Ray's workers with SIGKILL."""
    found = subprocess.run(["pgrep", "-n", "-f", "ray::_Actor"], capture_output=True, text=True)
    os.kill(int(found.stdout), signal.SIGKILL)


class Disturbing(Quiet):
    """Do something during the third iteration."""

    def __init__(self, something: Callable[[], None]) -> None:
        super().__init__()
        self.something = something
        self.timer = threading.Timer(0.02, self.disturb)
        self.disturbed = False

    def disturb(self) -> None:
        self.something()
        self.disturbed = True

    def iteration(self, *arguments):
        super().iteration(*arguments)
        if self.iterations == 2:
            self.timer.start()
