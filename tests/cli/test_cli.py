# SPDX-License-Identifier: Apache-2.0
"""The command line as a user meets it: help, wrong input, and the way from training to film."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pm01_nav.cli import COMMANDS
from pm01_nav.cli.options import task_from_options
from pm01_nav.task.tasks import task_config

PM01 = str(Path(sys.executable).with_name("pm01"))
SMALL = [
    *("--set", "task.num_worlds=4"),
    *("--set", "train.ppo={n_envs: 32, n_steps: 16, batch_size: 256}"),
    *("--set", "train.eval_episodes=4"),
]


def pm01(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PM01, *arguments], capture_output=True, text=True, cwd=cwd, timeout=300)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A run of two iterations, made by the command line."""
    folder = tmp_path_factory.mktemp("cli") / "run"
    done = pm01("train", "--task", "static", "--steps", "1024", "--out", str(folder), *SMALL)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_help_explains(command):
    done = pm01(*command, "--help")
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) > 5


def test_import_and_help_load_nothing_heavy():
    code = (
        "import sys; import pm01_nav; import pm01_nav.cli; "
        "heavy = {'torch', 'numba', 'gymnasium', 'stable_baselines3', 'matplotlib', 'scipy'}; "
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


WRONG = {
    "unknown task": (["train", "--task", "moon", "--out", "x"], "task = 'moon'.*static"),
    "no out": (["train", "--task", "static"], "out: give --out"),
    "no task": (["train", "--out", "x"], "task: give --task"),
    "benchmark without a suite": (["benchmark", "--out", "x"], "suite: give --suite or --sweep"),
    "benchmark without a policy": (
        ["benchmark", "--suite", "static", "--out", "x"],
        "policy: give --policy or --planner",
    ),
    "benchmark of an unknown planner": (
        ["benchmark", "--suite", "static", "--planner", "moon", "--out", "x"],
        "planner = 'moon': unknown; allowed: .*dwa",
    ),
    "benchmark on an unknown sweep": (
        ["benchmark", "--sweep", "moon", "--planner", "dwa", "--out", "x"],
        "sweep = 'moon': unknown; allowed: density",
    ),
    "unknown key": (
        ["train", "--task", "static", "--out", "x", "--set", "task.goal_raduis=1"],
        "task.goal_raduis: unknown key; allowed here: .*goal_radius",
    ),
    "unknown section": (
        ["train", "--task", "static", "--out", "x", "--set", "tusk.a=1"],
        "tusk: unknown key; allowed here: task, train",
    ),
    "wrong type": (
        ["train", "--task", "static", "--out", "x", "--set", "train.ppo.gamma=high"],
        "train.ppo.gamma = 'high'",
    ),
    "negative": (["train", "--task", "static", "--out", "x", "--steps", "-4"], "steps = -4"),
    "NaN": (
        ["evaluate", "goal_seeking", "--task", "static", "--set", "task.goal_radius=.nan"],
        "task.goal_radius = nan",
    ),
    "impossible limit": (
        [
            *("evaluate", "goal_seeking", "--task", "static"),
            *("--set", "task.robot_changes.limits.linear_max=-1"),
        ],
        "limits.linear_max = -1",
    ),
    "unknown reward": (
        ["evaluate", "goal_seeking", "--task", "static", "--set", "task.rewards.luck.weight=1"],
        "rewards.luck: unknown; allowed: .*progress",
    ),
    "unknown algorithm": (
        ["train", "--task", "static", "--out", "x", "--algo", "dqn"],
        "algo = 'dqn'",
    ),
    "no map": (["train", "--task", "map", "--out", "x"], "map: .*--map"),
    "region without a map": (
        ["evaluate", "goal_seeking", "--task", "static", "--region", "0 0 5 5"],
        "region: is for the suites map, not for static",
    ),
    "half a region": (
        ["train", "--task", "map", "--map", "no.yaml", "--region", "0 0 5", "--out", "x"],
        "--region '0 0 5': must be four numbers",
    ),
    "missing map": (
        ["train", "--task", "map", "--map", "no.yaml", "--out", "x"],
        r"no\.yaml: cannot be read",
    ),
    "missing BARN": (
        ["evaluate", "goal_seeking", "--task", "barn", "--worlds", "nowhere"],
        "nowhere",
    ),
    "unknown policy": (["evaluate", "nobody", "--task", "static"], "policy = 'nobody'"),
    "unknown robot": (
        ["evaluate", "goal_seeking", "--task", "static", "--robot", "dalek"],
        "robot = 'dalek'.*pm01",
    ),
    "no run to resume": (["train", "--resume", "nowhere"], "nowhere: is no run folder"),
    "no run to export": (["export", "nowhere", "-o", "x.onnx"], "nowhere: is no run folder"),
    "look-ahead without a plan": (
        ["evaluate", "goal_seeking", "--task", "static", "--look-ahead", "2"],
        "look-ahead = 2: needs --global-plan",
    ),
    "unknown randomization": (
        ["train", "--task", "static", "--out", "x", "--randomization", "some"],
        "randomization = 'some': unknown; allowed: off, on, or the path of a .yaml file",
    ),
    "missing ranges": (
        ["evaluate", "goal_seeking", "--task", "static", "--randomization", "no.yaml"],
        r"no\.yaml: cannot be read",
    ),
    "film of unknown kind": (
        ["replay", "goal_seeking", "--task", "static", "-o", "x.avi"],
        r"\.avi.*\.mp4",
    ),
}


@pytest.mark.parametrize("case", WRONG, ids=list(WRONG))
def test_wrong_input_is_one_line_and_exit_code_2(case, tmp_path):
    import re

    arguments, expected = WRONG[case]
    done = pm01(*arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert re.search(expected, lines[0]), lines[0]
    assert list(tmp_path.iterdir()) == []


def test_config_file_and_flags_over_it(tmp_path):
    (tmp_path / "my.yaml").write_text("task: {name: empty, goal_radius: 0.4}\n")
    done = pm01(
        "train", "--config", "my.yaml", "--steps", "512", "--out", "x", *SMALL, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    stored = (tmp_path / "x" / "config.yaml").read_text()
    assert "name: empty" in stored
    assert "goal_radius: 0.4" in stored
    assert "steps: 512" in stored


def test_resume_with_another_task_is_refused(trained):
    done = pm01("train", "--resume", str(trained), "--task", "empty")
    assert done.returncode == 2
    assert "another task (static" in done.stderr


@pytest.mark.parametrize(
    ("option", "value", "stays"),
    [
        ("--seed", "7", "seed 0"),
        ("--curriculum", "staged", "curriculum none"),
        ("--set", "train.seed=7", "seed 0"),
        ("--set", "train.ppo.n_envs=16", "n_envs "),
    ],
)
def test_resume_in_another_way_is_refused(trained, option, value, stays):
    done = pm01("train", "--resume", str(trained), option, value)
    assert done.returncode == 2
    assert f"was made with {stays}" in done.stderr
    assert "it stays so" in done.stderr


def test_resume_takes_no_other_file(trained):
    done = pm01("train", "--resume", str(trained), "--config", str(trained / "config.yaml"))
    assert done.returncode == 2
    assert "leave --config away" in done.stderr


def test_folder_in_use_is_refused(trained):
    done = pm01("train", "--task", "static", "--steps", "512", "--out", str(trained), *SMALL)
    assert done.returncode == 2
    assert "--force" in done.stderr


def test_evaluate_writes_every_figure(trained):
    done = pm01("evaluate", str(trained), "--episodes", "10", "--json", "-")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    for rate in ("success_rate", "collision_rate", "timeout_rate"):
        low, high = summary[f"{rate}_ci95"]
        assert 0.0 <= low <= summary[rate] <= high <= 1.0
    names = {
        *("episodes", "spl", "time_to_goal_s", "path_length_m", "min_clearance_m"),
        *("mean_jerk", "steps_per_second", "git_revision", "versions", "machine", "command"),
    }
    assert names <= set(summary)
    assert summary["episodes"] == 10


def test_export_and_policy_that_does_not_fit(trained, tmp_path):
    assert pm01("export", str(trained), "-o", "p.onnx", cwd=tmp_path).returncode == 0
    assert pm01("evaluate", "p.onnx", "--episodes", "2", cwd=tmp_path).returncode == 0
    done = pm01("evaluate", "p.onnx", "--task", "barn_like", "--episodes", "2", cwd=tmp_path)
    assert done.returncode == 2
    assert "p.onnx: does not fit robot jackal: lidar.num_beams" in done.stderr


def test_replay_writes_a_film(trained, tmp_path):
    film = tmp_path / "film.mp4"
    changes = ["--set", "task.time_limit_s=0.5"]
    done = pm01("replay", str(trained), "--episodes", "2", "-o", str(film), *changes)
    assert done.returncode == 0, done.stderr
    assert film.stat().st_size > 1000


def write_trap(folder: Path) -> None:
    """Write a map of 8 m x 8 m at 10 cm: a wall from the lower edge up, free above 6.5 m."""
    rows = ["255 " * 39 + ("255 " if row < 15 else "0 ") + "255 " * 40 for row in range(80)]
    (folder / "trap.pgm").write_text("P2 80 80 255\n" + "\n".join(rows) + "\n")
    (folder / "trap.yaml").write_text(
        "{image: trap.pgm, mode: trinary, resolution: 0.1, origin: [0.0, 0.0, 0], negate: 0, "
        "occupied_thresh: 0.65, free_thresh: 0.25}\n"
    )


def test_region_of_a_map(tmp_path):
    write_trap(tmp_path)
    arguments = ["evaluate", "goal_seeking", "--task", "map", "--map", "trap.yaml"]
    arguments += ["--episodes", "20", "--json", "-"]
    # To the left of the wall, which ends at x = 4 m, nothing stands in the way.
    done = pm01(*arguments, "--region", "0 0 3.9 6.4", cwd=tmp_path)
    assert json.loads(done.stdout)["success_rate"] == 1.0
    assert "trap.yaml: read 80 x 80 cells of 0.1 m: 99.0 % free" in done.stderr
    refused = pm01(*arguments, "--region", "9 0 12 6", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.splitlines()[-1].startswith("error: region = 9 0 12 6: lies beside world")


def test_a_region_goes_with_its_map():
    base = task_config("map").model_copy(update={"map": "a.yaml", "region": (0, 0, 1, 1)})
    keys = {"task": None, "config_file": None, "changes": ()}
    assert task_from_options(base, **keys).region == (0, 0, 1, 1)
    assert task_from_options(base, **keys, map_="b.yaml").region is None
    assert task_from_options(base, **keys, map_="b.yaml", region=(1, 1, 2, 2)).region == (
        1,
        1,
        2,
        2,
    )


def test_global_plan_leads_a_blind_planner_through_a_map(tmp_path):
    write_trap(tmp_path)
    arguments = ["evaluate", "goal_seeking", "--task", "map", "--map", "trap.yaml"]
    arguments += ["--episodes", "40", "--json", "-"]
    alone = json.loads(pm01(*arguments, cwd=tmp_path).stdout)
    led = json.loads(pm01(*arguments, "--global-plan", "--look-ahead", "1.5", cwd=tmp_path).stdout)
    assert alone["success_rate"] < 0.8
    assert led["success_rate"] >= 0.95
    assert led["global_plan_look_ahead_m"] == 1.5


def test_sweep_trains_measures_and_is_gone_on_with(tmp_path):
    arguments = ["sweep", "--task", "static", "--steps", "512", *SMALL, "--seeds", "1"]
    arguments += ["--episodes", "4", "--suite", "static", "--suite", "empty", "--out", "x"]
    done = pm01(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "x" / "sweep.json").read_text())
    assert set(report["success_rate"]) == {"all", "static", "empty"}
    assert report["runs"][0]["steps"] == 512
    files = {path.name for path in (tmp_path / "x" / "seed_0").iterdir()}
    assert {"policy.onnx", "history.json", "config.yaml", "run.json"} <= files
    assert (tmp_path / "x" / "sweep.png").exists()
    before = (tmp_path / "x" / "seed_0" / "history.json").stat().st_mtime_ns
    assert pm01(*arguments, cwd=tmp_path).returncode == 0
    assert (tmp_path / "x" / "seed_0" / "history.json").stat().st_mtime_ns == before


def test_publish_sends_nothing(tmp_path):
    done = pm01("publish", "zoo:pm01-static", "-o", "x", cwd=tmp_path)
    assert done.returncode == 2
    assert "--dry-run" in done.stderr
    assert not (tmp_path / "x").exists()
    assert pm01("publish", "zoo:pm01-static", "--dry-run", "-o", "x", cwd=tmp_path).returncode == 0
    assert (tmp_path / "x" / "README.md").exists()


@pytest.mark.slow
def test_tune_in_two_processes_shares_one_study(tmp_path):
    pytest.importorskip("optuna")
    (tmp_path / "space.yaml").write_text("learning_rate: {low: 1.0e-4, high: 1.0e-2, log: true}\n")
    arguments = ["tune", "--task", "static", "--steps", "512", *SMALL, "--trials", "3"]
    arguments += ["--jobs", "2", "--space", "space.yaml", "--out", "x"]
    done = pm01(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "x" / "tuning.json").read_text())
    assert report["states"]["COMPLETE"] >= 3
    best = pm01(
        "train",
        "--task",
        "static",
        "--config",
        "x/best.yaml",
        "--steps",
        "512",
        *SMALL,
        "--out",
        "y",
        cwd=tmp_path,
    )
    assert best.returncode == 0, best.stderr
