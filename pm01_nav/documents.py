# SPDX-License-Identifier: Apache-2.0
"""Read YAML, XML and JSON that strangers wrote: within limits, and with one kind of error."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import yaml
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import ParseError, fromstring

from pm01_nav.errors import InputError

MAX_BYTES = 64_000_000
"""Larger files are refused unread; 200 000 discs take 13 MB of YAML."""
MAX_EVENTS = 2_000_000
"""Values and brackets of a YAML file; 200 000 segments take 1.2 million."""
MAX_DEPTH = 64
"""Brackets or elements within each other; deeper ones overflow the parsers' stacks."""
PREFACE = 4_000
"""Characters in which an XML file's first tag is sought."""
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_FIRST_TAG = re.compile(r"^\s*<[A-Za-z!?]|<\?xml|<sdf", re.MULTILINE)
_DECLARATION = re.compile(r"^\s*<\?xml\b[^>]*\?>")
_BARE_AMPERSAND = re.compile(r"&(?!#?\w+;)")
_DOUBLE_COLON = re.compile(r"(</?[\w.-]+)::(?=\w)")
_TAG = re.compile(r"<[^<>!?]*>")
_PREFIX = re.compile(r"(?:^</?|\s)([A-Za-z_][\w.-]*):(?=[\w])[^\s=/>]*(?=[\s=/>])")
_XMLNS = re.compile(r"\sxmlns:([\w.-]+)\s*=")
_ROOT = re.compile(r"<[A-Za-z_][^\s/>]*")
# The C parser is ten times faster. Not every PyYAML has it.
_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """Refuse a key that stands twice, of which the safe loader drops the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        _refuse_twice(keys)
        return super().construct_mapping(node, deep)


def _refuse_twice(keys: list[str]) -> None:
    seen: set[str] = set()
    for key in keys:
        if key in seen:
            raise ValueError(f"the key {key[:80]!r} stands twice")
        seen.add(key)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    _refuse_twice([key for key, _ in pairs])
    return dict(pairs)


def read_text(path: Path) -> str:
    """Read a whole text file.

    Raises:
        InputError: it cannot be read, is too large, or is not UTF-8.
    """
    try:
        # A text's line ends are \n on every system, as Python's own reading has them.
        text = read_bytes(path).decode("utf-8-sig")
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: must be UTF-8 text") from error


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        InputError: it cannot be read, is no file, or is too large.
    """
    try:
        # Devices and pipes have no size and perhaps no end.
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: must be a file")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path}: has {size} bytes; at most {MAX_BYTES} are allowed")
        return path.read_bytes()
    except InputError:
        raise
    # A ValueError is a null byte in the name.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read: {reason}") from error


def load_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML mapping without aliases.

    Raises:
        InputError: the file cannot be read, is no YAML, holds no mapping, or has aliases.
    """
    path = Path(path)
    text = read_text(path)
    try:
        _check_events(text, path)
        data = yaml.load(text, Loader=_Loader)  # noqa: S506 - it is a safe loader.
    except InputError:
        raise
    # Beside its own errors PyYAML lets through those of impossible dates, numbers and keys.
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"{path}: is not valid YAML: {_one_line(error)}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: must be a YAML mapping (key: value), not {type(data).__name__}")
    return data


def _check_events(text: str, path: Path) -> None:
    """Refuse what would overflow the stack, or expand to any amount of memory, when loaded."""
    depth = 0
    for count, event in enumerate(yaml.parse(text, Loader=_Loader)):
        if count > MAX_EVENTS:
            raise InputError(f"{path}: holds more than {MAX_EVENTS} values")
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{path}: must not use YAML aliases (*{event.anchor})")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            raise InputError(f"{path}: is nested more than {MAX_DEPTH} deep")


def parse_xml(path: Path) -> Element:
    """Read an XML file without a document type and return its root.

    Raises:
        InputError: the file cannot be read, is no whole XML, has a DOCTYPE, or is too deep.
    """
    return parse_xml_text(read_text(path), path)


def parse_xml_text(text: str, path: Path) -> Element:
    """Read XML that came from ``path`` and return its root.

    Raises:
        InputError: it is no whole XML, has a DOCTYPE, or is too deep.
    """
    try:
        root = _parsed(text, path)
    except ParseError:
        try:
            root = _parsed(_tolerant(text), path)
        except ParseError as error:
            raise InputError(f"{path}: is not a whole XML file: {_one_line(error)}") from error
    _check_depth(root, path)
    return root


def _parsed(text: str, path: Path) -> Element:
    # A document type can define entities that expand to gigabytes; no world needs one.
    # Being text, the file can declare no other encoding.
    try:
        return fromstring(text, forbid_dtd=True)
    except DefusedXmlException as error:
        raise InputError(f"{path}: must not hold a DOCTYPE") from error
    except ValueError as error:
        raise InputError(f"{path}: is not a whole XML file: {_one_line(error)}") from error


def looks_like_xml(text: str) -> bool:
    """Tell whether the start of a text holds a tag where YAML would hold none."""
    return _FIRST_TAG.search(text) is not None


def _tolerant(text: str) -> str:
    """Mend what Gazebo and ROS take no notice of, without moving a line.

    That is text before the first tag, "--" in comments, a bare "&", "::" in the names of tags,
    and prefixes that nothing declares. Entities by name stay what they are: errors.
    """
    text = _COMMENT.sub(_blank, text)
    begin = max(text.find("<"), 0)
    text = _BARE_AMPERSAND.sub("&amp;", _blank_text(text[:begin]) + text[begin:])
    text = _DECLARATION.sub(_blank, text, count=1)
    text = _DOUBLE_COLON.sub(r"\1__", text)
    prefixes = {name for tag in _TAG.findall(text) for name in _PREFIX.findall(tag)}
    unknown = sorted(prefixes - {"xml", "xmlns"} - set(_XMLNS.findall(text)))
    declared = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in unknown)
    return _ROOT.sub(lambda root: root[0] + declared, text, count=1) if declared else text


def _blank(part: re.Match[str]) -> str:
    return _blank_text(part[0])


def _blank_text(text: str) -> str:
    return "\n" * text.count("\n")


def _check_depth(root: Element, path: Path) -> None:
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"{path}: is nested more than {MAX_DEPTH} deep")
        level = [child for element in level for child in element]


def load_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises:
        InputError: the file cannot be read, is no JSON, or holds no object.
    """
    text = read_text(path)
    try:
        data = json.loads(text, object_pairs_hook=_unique)
    # Deep brackets end in a RecursionError; a number of thousands of digits is a ValueError.
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not valid JSON: {_one_line(error)}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: must be a JSON object, not {type(data).__name__}")
    return data


def _one_line(error: BaseException) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:200]
