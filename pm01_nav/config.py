# SPDX-License-Identifier: Apache-2.0
"""Check plain data against typed models, and write it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from pm01_nav.errors import InputError

Model = TypeVar("Model", bound=BaseModel)


class FrozenModel(BaseModel):
    """Base of every configuration: immutable, no unknown keys, no NaN or infinity."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True
    )

    @classmethod
    def keys(cls) -> dict[str, Any]:
        """Return what may be given, and the type of each."""
        return {name: field.annotation for name, field in cls.model_fields.items()}


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write a file under a temporary name and rename it, so that no reader sees half of it."""
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    if isinstance(content, str):
        content = content.encode("utf-8")
    temporary.write_bytes(content)
    temporary.replace(path)


def make_folder(path: str | Path, option: str = "out") -> None:
    """Make a folder to write into, and those above it; ``option`` is what named it.

    Raises:
        InputError: a file is in the way, or this user may not write there.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (
            "exists and is not a folder" if path.is_file() else f"cannot be made: {error.strerror}"
        )
        raise InputError(f"{option} = {path}: {reason}") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise InputError(f"{option} = {path}: cannot be written to")


def check_output(path: str | Path, option: str = "output") -> None:
    """Make sure that a file can be written, before there is anything to lose.

    Raises:
        InputError: its folder is missing or closed to this user, or a folder has its name.
    """
    path = Path(path)
    folder = path.resolve().parent
    if not folder.is_dir():
        raise InputError(f"{option} = {path}: its folder does not exist")
    if path.is_dir():
        raise InputError(f"{option} = {path}: is a folder; give the name of a file")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{option} = {path}: its folder cannot be written to")


class _Dumper(yaml.SafeDumper):
    """Write what stands twice twice: ``documents.load_yaml`` refuses aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def to_yaml(data: Mapping[str, Any]) -> str:
    """Format plain data as YAML without aliases, keys in the given order."""
    return yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def validate(
    model: type[Model], data: Mapping[str, Any], source: str, *, inside: str = ""
) -> Model:
    """Build ``model`` from plain data, which stood at the key ``inside`` of ``source``.

    Raises:
        InputError: one line that names the source, the key, the value and what is allowed.
    """
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise InputError(f"{source}: {_first_problem(model, error, inside)}") from error


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Lay ``changes`` over ``base``, mapping by mapping; neither argument is altered."""
    merged = dict(base)
    for key, value in changes.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = merge(merged[key], value)
        else:
            merged[key] = value
    return merged


def _first_problem(model: type[BaseModel], error: ValidationError, inside: str) -> str:
    """Say in one line what is wrong with the first value that failed."""
    problem = error.errors(include_url=False)[0]
    parts = [inside, *(str(part) for part in problem["loc"])]
    key = ".".join(part for part in parts if part) or "the whole"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"{key}: unknown key; allowed here: {_siblings(model, problem['loc'])}"
    if problem["type"] == "missing":
        return f"{key}: is missing"
    others = error.error_count() - 1
    more = f" (and {others} more)" if others else ""
    # Where values of a section do not go together the message names them; it has a hundred more.
    whole = problem["type"] == "value_error" and isinstance(problem["input"], Mapping)
    value = "" if whole else f" = {problem['input']!r}"
    return f"{key}{value}: {message[:1].lower()}{message[1:]}{more}"


def _siblings(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """Name the keys that are allowed beside the one at ``location``."""
    annotation: Any = model
    for part in location[:-1]:
        if _is_model(annotation):
            annotation = annotation.keys()[str(part)]
        elif get_origin(annotation) is dict:
            annotation = get_args(annotation)[1]
    if not _is_model(annotation):
        return "see the documentation"
    return ", ".join(annotation.keys()) or "none"


def _is_model(annotation: Any) -> bool:
    # On Python 3.10 dict[str, float] is an instance of type, too.
    is_class = isinstance(annotation, type) and get_origin(annotation) is None
    return is_class and issubclass(annotation, FrozenModel)
