# SPDX-License-Identifier: Apache-2.0
"""Results for those who plot themselves."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from pm01_nav.benchmark.merge import merge_results
from pm01_nav.benchmark.store import Part, ResultsFolder
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.benchmark.tables import backend_of, write_tables

ABOUT = {"task": "static", "robot": "pm01", "seed": 1, "control_dt": 0.1}


@pytest.fixture
def written(tmp_path, make_results):
    """Return a folder with two entries on one suite and one on a sweep's point."""
    folder = ResultsFolder(tmp_path)
    point = {"sweep": "density", "label": "obstacles", "suite": "static", "value": 8}
    for suite, entry, outcomes, sweep in (
        ("static", "dwa", "ssct", None),
        ("static", "mppi", "ssss", None),
        ("static@density=8", "dwa", "s", point),
    ):
        header = {
            "suite": suite,
            "entry": entry,
            "first": 0,
            "about_suite": ABOUT | {"hash": suite, "sweep": sweep},
            "about_entry": {"name": entry, "kind": "planner", "fingerprint": entry},
        }
        folder.save(Part(header, make_results(outcomes)))
    folder.save_timing("static", "dwa", [1.0, 2.0, 3.0, 4.0, 100.0])
    write_tables(merge_results([tmp_path]), tmp_path)
    return tmp_path


def test_json_has_figures_and_comparisons(written) -> None:
    data = json.loads((written / "results.json").read_text(encoding="utf-8"))
    assert data["suites"]["static"]["hash"] == "static"
    dwa, mppi, swept = data["results"]
    assert (dwa["success_rate"], dwa["collision_rate"], dwa["timeout_rate"]) == (0.5, 0.25, 0.25)
    # 4 m of 5 m in half of the episodes.
    assert dwa["spl"] == pytest.approx(0.4)
    assert (mppi["entry"], mppi["success_rate"]) == ("mppi", 1.0)
    assert (dwa["compute_ms_median"], dwa["compute_ms_p99"]) == (3.0, pytest.approx(96.16))
    assert swept["suite"] == "static@density=8"
    # Pairs on sweeps are not compared.
    [pair] = data["comparisons"]
    assert (pair["first"], pair["second"], pair["success_difference"]) == ("dwa", "mppi", -0.5)


def test_csv_has_a_line_for_each_entry_on_each_suite(written) -> None:
    with (written / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["suite"], r["entry"]) for r in rows] == [
        ("static", "dwa"),
        ("static", "mppi"),
        ("static@density=8", "dwa"),
    ]
    # Wilson's interval of 2 in 4 by hand: (2 + 1.92) / (4 + 3.84) -+ 0.3496.
    assert float(rows[0]["success_rate_ci95_low"]) == pytest.approx(0.150, abs=1e-3)
    assert float(rows[0]["success_rate_ci95_high"]) == pytest.approx(0.850, abs=1e-3)
    assert rows[1]["compute_ms_median"] == ""


def test_csv_of_episodes(written) -> None:
    with (written / "episodes.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    assert [row["success"] for row in rows[:4]] == ["True", "True", "False", "False"]
    assert [row["episode"] for row in rows[4:8]] == ["0", "1", "2", "3"]
    assert {float(row["path_length"]) for row in rows} == {5.0}
    assert np.isnan(float(rows[0]["intrusion"]))


def test_backend_is_known_of_new_and_of_older_results(written) -> None:
    """Older headers have no such key; the suite's name had the backend added even then."""
    data = json.loads((written / "results.json").read_text(encoding="utf-8"))
    assert {result["backend"] for result in data["results"]} == {"planar"}
    assert backend_of("barn+pybullet", ABOUT) == "pybullet"
    assert backend_of("barn+harsh", ABOUT) == "planar"
    suite = read_suite("static", 1, backend="mujoco")
    assert backend_of("any", suite.describe()) == "mujoco"
