# SPDX-License-Identifier: Apache-2.0
"""Files that would crash, stop or fill the machine are refused before they are loaded."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pm01_nav import documents
from pm01_nav.documents import load_json, load_yaml, parse_xml
from pm01_nav.errors import InputError

LOADERS = (load_yaml, load_json, parse_xml)


def refused(load: Callable[[Path], Any], path: Path, words: str) -> None:
    with pytest.raises(InputError, match=words) as problem:
        load(path)
    assert str(path) in str(problem.value)
    assert "\n" not in str(problem.value)


def write(folder: Path, text: str) -> Path:
    path = folder / "file"
    path.write_text(text)
    return path


def test_loads(tmp_path: Path) -> None:
    assert load_yaml(write(tmp_path, "\ufeffa: [1, x]")) == {"a": [1, "x"]}
    assert load_json(write(tmp_path, '{"a": [1, "x"]}')) == {"a": [1, "x"]}
    assert parse_xml(write(tmp_path, "<a b='c'/>")).get("b") == "c"


@pytest.mark.parametrize("load", LOADERS)
def test_what_is_no_text_file(
    tmp_path: Path, load: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    refused(load, tmp_path / "nowhere", "cannot be read")
    refused(load, tmp_path, "must be a file")
    refused(load, Path("/dev/zero"), "must be a file")
    os.mkfifo(tmp_path / "pipe")
    refused(load, tmp_path / "pipe", "must be a file")
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00a")
    refused(load, tmp_path / "bytes", "must be UTF-8 text")
    monkeypatch.setattr(documents, "MAX_BYTES", 10)
    refused(load, write(tmp_path, "x" * 11), "has 11 bytes; at most 10 are allowed")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        # The C parser overflows its stack on this and takes the process with it.
        ("[" * 200_000, "nested more than 64 deep"),
        # Each line doubles the one before: 2^40 entries.
        (
            "a0: &a0 {k: v}\n"
            + "".join(f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 41)),
            "aliases",
        ),
        ("a: {b: 1, b: 2}", "the key 'b' stands twice"),
        ("a: !!python/object/apply:os.getcwd []", "is not valid YAML"),
        ("a: 2001-99-99", "is not valid YAML"),
        ("? [a]\n: b", "is not valid YAML"),
        ("- a", "must be a YAML mapping .*, not list"),
        ("a: [", "is not valid YAML"),
    ],
)
def test_yaml_refused(tmp_path: Path, text: str, words: str) -> None:
    refused(load_yaml, write(tmp_path, text), words)


def test_yaml_with_too_many_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documents, "MAX_EVENTS", 20)
    assert load_yaml(write(tmp_path, "a: [1, 2, 3]")) == {"a": [1, 2, 3]}
    refused(load_yaml, write(tmp_path, f"a: {list(range(30))}"), "holds more than 20 values")


def test_xml_refused(tmp_path: Path) -> None:
    refused(parse_xml, write(tmp_path, "<a>" * 65 + "</a>" * 65), "nested more than 64 deep")
    refused(parse_xml, write(tmp_path, "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"), "DOCTYPE")
    refused(parse_xml, write(tmp_path, "<a><b></a>"), "is not a whole XML file")
    deep = write(tmp_path, "<a>" * 200_000 + "</a>" * 200_000)
    refused(parse_xml, deep, "nested more than 64 deep")


@pytest.mark.parametrize(
    "text",
    [
        "\n\n<?xml version='1.0'?><a b='c'/>",
        "made by hand <?xml version='1.0'?>\n<a b='c'/>",
        "?xml version='1.0'?>\n<a b='c'/>",
        "<!-- by a script -->\n<?xml version='1.0'?><a b='c'/>",
        "<!-- <?xml version='1.0'?> --> <?xml version='1.0'?><!-- a -- b --><a b='c'/>",
        "<?xml version='1.0' encoding='latin-1'?> <!-- -- -- --><a b='c'/>",
        "<a b='c'><x:y z:w='1'/><x:y/>tables & chairs</a>",
        "<a b='c'><gz::priority>1</gz::priority></a>",
        "<a xmlns:x='urn:x' b='c'><x:y/><z:y/></a>",
    ],
)
def test_xml_that_gazebo_and_ros_take(tmp_path: Path, text: str) -> None:
    assert parse_xml(write(tmp_path, text)).get("b") == "c"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        # Entities, also behind what is mended.
        ("words <!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "DOCTYPE"),
        ("<!-- -- --><!DOCTYPE a SYSTEM 'file:///etc/passwd'><a/>", "DOCTYPE"),
        ("\n<?xml version='1.0'?><!DOCTYPE a><a/>", "DOCTYPE"),
        ("<a>&b;</a>", "undefined entity"),
        ("<!-- <a/>", "is not a whole XML file"),
        ("words alone", "is not a whole XML file"),
        ("<a/><?xml version='1.0'?>", "is not a whole XML file"),
    ],
)
def test_xml_that_stays_refused(tmp_path: Path, text: str, words: str) -> None:
    refused(parse_xml, write(tmp_path, text), words)


def test_lines_of_mended_xml_are_those_of_the_file(tmp_path: Path) -> None:
    text = "\n<!-- -- \n -->\n<?xml version='1.0'?>\n<a>\n<b></a>"
    refused(parse_xml, write(tmp_path, text), "mismatched tag: line 6")
