# SPDX-License-Identifier: Apache-2.0
"""Expand one xacro file in a process of its own, started by ``expansion``.

A xacro file holds expressions in Python, and a stranger wrote it: names that lead out of xacro's
own world are refused, and memory is limited. This file needs xacro and the standard library alone.
"""

from __future__ import annotations

import ast
import contextlib
import json
import sys
from typing import Any

MAX_MEMORY = 4 << 30
"""[bytes]"""
FRAMES = ("_", "gi_", "f_", "tb_", "cr_", "ag_", "co_", "func_")
"""Attributes that begin so lead to the interpreter's insides."""
NAMES = ("format", "format_map", "mro", "vars", "type")
TOO_OLD = "this xacro cannot be held back; get a newer one (pip install -U xacro)"


def check(expression: str) -> None:
    """Refuse an expression that could get at more than its file's own figures.

    Raises:
        ValueError: a name in it is not allowed.
    """
    for node in ast.walk(ast.parse(expression.strip(), mode="eval")):
        name = getattr(node, "attr", None) or getattr(node, "id", "")
        if name.startswith("__") or name in NAMES or _is_inside(node):
            raise ValueError(f"{name!r} is not allowed in an expression")


def _is_inside(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and node.attr.startswith(FRAMES)


def expand(path: str, mappings: dict[str, str], packages: dict[str, str]) -> str:
    """Return the file with its macros expanded."""
    import xacro
    from xacro import substitution_args

    def find(name: str) -> str:
        if name not in packages:
            raise ValueError(f"package {name!r}: not found; give --packages DIR")
        return packages[name]

    def checked(original: Any) -> Any:
        def evaluate(expression: str, *rest: Any) -> Any:
            check(expression)
            return original(expression, *rest)

        return evaluate

    try:
        xacro.safe_eval = checked(xacro.safe_eval)
        substitution_args._eval = checked(substitution_args._eval)
        substitution_args._eval_dict["find"] = find
    except AttributeError as error:
        raise ValueError(TOO_OLD) from error
    substitution_args._eval_find = find
    document: Any = xacro.process_file(path, mappings=mappings)
    return document.toxml()


def main() -> None:
    """Read a request from standard input, and write the answer to standard output."""
    # The first place to import from is this file's folder.
    sys.path.pop(0)
    request = json.load(sys.stdin)
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    output, sys.stdout = sys.stdout, sys.stderr
    try:
        answer = {"text": expand(**request)}
    except ModuleNotFoundError as error:
        answer = {"missing": str(error.name)}
    # xacro raises whatever an expression raises.
    except Exception as error:
        answer = {"error": str(error) or type(error).__name__}
    json.dump(answer, output)


if __name__ == "__main__":
    main()
