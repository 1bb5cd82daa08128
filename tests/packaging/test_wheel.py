# SPDX-License-Identifier: Apache-2.0
"""The wheel and the sdist, built and used as somebody has them who has no checkout."""

from __future__ import annotations

import getpass
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

import pm01_nav

pytestmark = pytest.mark.slow
pytest.importorskip("build")
ROOT = Path(__file__).parents[2]
FILES_WANTED = (
    "pm01_nav/py.typed",
    "pm01_nav/robots/pm01.yaml",
    "pm01_nav/zoo/pm01-static/policy.onnx",
    "pm01_nav/zoo/pm01-static/card.yaml",
    "pm01_nav/training/hyperparameters/ppo.yaml",
    "pm01_nav/planners/parameters/dwa.yaml",
    "pm01_nav/report/templates/report.html",
)
HELP = """
import click
from click.testing import CliRunner
import pm01_nav
from pm01_nav.cli import pm01

def walk(command, words):
    said = CliRunner().invoke(pm01, [*words, "--help"])
    assert said.exit_code == 0, (words, said.output)
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            walk(command.get_command(context, name), [*words, name])

walk(pm01, [])
print(pm01_nav.__file__)
"""
ACT = """
import sys
import numpy as np
import pm01_nav

command = pm01_nav.load_policy(sys.argv[1]).act(np.full(360, 3.0), (1.0, 0.0), (0.0, 0.0))
assert command.shape == (2,) and np.isfinite(command).all()
print(pm01_nav.__file__)
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build both from a copy of what git knows; return the wheel and the sdist."""
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    return next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


@pytest.fixture(scope="module")
def python(built, tmp_path_factory):
    """Return the interpreter of an environment that has the wheel, and by path what it needs."""
    folder = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    clean = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(clean), "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(built[0])], check=True)
    site = next((folder / "lib").glob("python*")) / "site-packages"
    # Only the folder is added: the editable install of this checkout in it stays unknown.
    packages = [path for path in sys.path if path.endswith("site-packages")]
    (site / "needed.pth").write_text("\n".join(packages) + "\n")
    return clean


def run(*command: object, cwd: Path) -> str:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_both_hold_what_is_needed_and_nothing_of_this_machine(built):
    wheel, sdist = built
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        assert names.issuperset(FILES_WANTED)
        assert all(name.startswith(("pm01_nav/", "pm01_nav-")) for name in names)
        content = b"".join(archive.read(name) for name in names)
    with tarfile.open(sdist) as archive:
        inside = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
        assert inside.issuperset({*FILES_WANTED, "README.md", "LICENSE", "pyproject.toml"})
        assert not any(name.startswith((".venv", "runs", ".git/")) for name in inside)
    for secret in (str(ROOT), str(Path.home()) + "/", f"/home/{getpass.getuser()}"):
        assert secret.encode() not in content


def test_every_command_helps_a_policy_is_trained_and_acts(python, tmp_path):
    assert pm01_nav.__version__ in run(python.parent / "pm01", "--version", cwd=tmp_path)
    places = [run(python, "-c", HELP, cwd=tmp_path)]
    train = ("train", "--task", "empty", "--time-budget", "2", "--out", "run")
    run(python.parent / "pm01", *train, cwd=tmp_path)
    places += [run(python, "-c", ACT, name, cwd=tmp_path) for name in ("run", "zoo:pm01-static")]
    assert all(str(python.parents[1]) in place for place in places)
