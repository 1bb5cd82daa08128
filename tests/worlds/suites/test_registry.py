# SPDX-License-Identifier: Apache-2.0
"""A source of worlds is one file, and is then known wherever worlds are named."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from pm01_nav.benchmark.suite import read_suite
from pm01_nav.cli import pm01
from pm01_nav.errors import InputError
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.suites import SOURCES

ONE_FILE = """
import json
from pathlib import Path

import numpy as np

from pm01_nav.config import FrozenModel
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.suites import suite, world_source
from pm01_nav.worlds.world import World

BOUNDS = (0.0, 0.0, 6.0, 6.0)


class PillarParams(FrozenModel):
    radius: float = 0.3


@suite(params=PillarParams)
def pillar(rng, params=None):
    radius = params.radius if params else rng.uniform(0.2, 0.5)
    return World("pillar", BOUNDS, discs=np.array([[3.0, 3.0, radius]]))


def halved(success):
    return {"half_of_success": 0.5 * float(success.mean())}


@world_source(path="worlds", figures=halved)
def pillars(wanted, worlds):
    radii = json.loads(Path(worlds).read_text())
    return build_pool(
        [World(f"p{k}", BOUNDS, discs=np.array([[3.0, 3.0, r]]), reference_length=4.0)
         for k, r in enumerate(radii)],
        wanted.radius,
    )
"""
RADII = [0.2, 0.3, 0.4]


@pytest.fixture
def pillars(tmp_path: Path, monkeypatch) -> Path:
    """Register both sources, here and in the processes that are started; return the file."""
    (tmp_path / "my_worlds.py").write_text(ONE_FILE)
    (tmp_path / "sitecustomize.py").write_text("import my_worlds")
    monkeypatch.syspath_prepend(tmp_path)
    package = Path(__file__).parents[3]
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{package}")
    for name in ("pillar", "pillars"):
        monkeypatch.setitem(SOURCES, name, None)  # to be taken out again
    importlib.reload(importlib.import_module("my_worlds"))
    (tmp_path / "radii.json").write_text(json.dumps(RADII))
    return tmp_path / "radii.json"


def run(*arguments: str) -> str:
    done = CliRunner().invoke(pm01, [str(argument) for argument in arguments])
    assert done.exit_code == 0, done.output or done.exception
    return done.output


def test_a_suite_and_a_reader_of_files_are_used_by_the_ordinary_commands(
    pillars: Path, tmp_path: Path
) -> None:
    small = ("--set", "task.num_worlds=4", "--set", "train.eval_episodes=4")
    small += ("--set", "train.ppo={n_envs: 8, n_steps: 16, batch_size: 128}", "--steps", "128")
    for name, files in (("pillar", ()), ("pillars", ("--worlds", str(pillars)))):
        folder = tmp_path / name
        run("train", "--task", name, *files, *small, "--out", folder)
        out = tmp_path / f"{name}.json"
        run("evaluate", folder, *files, "--episodes", "5", "--json", out)
        figures = json.loads(out.read_text())
        assert figures["task"] == name
        assert figures.get("half_of_success") == (0.5 * figures["success_rate"] if files else None)
        # Three worlds are visited in turn, and have a length to be judged by.
        assert figures.get("barn_worlds") == (3 if files else None)
    suites = ("--suite", "pillar", "--suite", f"pillars={pillars}")
    run("benchmark", *suites, "--planner", "goal_seeking", "--episodes", "4", "--jobs", "1",
        "--replays", "0", "--out", tmp_path / "results")  # fmt: skip
    results = json.loads((tmp_path / "results" / "results.json").read_text())["results"]
    assert [(found["suite"], found["episodes"]) for found in results] == [
        ("pillar", 4),
        ("pillars", 4),
    ]
    run("worlds", "show", "pillar", "--count", "1", "-o", tmp_path / "pillar.png")
    for command in (["train"], ["worlds"]):
        assert "pillar" in run(*command, "--help")


def test_worlds_are_drawn_with_parameters_or_read_the_same_in_both_splits(pillars: Path) -> None:
    drawn = task_config("pillar").model_copy(update={"suite_params": {"radius": 0.25}})
    assert [w.discs[0, 2] for w in world_pool(drawn, "train", 2).worlds] == [0.25, 0.25]
    # As many as are enough for the cache, which must tell the parameters apart.
    for radius in (0.25, 0.35):
        many = drawn.model_copy(update={"suite_params": {"radius": radius}})
        assert {w.discs[0, 2] for w in world_pool(many, "train", 64).worlds} == {radius}
    task = read_suite(f"pillars={pillars}", 1).task
    for split in ("train", "held_out"):
        assert [w.discs[0, 2] for w in world_pool(task, split, 1).worlds] == RADII


@pytest.mark.parametrize(
    ("suite", "changes", "words"),
    [
        ("pillars", {}, "worlds: this task needs it; give --worlds PATH"),
        ("pillars", {"worlds": "x", "map": "y"}, "map: is for the suites map, not for pillars"),
        ("pillar", {"worlds": "x"}, "worlds: is for the suites barn, dynabarn, pillars, not for"),
        ("pillar", {"suite_params": {"size": 1.0}}, "suite_params.size: unknown.*here: radius"),
        ("static", {"partial": True}, "partial: is for the suites map, not for static"),
        ("static", {"region": (0, 0, 1, 1)}, "region: is for the suites map, not for static"),
    ],
)
@pytest.mark.usefixtures("pillars")
def test_what_a_source_does_not_read_is_refused(suite: str, changes, words: str) -> None:
    task = task_config(suite).model_copy(update=changes)
    with pytest.raises(InputError, match=words):
        world_pool(task, "held_out", 1)
