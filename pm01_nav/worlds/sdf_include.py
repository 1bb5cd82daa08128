# SPDX-License-Identifier: Apache-2.0
"""Find the models that an SDF file includes: in given folders, never outside them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError

NO_OBSTACLES = ("sun", "ground_plane")
"""Models that every Gazebo has and that stand in nobody's way."""
MAX_INCLUDES, MAX_ELEMENTS = 5_000, 2_000_000
"""Included files, and their elements, each time they are included: a few files that include each
other can repeat without end."""


class ModelFolders:
    """Folders with models; each file is parsed once."""

    def __init__(self, folders: Iterable[str | Path], beside: Path) -> None:
        """Look into ``folders`` first, then into ``beside``, the folder of the world.

        Raises:
            InputError: one of ``folders`` does not exist.
        """
        given = [Path(folder) for folder in folders]
        for folder in given:
            if not folder.is_dir():
                raise InputError(f"model folder {folder}: must be an existing folder")
        self._roots = [folder.resolve() for folder in (*given, beside)]
        self._parsed: dict[Path, tuple[Element, int]] = {}
        self._num_includes = self._num_elements = 0

    def find(self, uri: str, including: Path, where: str) -> Path | None:
        """Return the SDF file that ``uri`` names, None for a model that is no obstacle.

        Raises:
            InputError: there is no such file in the folders.
        """
        scheme, separator, rest = uri.partition("://")
        if separator and scheme not in ("model", "file"):
            raise InputError(f"{where}: only local models (model://, file://) are read")
        name = rest if separator else uri
        bases = self._roots if scheme == "model" and separator else [including.parent]
        for base in bases:
            found = self._file(base, name, where)
            if found is not None:
                return found
        if name.strip("/") in NO_OBSTACLES:
            return None
        folders = ", ".join(map(str, self._roots))
        raise InputError(f"{where}: no such model in {folders}; give its folder")

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

    def _file(self, base: Path, name: str, where: str) -> Path | None:
        """Return the file, or the file of the model's folder, below ``base``."""
        try:
            path = self._inside(base / name, where)
            if path.is_dir():
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
        if not any(resolved.is_relative_to(root) for root in self._roots):
            raise InputError(f"{where}: leads out of the model folders")
        return resolved

    def _file_name(self, folder: Path, where: str) -> str:
        """Return what the folder's ``model.config`` names last, usually the newest version."""
        config = self._inside(folder / "model.config", where)
        if not config.is_file():
            return "model.sdf"
        names = [(sdf.text or "").strip() for sdf in self.parsed(config).findall("sdf")]
        return names[-1] if names and names[-1] else "model.sdf"
