# SPDX-License-Identifier: Apache-2.0
"""The models of an SDF world as a tree: nested and included ones found, frames named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_frames import Scope
from pm01_nav.worlds.sdf_include import ModelFolders, is_no_obstacle
from pm01_nav.worlds.sdf_pose import frame_and_pose, is_true
from pm01_nav.worlds.sdf_report import Report

MAX_INCLUDE_DEPTH = 8
LENIENT_BEFORE = (1, 7)
"""Before this version of SDF Gazebo took a frame that it did not know for the usual one."""


class Source(NamedTuple):
    """Where an element comes from."""

    where: str
    """For messages."""
    file: Path
    version: tuple[int, ...]
    depth: int
    """Files that include each other, up to here."""


@dataclass
class Model:
    """A model, or the world, which holds them."""

    name: str
    element: Element
    source: Source
    scope: Scope
    is_static: bool
    key: str = ""
    """Its name in the scope of what holds it, where names may have been given twice."""
    models: list[Model] = field(default_factory=list)

    def walk(self) -> Iterator[Model]:
        """Yield this model and all in it."""
        yield self
        for model in self.models:
            yield from model.walk()


def version_of(root: Element) -> tuple[int, ...]:
    """Return the version of SDF that a file says it is in."""
    parts = (root.get("version") or "").strip().split(".")
    return tuple(int(part) for part in parts if part.isdecimal() and len(part) < 9)


class ModelReader:
    """Builds the tree, file by file."""

    def __init__(self, folders: ModelFolders, report: Report) -> None:
        """Look for included models in ``folders``; name in ``report`` what is not there."""
        self._folders = folders
        self._report = report

    def read(self, content: Element, name: str, source: Source, *, home: str) -> Model:
        """Return ``content``, a model, world or file, with all models in it.

        Raises:
            InputError: a pose or an included file is wrong.
        """
        lenient = source.version < LENIENT_BEFORE
        scope = Scope(home, source.where, lenient=lenient)
        found = Model(name, content, source, scope, is_true(content.findtext("static")))
        scope.add_elements(content)
        for model in content.findall("model"):
            inner = f"{source.where}: model {model.get('name')!r}"
            inside = source._replace(where=inner)
            child = self.read(model, model.get("name") or "", inside, home="__model__")
            anchor = model.get("placement_frame") or ""
            self._place(found, child, model, anchor, merged=False)
        for include in content.findall("include"):
            self._read_include(found, include, source)
        for population in content.findall("population"):
            self._report.unread.append(f"population {population.get('name')!r}")
        return found

    def _place(
        self, parent: Model, child: Model, posed: Element, anchor: str, *, merged: bool
    ) -> None:
        """Put ``child`` where the pose of ``posed`` says: its own element, or its include."""
        frame, pose = frame_and_pose(posed, child.source.where)
        if posed is child.element and child.source.file != parent.source.file:
            frame = ""  # Of the file that the model stands in, not of the one that includes it.
        # Names may be given twice; each model then still has a place of its own.
        key = child.name
        while parent.scope.knows(key):
            key += "'"
        child.key = key
        parent.scope.add(key, frame, pose, anchor)
        parent.scope.add_model(key, child.scope, merged=merged)
        parent.models.append(child)

    def _read_include(self, parent: Model, include: Element, source: Source) -> None:
        uri = " ".join((include.findtext("uri") or "").split())
        where = f"{source.where}: include {uri[:200]!r}"
        if source.depth >= MAX_INCLUDE_DEPTH:
            raise InputError(f"{where}: more than {MAX_INCLUDE_DEPTH} files include each other")
        found = self._folders.find(uri, source.file, where)
        if found is None:
            if not is_no_obstacle(uri):
                self._report.missing.append(f"include {uri[:200]!r}")
            return
        try:
            root = self._folders.parsed(found)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        model = root.find("model")
        if model is None:
            if root.find("light") is None:
                self._report.unread.append(f"include {uri[:200]!r}: no model in it")
            return
        name = (include.findtext("name") or model.get("name") or "").strip()
        inner = Source(where, found, version_of(root), source.depth + 1)
        child = self.read(model, name, inner, home="__model__")
        child.is_static = child.is_static or is_true(include.findtext("static"))
        anchor = (include.findtext("placement_frame") or "").strip()
        anchor = anchor or model.get("placement_frame") or ""
        posed = model if include.find("pose") is None else include
        self._place(parent, child, posed, anchor, merged=is_true(include.get("merge")))
