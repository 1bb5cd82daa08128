# SPDX-License-Identifier: Apache-2.0
"""The <state> of saved worlds, as Gazebo classic applies it."""

from __future__ import annotations

from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from tests.worlds.sdf_text import centres, model, read, sdf, solid


def state(*content: str) -> str:
    return f"<state world_name='hall'>{''.join(content)}</state>"


def moved(name: str, pose: str, content: str = "") -> str:
    return f"<model name='{name}'><pose frame=''>{pose}</pose>{content}</model>"


LINK = "<link name='link'><pose>{}</pose></link>"


def test_state_moves_models_and_links(tmp_path: Path) -> None:
    # As in the small case of the issue: 4 m to the left, 3 m down; and a link on its own.
    text = sdf(
        model(solid(), "2 2 0.5 0 0 0", "crate"),
        model(solid(), "5 5 0.5 0 0 0", "loose"),
        model(solid(), "7 7 0.5 0 0 0", "kept"),
        state(
            moved("crate", "-2 -1 0.5 0 0 0"),
            moved("loose", "5 5 0.5 0 0 0", LINK.format("6 3 0.5 0 0 0")),
            moved("spawned", "0 0 0 0 0 0"),
        ),
    )
    reading = read(tmp_path, text)
    assert centres(reading) == [[-2.0, -1.0], [6.0, 3.0], [7.0, 7.0]]
    assert reading.notes == ()


def test_models_inside_move_along_or_on_their_own(tmp_path: Path) -> None:
    # The outer model is turned by 90 degrees: (2, 0) in it points to (0, 2).
    quarter = "1.5707963267948966"
    inner = model(solid(), "2 0 0 0 0 0", "inner") + model(solid(), "4 0 0 0 0 0", "other")
    outer = f"<model name='outer'><pose>0 0 0.5 0 0 0</pose>{inner}</model>"
    nested = moved("other", "9 1 0.5 0 0 0")
    text = sdf(outer, state(moved("outer", f"1 1 0.5 0 0 {quarter}", nested)))
    assert centres(read(tmp_path, text)) == [[1.0, 3.0], [9.0, 1.0]]


def test_state_of_included_models_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "crate").mkdir()
    (tmp_path / "crate" / "model.sdf").write_text(f"<sdf version='1.6'>{model(solid())}</sdf>")
    include = "<include><uri>model://crate</uri><name>{}</name><pose>{}</pose></include>"
    text = sdf(
        include.format("one", "1 0 0.5 0 0 0"),
        include.format("two", "2 0 0.5 0 0 0"),
        state(moved("two", "5 0 0.5 0 0 0")),
    )
    assert centres(read(tmp_path, text)) == [[1.0, 0.0], [5.0, 0.0]]


def test_scale_insertions_and_deletions(tmp_path: Path) -> None:
    text = sdf(
        model(solid(), "2 2 0.5 0 0 0", "big"),
        model(solid(), "4 4 0.5 0 0 0", "gone"),
        state(
            moved("big", "2 2 0.5 0 0 0", "<scale>2 3 1</scale>"),
            f"<insertions>{model(solid(), '8 8 0.5 0 0 0', 'new')}</insertions>",
            "<deletions><name>gone</name></deletions>",
        ),
        # Gazebo looks at the first alone.
        state(moved("big", "100 100 0.5 0 0 0")),
    )
    reading = read(tmp_path, text)
    assert centres(reading) == [[2.0, 2.0], [8.0, 8.0]]
    assert reading.notes == ("deleted by <state>: 'gone'",)
    big = reading.world.polygons[0]
    assert (big.min(axis=0).tolist(), big.max(axis=0).tolist()) == ([1.0, 0.5], [3.0, 3.5])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (moved("m", "1 2"), "state: model 'm': pose = '1 2': must be 6 number"),
        (moved("m", "0 0 0 0 0 0", LINK.format("x")), "state: model 'm': link: pose = 'x'"),
        (moved("m", "0 0 0 0 0 0", "<scale>1 0 1</scale>"), "state: model 'm': scale = .*above 0"),
    ],
)
def test_refused(tmp_path: Path, content: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"hall\.sdf: {words}"):
        read(tmp_path, sdf(model(solid()), state(content)))
