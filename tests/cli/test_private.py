# SPDX-License-Identifier: Apache-2.0
"""Nothing that is written names the machine, its user, their folders or where the code lies."""

from __future__ import annotations

import json
import shutil
import socket
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

from pm01_nav.benchmark.policies import trained_task
from pm01_nav.cli import pm01
from pm01_nav.compilation import cache_folder
from pm01_nav.policy import OnnxPolicy
from pm01_nav.policy.onnx_file import cleaned, set_metadata
from pm01_nav.provenance import shown, shown_command, shown_path
from pm01_nav.robot import load_robot
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.worlds.files import read_world
from pm01_nav.zoo import FOLDER, zoo_names

ROOT = Path(__file__).resolve().parents[2]
USER, HOST = "s0mebody", "h0st-of-s0mebody"
MAP = "bounds: [0, 0, 6, 6]\ndiscs: [[3, 3, 0.4]]\nname: office\n"
SMALL = ("n_envs=8", "n_steps=16", "batch_size=64", "n_epochs=1")


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """A machine with a name, its user's home, and a working folder that is not in it."""
    place = tmp_path_factory.mktemp("machine")
    with pytest.MonkeyPatch.context() as patch:
        home = place / "home" / USER
        for folder in (home / "maps", home / "my robots", place / "work"):
            folder.mkdir(parents=True)
        # Workers need not compile everything anew.
        patch.setenv("PM01_CACHE", str(cache_folder()))
        patch.setenv("HOME", str(home))
        patch.setattr(socket, "gethostname", lambda: HOST)
        patch.chdir(place / "work")
        yield place


def run(patch: pytest.MonkeyPatch, *arguments: str) -> None:
    patch.setattr(sys, "argv", [str(ROOT / ".venv/bin/pm01"), *arguments])
    pm01(list(arguments), standalone_mode=False)


@pytest.fixture(scope="module")
def trained(machine) -> Path:
    """A run with a map and a robot from the home folder, in a folder given by its whole path."""
    home, out = machine / "home" / USER, machine / "runs of mine" / "x"
    (home / "maps" / "office.yaml").write_text(MAP, encoding="utf-8")
    robot = home / "my robots" / "slow.yaml"
    shutil.copy(ROOT / "pm01_nav" / "robots" / "pm01.yaml", robot)
    sizes = [text for name in SMALL for text in ("--set", f"train.ppo.{name}")]
    small = ["--set", "train.eval_episodes=2", "--set", "train.threads=1", *sizes]
    given = ["--map", str(home / "maps" / "office.yaml"), "--robot", str(robot)]
    with pytest.MonkeyPatch.context() as patch:
        run(patch, "train", "--task", "map", *given, "--steps", "256", "--out", str(out), *small)
    return out


def contents(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the content of each file, archives unpacked."""
    for file in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = str(file.relative_to(folder))
        yield name, name.encode() + file.read_bytes()
        if zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as archive:
                for part in archive.namelist():
                    yield f"{name}:{part}", part.encode() + archive.read(part)


def leaks(folder: Path, machine: Path) -> list[str]:
    told = (USER, HOST, str(machine), str(ROOT), str(ROOT.parent))
    return [f"{n}: {t}" for n, text in contents(folder) for t in told if t.encode() in text]


def test_a_run_tells_nothing_and_can_be_gone_on_with(trained, machine):
    names = {name.split("/")[0] for name, _ in contents(trained)}
    kept = {"config.yaml", "run.json", "history.json", "policy.onnx", "last.pt", "best.pt"}
    assert names >= kept | {"tensorboard", "given"}
    assert leaks(trained, machine) == []
    session = json.loads((trained / "run.json").read_text())["sessions"][0]
    assert session["command"].startswith(
        "pm01 train --task map --map office.yaml --robot slow.yaml"
    )
    assert "--out x " in session["command"]
    text = (trained / "config.yaml").read_text()
    assert "map: office.yaml" in text
    # The copies are the same robot and the same world, wherever the run is read from.
    config = RunFolder(trained).load_config()
    assert config.task.robot_spec() == load_robot("pm01")
    world = read_world(str(config.task.map))
    assert (world.name, world.bounds, world.discs.tolist()) == (
        "office",
        (0, 0, 6, 6),
        [[3, 3, 0.4]],
    )
    assert trained_task(str(trained)) == config.task
    from_file = trained_task(str(trained / "policy.onnx"))
    assert from_file is not None
    assert from_file.robot_spec() == load_robot("pm01")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(machine)
        run(patch, "train", "--resume", str(trained), "--steps", "512")
    assert leaks(trained, machine) == []
    assert len(json.loads((trained / "run.json").read_text())["sessions"]) == 2


def test_the_same_files_may_be_named_again_to_go_on(trained, machine, monkeypatch):
    given = machine / "home" / USER / "maps" / "office.yaml"
    monkeypatch.chdir(machine / "work")
    run(monkeypatch, "train", "--resume", str(trained), "--steps", "768", "--map", str(given))
    assert leaks(trained, machine) == []


def test_what_is_made_of_a_run_tells_nothing(trained, machine, monkeypatch):
    out = machine / "made"
    out.mkdir()
    policy = str(trained / "policy.onnx")
    given = ["--robot", str(machine / "home" / USER / "my robots" / "slow.yaml")]
    run(monkeypatch, "export", str(trained), "-o", str(out / "again.onnx"))
    map_ = str(machine / "home" / USER / "maps" / "office.yaml")
    held_out = ["evaluate", policy, "--task", "map", "--map", map_, *given, "--episodes", "2"]
    run(monkeypatch, *held_out, "--json", str(out / "metrics.json"))
    figures = json.loads((out / "metrics.json").read_text())
    assert (figures["policy"], figures["robot"]) == ("policy.onnx", "slow.yaml")
    results = ["--out", str(out / "results"), "--episodes", "2", "--replays", "1", "--jobs", "1"]
    run(monkeypatch, "benchmark", "--suite", f"map={map_}", *given, "--policy", policy, *results)
    run(monkeypatch, "report", str(out / "results"))
    run(monkeypatch, "publish", policy, "--dry-run", "-o", str(out / "card"))
    run(monkeypatch, "record", policy, "-o", str(out / "bag"), *given, "--seconds", "1")
    names = " ".join(name for name, _ in contents(out))
    for name in ("results.json", ".npz:header.npy", "report.html", "card/README.md", ".mcap"):
        assert name in names
    assert leaks(out, machine) == []


def test_paths_below_the_working_folder_stay_and_others_keep_their_names(machine, monkeypatch):
    monkeypatch.chdir(machine / "work")
    inside, outside = machine / "work" / "runs" / "x", machine / "other" / "a b.yaml"
    assert shown_path(inside) == shown_path("runs/x") == shown_path("./runs/../runs/x") == "runs/x"
    assert shown_path(outside) == shown_path("../other/a b.yaml") == "a b.yaml"
    # Seen from the root, a path below it would name the user.
    monkeypatch.chdir("/")
    assert shown_path(machine / "home" / USER / "maps" / "office.yaml") == "office.yaml"
    monkeypatch.chdir(machine / "work")
    for given, expected in (
        (["--out", str(inside)], "--out runs/x"),
        ([f"--out={inside}"], "--out=runs/x"),
        (["--set", f"task.map={outside}"], "--set 'task.map=a b.yaml'"),
        (["--policy", "mine=/a/b/policy.onnx"], "--policy mine=policy.onnx"),
        (["--suite", "map=../maps/x.yaml"], "--suite map=x.yaml"),
        (["--config", "~other/x.yaml"], "--config x.yaml"),
        (["--config", "a/../../x.yaml"], "--config x.yaml"),
        # An address may have a password in it; its end is the data base.
        (["--storage", "postgresql://me:secret@host.lan/study"], "--storage postgresql://study"),
        (["--ray", f"{HOST}:6379"], "--ray localhost:6379"),
        # A name of ROS's is no path.
        (["--set", "task.gazebo.namespace=/robot1"], "--set task.gazebo.namespace=/robot1"),
        (["zoo:pm01-static", "--task", "static"], "zoo:pm01-static --task static"),
        (["--set", "task.suite_params={people: 2}"], "--set 'task.suite_params={people: 2}'"),
    ):
        assert shown_command("pm01", given) == f"pm01 {expected}"
    lost = f"OSError: cannot read '{outside}' (see {outside.parent}/log.txt)"
    assert shown({"why": [lost, 3]}) == {
        "why": ["OSError: cannot read 'a b.yaml' (see log.txt)", 3]
    }


def notes(message, found=()) -> set[str]:
    """Return where in a model, functions and subgraphs included, somebody left notes."""
    marks = {"metadata_props", "doc_string", "producer_name", "producer_version"}
    found = set(found)
    for field, value in message.ListFields():
        if field.name in marks:
            found.add(f"{type(message).__name__}.{field.name}")
        elif field.message_type is not None:
            for each in value if hasattr(value, "__len__") else [value]:
                found |= notes(each)
    return found


@pytest.mark.parametrize("name", zoo_names())
def test_zoo_tells_nothing(name):
    content = (FOLDER / name / "policy.onnx").read_bytes()
    assert notes(onnx.ModelProto.FromString(content)) == {"ModelProto.metadata_props"}
    assert b'File "' not in content
    assert b"/work" not in content
    metadata = OnnxPolicy(f"zoo:{name}").metadata
    assert shown(metadata) == metadata
    assert cleaned(content, metadata) == content


def test_a_cleaned_file_answers_bit_by_bit_as_before(trained, tmp_path, monkeypatch):
    model = onnx.load(trained / "policy.onnx")
    assert notes(model) == {"ModelProto.metadata_props"}
    model.producer_name, model.doc_string = "pytorch", "made in /home/me"
    for part in (model.graph, *model.graph.node, *model.graph.input, *model.graph.value_info):
        part.metadata_props.add(key="pkg.torch.onnx.stack_trace", value='File "/home/me/x.py"')
    before = model.SerializeToString()
    metadata = OnnxPolicy(trained / "policy.onnx").metadata
    after = cleaned(before, metadata | {"command": "pm01 train --out /home/me/x"})
    assert notes(onnx.ModelProto.FromString(after)) == {"ModelProto.metadata_props"}
    assert b"/home" not in after
    rows = np.random.default_rng(5).normal(
        0, 3, (64, OnnxPolicy(trained / "policy.onnx").layout.size)
    )
    commands = [
        onnxruntime.InferenceSession(content).run(None, {"observation": rows.astype(np.float32)})[0]
        for content in ((trained / "policy.onnx").read_bytes(), after)
    ]
    assert np.array_equal(*commands)
    # What lies deeper, in a branch of a function.
    branch = onnx.helper.make_graph([onnx.helper.make_node("Identity", ["a"], ["b"])], "g", [], [])
    branch.node[0].doc_string = "in /home/me"
    choice = onnx.helper.make_node("If", ["c"], ["d"], then_branch=branch)
    model.functions.add(name="f", domain="d").node.append(choice)
    assert "NodeProto.doc_string" in notes(model)
    set_metadata(model, metadata)
    assert notes(model) == {"ModelProto.metadata_props"}
    # An older file is cleaned when it is published.
    (tmp_path / "old.onnx").write_bytes(before)
    run(
        monkeypatch, "publish", str(tmp_path / "old.onnx"), "--dry-run", "-o", str(tmp_path / "out")
    )
    assert notes(onnx.load(tmp_path / "out" / "policy.onnx")) == {"ModelProto.metadata_props"}
