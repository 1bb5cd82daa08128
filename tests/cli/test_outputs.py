# SPDX-License-Identifier: Apache-2.0
"""Where a command cannot write, it says so in one line, before it does the work."""

from __future__ import annotations

import os

import pytest
from click.testing import CliRunner

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.cli import pm01
from pm01_nav.config import check_output, make_folder
from pm01_nav.errors import InputError

EVALUATE = ("evaluate", "goal_seeking", "--task", "empty", "--episodes", "2", "--json")
REPLAY = ("replay", "goal_seeking", "--task", "empty", "-o")
BENCHMARK = ("benchmark", "--suite", "empty", "--planner", "goal_seeking", "--out")
MISSING, FOLDER = "its folder does not exist", "is a folder; give the name of a file"
IN_THE_WAY = "exists and is not a folder"

CASES = [
    ((*EVALUATE, "no/x.json"), f"json = no/x.json: {MISSING}"),
    ((*EVALUATE, "file/x.json"), f"json = file/x.json: {MISSING}"),
    ((*EVALUATE, "folder.json"), f"json = folder.json: {FOLDER}"),
    ((*REPLAY, "file/x.mp4"), f"output = file: {IN_THE_WAY}"),
    ((*REPLAY, "file/below/x.mp4"), "output = file/below: cannot be made"),
    ((*REPLAY, "folder.gif"), f"output = folder.gif: {FOLDER}"),
    ((*REPLAY, "no/x.png"), f"output = no/x.png: {MISSING}"),
    ((*REPLAY, "folder.png"), f"output = folder.png: {FOLDER}"),
    (("worlds", "show", "empty", "--count", "1", "-o", "folder.png"), FOLDER),
    (("worlds", "export", "empty", "--format", "sdf", "-o", "folder.sdf"), FOLDER),
    (("robots", "show", "pm01", "-o", "folder.png"), FOLDER),
    (("robots", "new", "file/x.yaml"), "file/x.yaml"),
    (("record", "excite", "-o", "file/x"), "file/x: cannot be written"),
    (("identify", "bag", "-o", "no/x.yaml"), f"output = no/x.yaml: {MISSING}"),
    (("identify", "bag", "-o", "x.yaml", "--plot", "no/x.png"), f"plot = no/x.png: {MISSING}"),
    (("identify", "bag", "-o", "x.yaml", "--plot", "x.doc"), "plot = x.doc: must end in .png"),
    ((*BENCHMARK, "file"), f"out = file: {IN_THE_WAY}"),
    ((*BENCHMARK, "file/below"), "out = file/below: cannot be made"),
    (("publish", "zoo:pm01-static", "--dry-run", "-o", "file/below"), "output = file/below"),
    (("tune", "--task", "static", "--steps", "512", "--out", "file"), f"out = file: {IN_THE_WAY}"),
    (("train", "--task", "static", "--steps", "512", "--out", "file"), "out = file: exists"),
]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a file, and with folders that are called like files."""
    (tmp_path / "file").write_text("years of work")
    for name in ("folder.json", "folder.gif", "folder.png", "folder.sdf"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("arguments", "words"), CASES, ids=[" ".join(case[0]) for case in CASES])
def test_one_line_and_nothing_lost(arguments, words, place, monkeypatch):
    monkeypatch.setattr(Evaluator, "summary", lambda *_: pytest.fail("it drove before it looked"))
    before = sorted(place.rglob("*"))
    error = CliRunner().invoke(pm01, arguments).exception
    if isinstance(error, InputError) and "pip install" in str(error):
        pytest.skip(str(error))
    assert isinstance(error, InputError), error
    assert words in str(error)
    assert "\n" not in str(error)
    assert sorted(place.rglob("*")) == before


def test_table_is_printed_though_the_file_cannot_be_written(place, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pm01_nav.config.write_atomically", full)
    done = CliRunner().invoke(pm01, (*EVALUATE, "x.json"))
    assert isinstance(done.exception, OSError)
    assert "time to goal" in done.output


def test_closed_folder_is_said(tmp_path, monkeypatch):
    """Root may write anywhere, so that the answer of the system is made up."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match=r"output = .*x: its folder cannot be written to"):
        check_output(tmp_path / "x")
    with pytest.raises(InputError, match=r"out = .*y: cannot be written to"):
        make_folder(tmp_path / "y")
