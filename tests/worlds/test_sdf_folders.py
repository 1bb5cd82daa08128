# SPDX-License-Identifier: Apache-2.0
"""Where models and meshes of SDF worlds are sought, and where not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds.reading import Reading
from pm01_nav.worlds.sdf import read_sdf
from tests.worlds.sdf_text import centres, model, sdf, solid

VARIABLES = (
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "GAZEBO_MODEL_PATH",
    "GAZEBO_RESOURCE_PATH",
)


@pytest.fixture(autouse=True)
def _nobodys_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in (*VARIABLES, "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)


def crate(folder: Path, x: float = 1.0) -> None:
    """Put a model into a folder of its own."""
    folder.mkdir(parents=True)
    text = f"<sdf version='1.6'>{model(solid(), f'{x} 0 0.5 0 0 0')}</sdf>"
    (folder / "model.sdf").write_text(text)


def world(tmp_path: Path, uri: str = "model://crate", folders: tuple[Path, ...] = ()) -> Reading:
    path = tmp_path / "pkg" / "worlds" / "room.world"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(sdf(f"<include><uri>{uri}</uri></include>"))
    return read_sdf(path, model_folders=folders)


@pytest.mark.parametrize(
    "folder", ["pkg/worlds", "pkg/worlds/models", "pkg/models", "home/.gazebo/models"]
)
def test_usual_folders(tmp_path: Path, folder: str) -> None:
    with pytest.raises(InputError, match=r"no such model .*give its folder \(--models DIR\)"):
        world(tmp_path)
    crate(tmp_path / folder / "crate")
    for uri in ("model://crate", "model:///crate", "model://crate/", "model://crate/model.sdf"):
        assert centres(world(tmp_path, uri)) == [[1.0, 0.0]]


@pytest.mark.parametrize("variable", VARIABLES)
def test_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str) -> None:
    crate(tmp_path / "second" / "crate")
    # Folders that are not there, and empty names, are passed over as by Gazebo.
    names = ["", str(tmp_path / "nowhere"), str(tmp_path / "second")]
    monkeypatch.setenv(variable, os.pathsep.join(names))
    assert centres(world(tmp_path)) == [[1.0, 0.0]]


def test_given_folders_come_first_and_in_their_order(tmp_path: Path) -> None:
    for x, folder in ((1.0, "pkg/models"), (2.0, "a"), (3.0, "b")):
        crate(tmp_path / folder / "crate", x)
    assert centres(world(tmp_path)) == [[1.0, 0.0]]
    assert centres(world(tmp_path, folders=(tmp_path / "b", tmp_path / "a"))) == [[3.0, 0.0]]
    assert centres(world(tmp_path, folders=(tmp_path / "a", tmp_path / "b"))) == [[2.0, 0.0]]


def test_ros_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    crate(tmp_path / "pkg" / "urdf" / "crate")
    crate(tmp_path / "other" / "crate", 2.0)
    crate(tmp_path / "ws" / "share" / "third" / "crate", 3.0)
    uris = ("model://urdf/crate", "model://pkg/urdf/crate", "file://urdf/crate")
    for uri in (*uris, "package://other/crate", "package://third/crate"):
        with pytest.raises(InputError, match="no such model"):
            world(tmp_path, uri)
    (tmp_path / "pkg" / "package.xml").write_text("<package/>")
    for uri in (*uris, "package://pkg/urdf/crate"):
        assert centres(world(tmp_path, uri)) == [[1.0, 0.0]]
    with pytest.raises(InputError, match="no such model"):
        world(tmp_path, "package://other/crate")
    (tmp_path / "other" / "package.xml").write_text("<package/>")
    assert centres(world(tmp_path, "package://other/crate")) == [[2.0, 0.0]]
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    assert centres(world(tmp_path, "package://third/crate")) == [[3.0, 0.0]]


def test_what_gazebo_has_downloaded(tmp_path: Path) -> None:
    uri = "https://fuel.example/1.0/Some One/models/Blue Crate"
    with pytest.raises(InputError, match="no such model"):
        world(tmp_path, uri)
    cache = tmp_path / "home/.gz/fuel/fuel.example/some one/models/blue crate"
    crate(cache / "2")
    crate(cache / "10", 5.0)
    assert centres(world(tmp_path, uri)) == [[5.0, 0.0]]
    assert centres(world(tmp_path, uri.replace(" ", "%20"))) == [[5.0, 0.0]]
    # A copy in a folder of models goes by its name.
    crate(tmp_path / "pkg" / "models" / "Post", 7.0)
    other = world(tmp_path, "https://fuel.example/1.0/x/models/Post")
    assert centres(other) == [[7.0, 0.0]]


@pytest.mark.parametrize(
    "uri",
    [
        "model://../secret",
        "file://../../secret",
        "package://../secret",
        "package://pkg/../secret",
        "model://link",
        "https://../1.0/../models/..",
        "https://fuel.example/1.0/x/models/../../../../secret",
    ],
)
def test_nothing_outside_of_the_folders(tmp_path: Path, uri: str) -> None:
    crate(tmp_path / "secret")
    (tmp_path / "pkg" / "models").mkdir(parents=True)
    (tmp_path / "pkg" / "models" / "link").symlink_to(tmp_path / "secret")
    (tmp_path / "home/.gz/fuel/fuel.example/x/models/a/1").mkdir(parents=True)
    (tmp_path / "pkg" / "package.xml").write_text("<package/>")
    with pytest.raises(InputError, match=r"leads out of the model folders|no such model"):
        world(tmp_path, uri)


def test_broken_config_does_not_hide_the_model(tmp_path: Path) -> None:
    crate(tmp_path / "pkg" / "models" / "crate")
    (tmp_path / "pkg/models/crate/model.config").write_text("<model><name>")
    assert centres(world(tmp_path)) == [[1.0, 0.0]]
