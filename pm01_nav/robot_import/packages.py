# SPDX-License-Identifier: Apache-2.0
"""Where the files are that a robot's description names by ROS package."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError

MAX_FOLDERS = 20_000
"""A search looks at no more folders."""
DEPTH = 6
"""Packages lie at most so many folders deep in a workspace."""
SCHEMES = ("package://", "model://")


class Packages:
    """Folders of ROS packages by name; those that a person names come first."""

    def __init__(self, file: Path, folders: Sequence[str | Path] = ()) -> None:
        """Look through ``folders``, around ``file``, and where ROS's variables point.

        Raises:
            InputError: one of ``folders`` does not exist.
        """
        self._file = file.absolute()
        self._folders = [Path(folder).absolute() for folder in folders]
        self.found: dict[str, Path] = {}
        for given, folder in zip(folders, self._folders, strict=True):
            if not folder.is_dir():
                raise InputError(f"--packages {given}: no such folder")
            self._search(folder, DEPTH)
        own = next((f for f in self._file.parents if _is_package(f)), None)
        if own is not None:
            self._search(own.parent, 1)
        for folder in _variable("ROS_PACKAGE_PATH"):
            self._search(folder, DEPTH)
        for prefix in _variable("AMENT_PREFIX_PATH"):
            self._search(prefix / "share", 1)

    def folder(self, name: str) -> Path | None:
        """Return a package's folder, None where it is not found."""
        if name in self.found:
            return self.found[name]
        # Without a package.xml the folder's own name is all there is.
        for folder in (*self._folders, *self._file.parents):
            if folder.name == name:
                return folder
            if (folder / name).is_dir():
                return folder / name
        return None

    def path(self, uri: str) -> Path | None:
        """Return where a mesh's file name leads, None where nobody knows."""
        for scheme in SCHEMES:
            if uri.startswith(scheme):
                name, _, rest = uri.removeprefix(scheme).partition("/")
                folder = self.folder(name) if name else None
                return None if folder is None else folder / rest
        local = uri.removeprefix("file://")
        return None if "://" in local else self._file.parent / local

    def _search(self, folder: Path, depth: int) -> None:
        """Note the packages in a folder and below; a package holds no other."""
        level, seen = [folder], 0
        for _ in range(depth + 1):
            following: list[Path] = []
            for place in level:
                seen += 1
                if seen > MAX_FOLDERS:
                    return
                if _is_package(place):
                    self.found.setdefault(_name(place), place)
                    self.found.setdefault(place.name, place)
                else:
                    following.extend(_folders_in(place))
            level = following


def _variable(name: str) -> list[Path]:
    return [Path(part) for part in os.environ.get(name, "").split(os.pathsep) if part]


def _is_package(folder: Path) -> bool:
    return (folder / "package.xml").is_file()


def _name(folder: Path) -> str:
    try:
        return (parse_xml(folder / "package.xml").findtext("name") or folder.name).strip()
    except InputError:
        return folder.name


def _folders_in(folder: Path) -> Iterator[Path]:
    try:
        inside = sorted(folder.iterdir())
    except OSError:
        return
    yield from (f for f in inside if not f.name.startswith(".") and f.is_dir())
