# SPDX-License-Identifier: Apache-2.0
"""Where the named frames of an SDF world or model are: links, joints, frames, nested models."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree.ElementTree import Element

from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_pose import IDENTITY, Transform, frame_and_pose

MAX_CHAIN = 100
"""Frames that are relative to each other in a row."""


class _Frame(NamedTuple):
    base: str
    """The frame that ``pose`` is in."""
    pose: Transform
    anchor: str
    """The frame of a nested model that ``pose`` places, in place of the model's own."""


class Scope:
    """The names that elements of one world or model may be relative to."""

    def __init__(self, home: str, where: str, *, lenient: bool) -> None:
        """Begin with ``home`` alone, ``world`` or ``__model__``.

        ``lenient`` takes unknown frames for ``home``, as did Gazebo before SDF 1.7.
        """
        self.home = home
        self.models: dict[str, Scope] = {}
        self.unknown: set[str] = set()
        """Names that nothing has, of a lenient scope."""
        self._where = where
        self._lenient = lenient
        self._frames: dict[str, _Frame] = {}
        self._merged: list[str] = []
        self._places: dict[str, Transform] = {home: IDENTITY, "": IDENTITY}

    def add(self, name: str, base: str, pose: Transform, anchor: str = "") -> None:
        """Add a frame; of two with the same name the first counts."""
        self._frames.setdefault(name, _Frame(base, pose, anchor))

    def add_model(self, name: str, scope: Scope, *, merged: bool) -> None:
        """Add a nested model's names, as ``name::...``, and if ``merged`` as they are."""
        self.models.setdefault(name, scope)
        if merged:
            self._merged.append(name)

    def add_elements(self, content: Element) -> None:
        """Add the links, frames and joints of a model, or the frames of a world.

        Raises:
            InputError: a pose is none.
        """
        for element in content.findall("link"):
            self._add_element(element, "")
        for element in content.findall("frame"):
            self._add_element(element, element.get("attached_to") or "")
        for element in content.findall("joint"):
            self._add_element(element, (element.findtext("child") or "").strip())

    def _add_element(self, element: Element, base: str) -> None:
        name = element.get("name") or ""
        frame, pose = frame_and_pose(element, f"{self._where}: {element.tag} {name!r}")
        self.add(name, frame or base, pose)

    def place(self, name: str, _chain: tuple[str, ...] = ()) -> Transform:
        """Return where a frame is in ``home``; the empty name is ``home``.

        Raises:
            InputError: there is no such frame, or it is relative to itself.
        """
        if name not in self._places:
            if name in _chain or len(_chain) > MAX_CHAIN:
                row = " -> ".join([*_chain[:3], name])
                raise InputError(f"{self._where}: frames must not be relative in a ring: {row}")
            self._places[name] = self._find(name, (*_chain, name))
        return self._places[name]

    def _find(self, name: str, chain: tuple[str, ...]) -> Transform:
        frame = self._frames.get(name)
        if frame is not None:
            place = self.place(frame.base, chain).apply(frame.pose)
            if not frame.anchor:
                return place
            return place.apply(self.models[name].place(frame.anchor).inverse())
        head, separator, rest = name.partition("::")
        if separator and head in self.models:
            return self.place(head, chain).apply(self.models[head].place(rest))
        for model in self._merged:
            if self.models[model].knows(name):
                return self.place(model, chain).apply(self.models[model].place(name))
        if not self._lenient:
            raise InputError(f"{self._where}: pose: relative_to = {name[:80]!r}: no such frame")
        self.unknown.add(name)
        return IDENTITY

    def knows(self, name: str) -> bool:
        """Tell whether a frame, other than ``home``, has this name."""
        head, separator, rest = name.partition("::")
        return (
            name in self._frames
            or bool(separator and head in self.models and self.models[head].knows(rest))
            or any(self.models[model].knows(name) for model in self._merged)
        )
