# SPDX-License-Identifier: Apache-2.0
"""The ``<state>`` of a saved world, which moves models and links after they are loaded."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.worlds.sdf_pose import Transform, positive, read_pose

UNIT = np.ones(3)


@dataclass(frozen=True)
class ModelState:
    """Where a model and its links were when the world was saved, in the world's frame."""

    pose: Transform
    scale: NDArray[np.float64]
    """Of its links' shapes, shape (3,)."""
    links: dict[str, Transform]
    models: dict[str, ModelState]


@dataclass(frozen=True)
class WorldState:
    """A state as Gazebo classic applies it; models that it does not name stay where they are."""

    models: dict[str, ModelState] = field(default_factory=dict)
    insertions: tuple[Element, ...] = ()
    """Each holds models that were added."""
    deletions: frozenset[str] = frozenset()
    """Names of models that were removed."""


def read_state(world: Element, where: str) -> WorldState:
    """Read the first ``<state>`` of a world, the only one that Gazebo looks at.

    Raises:
        InputError: a pose or a scale is wrong.
    """
    state = world.find("state")
    if state is None:
        return WorldState()
    names = (name.text or "" for name in state.iterfind("deletions/name"))
    return WorldState(
        _read_models(state, f"{where}: state"),
        tuple(state.findall("insertions")),
        frozenset(name.strip() for name in names),
    )


def _read_models(parent: Element, where: str) -> dict[str, ModelState]:
    models = {}
    for model in parent.findall("model"):
        name = model.get("name") or ""
        # Of two with the same name Gazebo keeps the first.
        if name in models:
            continue
        inner = f"{where}: model {name!r}"
        scale = model.find("scale")
        models[name] = ModelState(
            read_pose(model, inner, "world"),
            UNIT if scale is None else np.array(positive(scale, 3, f"{inner}: scale")),
            {
                link.get("name") or "": read_pose(link, f"{inner}: link", "world")
                for link in model.findall("link")
                if link.find("pose") is not None
            },
            _read_models(model, inner),
        )
    return models
