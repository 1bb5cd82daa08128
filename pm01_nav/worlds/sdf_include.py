# SPDX-License-Identifier: Apache-2.0
"""Find the models and meshes of an SDF file: in known folders, never outside them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError

NO_OBSTACLES = ("sun", "ground_plane", "ground plane")
"""Models that every Gazebo has and that stand in nobody's way."""
PATH_VARIABLES = (
    "GZ_SIM_RESOURCE_PATH",
    "IGN_GAZEBO_RESOURCE_PATH",
    "GAZEBO_MODEL_PATH",
    "GAZEBO_RESOURCE_PATH",
)
"""Where Gazebo's generations look for models: folders with colons between them."""
USUAL_FOLDERS = ("~/.gazebo/models",)
CACHES = ("~/.gz/fuel", "~/.ignition/fuel")
"""What Gazebo has downloaded: SERVER/OWNER/models/NAME/VERSION, in small letters."""
PACKAGE_DEPTH = 4
"""A ROS package's own folder is at most so far above its world."""
MAX_INCLUDES, MAX_ELEMENTS = 5_000, 2_000_000
"""Included files, and their elements, each time they are included: a few files that include each
other can repeat without end."""


def is_no_obstacle(uri: str) -> bool:
    """Tell whether a model's address names one that stands in nobody's way."""
    name = uri.rstrip("/").rpartition("/")[2]
    return unquote(name).lower() in NO_OBSTACLES


class ModelFolders:
    """Folders with models; each file is parsed once."""

    def __init__(self, folders: Iterable[str | Path], beside: Path) -> None:
        """Look into ``folders`` first, then where Gazebo looks for a world in ``beside``.

        That is the world's folder, ``models`` in it and beside it, the folders in
        ``PATH_VARIABLES`` and ``AMENT_PREFIX_PATH``, ``~/.gazebo/models``, the world's ROS package
        and those beside it, and what Gazebo downloaded before.

        Raises:
            InputError: one of ``folders`` does not exist.
        """
        given = [Path(folder) for folder in folders]
        for folder in given:
            if not folder.is_dir():
                raise InputError(f"model folder {folder}: must be an existing folder")
        usual = [beside, beside / "models", beside / ".." / "models"]
        for variable in PATH_VARIABLES:
            usual += [Path(name) for name in os.environ.get(variable, "").split(os.pathsep) if name]
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        usual += [Path(prefix) / "share" for prefix in prefixes if prefix]
        usual += [_home(folder) for folder in USUAL_FOLDERS]
        self._package = _package_above(beside.resolve())
        if self._package is not None:
            usual.append(self._package)
        self._given = [folder.resolve() for folder in given]
        self._roots = list(dict.fromkeys([*self._given, *_existing(usual)]))
        self._caches = _existing([_home(folder) for folder in CACHES])
        self._siblings: set[Path] = set()
        self._parsed: dict[Path, tuple[Element, int]] = {}
        self._num_includes = self._num_elements = 0

    def __str__(self) -> str:
        """Name the folders that are looked through."""
        return ", ".join(map(str, self._roots))

    def find(self, uri: str, including: Path, where: str) -> Path | None:
        """Return the SDF file that ``uri`` names, None where there is none.

        Raises:
            InputError: it lies outside of the folders.
        """
        for base, name in self._candidates(uri, including):
            found = self._file(base, name, where)
            if found is not None:
                return found
        return None

    def find_file(self, uri: str, including: Path, where: str) -> Path | None:
        """Return the file, such as a mesh, that ``uri`` names, None where there is none.

        Raises:
            InputError: it lies outside of the folders.
        """
        for base, name in self._candidates(uri, including):
            found = self._file(base, name, where, folders=False)
            if found is not None:
                return found
        return None

    def parsed(self, path: Path) -> Element:
        """Return the root of an XML file.

        Raises:
            InputError: it is no XML, or all that was asked for is too much together.
        """
        if path not in self._parsed:
            root = parse_xml(path)
            self._parsed[path] = (root, sum(1 for _ in root.iter()))
        root, size = self._parsed[path]
        self._num_includes += 1
        self._num_elements += size
        if self._num_includes > MAX_INCLUDES or self._num_elements > MAX_ELEMENTS:
            limit = f"{MAX_INCLUDES} models or {MAX_ELEMENTS} elements"
            raise InputError(f"{path}: more than {limit} are included")
        return root

    def _candidates(self, uri: str, including: Path) -> Iterator[tuple[Path, str]]:
        """Yield the folders, and paths in them, that ``uri`` may name."""
        scheme, separator, name = uri.partition("://")
        if not separator or scheme == "file":
            name = name if separator else uri
            yield including.parent, name
            # As Gazebo does, with what is no address after all.
            yield from ((root, name) for root in self._roots if not name.startswith("/"))
        elif scheme in ("model", "package"):
            name = name.lstrip("/")
            yield from ((root, name) for root in self._roots)
            yield from self._in_package(name)
        elif scheme in ("http", "https"):
            yield from self._downloaded(unquote(name))

    def _in_package(self, name: str) -> Iterator[tuple[Path, str]]:
        """Yield where a file is in a ROS package: the world's own, or one beside it."""
        first, _, rest = name.partition("/")
        if self._package is None or first in ("", ".", ".."):
            return
        if first == self._package.name:
            yield self._package, rest
        sibling = self._package.parent / first
        if os.path.isfile(sibling / "package.xml"):
            self._siblings.add(sibling.resolve())
            yield sibling, rest

    def _downloaded(self, name: str) -> Iterator[tuple[Path, str]]:
        """Yield where a model of a server, or a file of it, may be."""
        server, *parts = name.strip("/").split("/")
        if "models" not in parts[1:-1]:
            return
        at = parts.index("models", 1)
        owner, model, rest = parts[at - 1], parts[at + 1], parts[at + 2 :]
        if rest and (rest[0].isdecimal() or rest[0] == "tip"):
            rest = rest[1:]
        file = "/".join(rest[1:] if rest[:1] == ["files"] else rest)
        for cache in self._caches:
            folder = cache / server / owner.lower() / "models" / model.lower()
            yield from ((version, file) for version in _newest_first(folder))
        # A copy goes by the name that folders of models have.
        yield from ((root, f"{model}/{file}") for root in self._roots)

    def _file(self, base: Path, name: str, where: str, *, folders: bool = True) -> Path | None:
        """Return the file below ``base``, or that of a model's folder."""
        try:
            path = self._inside(base / name, where)
            if folders and path.is_dir():
                path = self._inside(path / self._file_name(path, where), where)
            return path if path.is_file() else None
        except InputError:
            raise
        # A null byte, a name too long, a link to itself (a RuntimeError before Python 3.13).
        except (ValueError, OSError, RuntimeError):
            return None

    def _inside(self, path: Path, where: str) -> Path:
        """Return a path without links, which must lie in one of the folders."""
        resolved = path.resolve()
        allowed = (*self._roots, *self._caches, *self._siblings)
        if not any(resolved.is_relative_to(root) for root in allowed):
            raise InputError(f"{where}: leads out of the model folders")
        return resolved

    def _file_name(self, folder: Path, where: str) -> str:
        """Return what the folder's ``model.config`` names last, usually the newest version."""
        config = self._inside(folder / "model.config", where)
        if not config.is_file():
            return "model.sdf"
        try:
            names = [(sdf.text or "").strip() for sdf in self.parsed(config).findall("sdf")]
        except InputError:
            names = []
        return names[-1] if names and names[-1] else "model.sdf"


def _home(folder: str) -> Path:
    try:
        return Path(folder).expanduser()
    except RuntimeError:  # Nobody's home.
        return Path(folder)


def _existing(folders: Iterable[Path]) -> list[Path]:
    return [folder.resolve() for folder in folders if os.path.isdir(folder)]


def _package_above(folder: Path) -> Path | None:
    """Return the ROS package that a folder lies in."""
    for candidate in [folder, *folder.parents][: PACKAGE_DEPTH + 1]:
        if (candidate / "package.xml").is_file():
            return candidate
    return None


def _newest_first(folder: Path) -> list[Path]:
    if not os.path.isdir(folder):
        return []
    versions = [entry for entry in folder.iterdir() if entry.name.isdecimal()]
    return sorted(versions, key=lambda entry: -int(entry.name))
