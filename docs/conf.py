# SPDX-License-Identifier: Apache-2.0
"""The documentation site, built by `make docs`.

The source folder is the repository's root, so that a relative link means the same on the site and
on the repository's web page.
"""

from sphinx.application import Sphinx

import pm01_nav

# Autodoc imports with TYPE_CHECKING set, and pydantic fails to build this model then.
import pm01_nav.training.config

project = "PM01 Navigation"
author = "The PM01 Navigation authors"
version = release = pm01_nav.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "README"
include_patterns = [
    "README.md", "README.zh-CN.md", "CONTRIBUTING.md", "CHANGELOG.md",
    "docs/**", "benchmarks/results/*.md",
]  # fmt: skip
exclude_patterns = ["docs/site/**"]

myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"

html_theme = "furo"
html_title = project
html_extra_path = ["site"]
html_show_sourcelink = False

NAVIGATION = {
    "Start": ["docs/guide/install", "docs/guide/train", "docs/guide/evaluate", "docs/guide/deploy"],
    "Guide": [
        f"docs/guide/{page}"
        for page in (
            "worlds", "robot", "randomization", "scale", "backends", "gazebo", "benchmark", "zoo",
        )
    ] + ["docs/trainers/README", "docs/trainers/ppo", "docs/trainers/ppo_lstm",
         "docs/trainers/off_policy", "docs/troubleshooting"],
    "Reference": [
        "docs/api/index", "docs/observation", "docs/architecture",
        "docs/decisions/0001-numba-kernels-numpy-task",
        "docs/decisions/0002-counter-based-random-numbers",
        "docs/decisions/0003-nearness-instead-of-range",
        "docs/decisions/0004-one-source-for-cpu-and-gpu",
    ],
    "Measurements": [
        f"benchmarks/results/{page}" for page in ("README", "benchmark", "public_files", "tuning")
    ],
    "Project": ["README.zh-CN", "CONTRIBUTING", "CHANGELOG"],
}  # fmt: skip
"""The side bar. A page that is missing here is a warning, and `make docs` fails."""


def add_navigation(_app: Sphinx, name: str, text: list[str]) -> None:
    """Give the start page the side bar, which the repository's web page could not show."""
    if name != root_doc:
        return
    for caption, pages in NAVIGATION.items():
        listed = "\n".join(f"/{page}" for page in pages)
        text[0] += f"\n\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{listed}\n```\n"


def quote_tables(_app: Sphinx, _what: str, _name: str, _of: object, *rest: object) -> None:
    """Show docstrings' Markdown tables as they are written: autodoc reads reStructuredText."""
    lines: list[str] = rest[-1]  # type: ignore[assignment]
    quoted: list[str] = []
    in_table = False
    for line in lines:
        is_row = line.lstrip().startswith("|")
        if is_row and not in_table:
            quoted += ["", "::", ""]
        if in_table and not is_row:
            quoted.append("")
        quoted.append(f"    {line}" if is_row else line)
        in_table = is_row
    # A bare bar would begin a substitution; docstrings write |x| for an absolute value.
    lines[:] = [line if line.startswith("    ") else line.replace("|", "\\|") for line in quoted]


def setup(app: Sphinx) -> None:
    """Add the two hooks."""
    app.connect("source-read", add_navigation)
    app.connect("autodoc-process-docstring", quote_tables)
