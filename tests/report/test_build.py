"""The page as a file: what it holds, what it refuses, and that nothing in it can run."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from click.testing import CliRunner

from pm01_nav.cli import InputError, main, pm01
from pm01_nav.report.build import write_report

HOSTILE = "</script><img src=x onerror=alert(1)>"


class Page(HTMLParser):
    """Collects a page's elements, and what would be fetched."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.handlers, self.addresses, self.text = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]
        self.addresses += [v for name, v in attrs if name in ("src", "href", "action", "data")]

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self):
        return " ".join(" ".join(self.text).split())


def page_of(folder, *more):
    return Page(write_report([folder, *more]).read_text(encoding="utf-8"))


SWEEP = {"sweep": "density", "label": "obstacles in 10 m x 10 m", "suite": "static"}


def test_whole_report(results):
    for entry, success in {"good": [True] * 8, "bad": [True] + [False] * 7}.items():
        folder = results("static", entry, success, traces=[0, 3])
        for value in (0.0, 8.0):
            results(f"static@{value:g}", entry, success, sweep=SWEEP | {"value": value})
    page = page_of(folder)
    assert "2 entries, 1 suite, 1 sweep, 48 episodes" in page.words
    # Success of 1 in 8; the difference of 87.5 points is significant in both directions.
    assert "12.5" in page.words
    assert "+87.5" in page.words
    assert "\N{MINUS SIGN}87.5" in page.words
    assert page.tags.count("dialog") == 1
    # One chart for the sweep and three of distributions.
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert len(re.findall('<svg [^>]*class="chart"', text)) == 4
    assert re.findall('data-replay="([^"]*)"', text) == [
        *("static/good/0", "static/good/3", "static/bad/0", "static/bad/3"),
    ]
    # The collision comes before the success.
    keys = re.findall('data-key="([^"]*)"', text)
    assert keys[2:] == ["static/bad/3", "static/bad/0"]


def test_barn_note_names_the_backend_of_each_suite(results, monkeypatch):
    """Scores of a suite in the plane and of one in an engine, in one report."""
    import numpy as np

    from tests.report import conftest

    made = conftest._results
    lengths = {"reference_path": np.array([10.0])}
    monkeypatch.setattr(conftest, "_results", lambda won: replace(made(won), **lengths))
    folder = results("static", "good", [True])
    results("static+mujoco", "good", [True])
    words = page_of(folder).words
    planar, engine = (f"pm01 {w}, not the official" for w in ("planar simulator", "backend mujoco"))
    assert f"BARN scores below: {planar} BARN evaluation; {engine} BARN evaluation." in words
    assert f"BARN scores: {planar} BARN evaluation." in words
    assert f"BARN scores: {engine} BARN evaluation." in words


@pytest.mark.parametrize(
    ("name", "words"), [("file/x.html", "exists and is not a folder"), ("x", "is a folder")]
)
def test_report_that_cannot_be_written_is_said(name, words, results, tmp_path):
    folder = results("static", "good", [True])
    (tmp_path / "file").write_text("years of work")
    with pytest.raises(InputError, match=words):
        write_report([folder], tmp_path / name)


def test_nothing_is_fetched(results):
    page = page_of(results("static", "good", [True], traces=[0]))
    assert all(address.startswith(("#", "data:,")) for address in page.addresses)


def test_hostile_names_stay_text(results):
    """Suite, entry, command and reason are from strangers; not one of them becomes an element."""
    about = {"about_entry": {"name": HOSTILE, "kind": HOSTILE, "source": HOSTILE}}
    about["about_entry"]["fingerprint"] = HOSTILE
    folder = results(
        HOSTILE, HOSTILE, [True, False], traces=[1], reason=HOSTILE, command=HOSTILE, **about
    )
    page = page_of(folder)
    assert "img" not in page.tags
    assert page.handlers == []
    assert HOSTILE in page.words


def test_a_page_has_only_its_own_scripts(results):
    """The policy names the hash of one script; a data block is none."""
    folder = results("static", "good", [True], traces=[0])
    text = write_report([folder]).read_text(encoding="utf-8")
    assert "script-src 'sha256-" in text
    assert "'unsafe-eval'" not in text
    assert re.findall("<script[^>]*>", text) == [
        '<script type="text/plain" data-replay="static/good/0">',
        "<script>",
    ]


def test_sparse_results(results):
    """One entry, no traces, no sweeps."""
    page = page_of(results("static", "only", [True, False]))
    assert "No replays are stored." in page.words
    assert "Sweeps" not in page.words
    assert "Pairs of entries" not in page.words


def test_sweeps_alone(results):
    page = page_of(results("static@0", "only", [True], sweep=SWEEP | {"value": 0.0}))
    assert "The results hold sweeps only." in page.words


def test_nobody_arrives(results):
    page = page_of(results("static", "lost", [False, False]))
    assert "Nobody reached the goal." in page.words


def test_warnings(results):
    folder = results("static", "one", [True] * 3, git_revision="aaa")
    results("static", "two", [True] * 2, git_revision="bbb-dirty")
    words = page_of(folder).words
    assert "Results of 2 revisions of the code: aaa, bbb-dirty." in words
    assert "(-dirty)" in words
    assert "Entries differ in their number of episodes: static 2 to 3." in words


def test_folders_are_merged_beside_the_report(results, tmp_path):
    first, second = results("static", "one", [True]), results("static", "two", [True], folder="y")
    path = write_report([first, second], tmp_path / "both" / "report.html")
    assert "one" in path.read_text(encoding="utf-8")
    data = json.loads((tmp_path / "both" / "results.json").read_text(encoding="utf-8"))
    assert set(data["entries"]) == {"one", "two"}
    assert not (first / "results.json").exists()


def test_other_worlds_are_refused(results):
    first = results("static", "one", [True])
    other = {"task": "static", "hash": "c" * 64, "sweep": None}
    second = results("static", "two", [True], folder="y", about_suite=other)
    with pytest.raises(InputError, match=r"cannot be merged: its suite static has the hash ccc"):
        write_report([first, second])


def test_a_damaged_trace_is_named(results):
    folder = results("static", "one", [True], traces=[0])
    file = next(folder.glob("replays/*/*/*.npz"))
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(InputError, match=r"00000000\.npz: is not a readable trace"):
        write_report([folder])


@pytest.mark.parametrize("parts", [False, True])
def test_no_results_is_one_line(tmp_path, parts, capsys, monkeypatch):
    if parts:
        (tmp_path / "parts").mkdir()
    monkeypatch.setattr("sys.argv", ["pm01", "report", str(tmp_path)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert "holds no results" in error
    assert error.count("\n") == 1


def test_command_line(results, tmp_path):
    folder = results("static", "one", [True])
    out = tmp_path / "some.html"
    done = CliRunner().invoke(pm01, ["report", str(folder), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert done.output.startswith(f"wrote {out}")
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
