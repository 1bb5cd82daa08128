# SPDX-License-Identifier: Apache-2.0
"""Line charts as inline SVG by matplotlib, in the colours of the page, its text as text."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree  # defusedxml writes nothing

import numpy as np
from defusedxml.ElementTree import fromstring
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WIDTH, HEIGHT = 360, 226
"""[pt], a unit of the picture each."""
COLORS = 10
"""Lines beyond so many begin anew with another dash."""
DASHES: tuple[tuple[float, ...], ...] = ((), (6.0, 3.0), (2.0, 3.0))
CURVE_POINTS = 100
"""Steps that an empirical distribution is drawn with at most."""
SVG = "http://www.w3.org/2000/svg"
INK, RULE, OWN, PAGE = "#010203", "#020304", "#030405", "#040506"
"""What matplotlib draws in, in place of the page's colours, which it cannot know."""
VARIABLES = {INK: "var(--soft)", RULE: "var(--line)", OWN: "var(--c)", PAGE: "var(--page)"}
LOOK: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 11,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 1.0,
    "axes.axisbelow": True,
    "axes.spines.left": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "ytick.left": False,
    "grid.color": RULE,
    "grid.linewidth": 1.0,
    "lines.linewidth": 1.8,
    "lines.solid_joinstyle": "round",
}


@dataclass(frozen=True)
class Line:
    """One entry's line."""

    entry: int
    """Its number, which decides colour and dash."""
    name: str
    x: FloatArray
    y: FloatArray
    band: tuple[FloatArray, FloatArray] | None = None
    """Lower and upper end of an interval at each point."""
    hints: Sequence[str] = ()
    """What each point says when it is pointed at."""
    stairs: bool = False
    """Whether y holds until the next x."""


@dataclass(frozen=True)
class Axis:
    """What an axis shows, and from where to where."""

    label: str
    low: float
    high: float
    ticks: Sequence[float] = ()
    """Where numbers stand; by default at round ones."""


def line_chart(lines: Sequence[Line], x: Axis, y: Axis, description: str) -> Markup:
    """Return an SVG element."""
    text = io.StringIO()
    # The salt makes the ids of all charts of the page different.
    look: dict[Any, Any] = LOOK | {"svg.hashsalt": f"{description} {[line.name for line in lines]}"}
    with rc_context(look):
        figure = Figure(figsize=(WIDTH / 72, HEIGHT / 72), layout="constrained")
        axes = figure.add_subplot()
        for line in lines:
            _draw(axes, line)
        axes.grid(axis="y")
        for axis, limits, shown in ((axes.xaxis, axes.set_xlim, x), (axes.yaxis, axes.set_ylim, y)):
            limits(shown.low, shown.high)
            if shown.ticks:
                axis.set_ticks(shown.ticks, [f"{tick:g}" for tick in shown.ticks])
        axes.set_xlabel(x.label)
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None})
    return _for_the_page(text.getvalue(), lines, description)


def _draw(axes: Axes, line: Line) -> None:
    if line.band is not None:
        axes.fill_between(
            line.x, *line.band, color=OWN, linewidth=0.0, gid=f"band-{line.entry}", clip_on=False
        )
    dashes = DASHES[line.entry // COLORS % len(DASHES)]
    shape: dict[str, Any] = (
        {"drawstyle": "steps-post"} if line.stairs else {"marker": "o", "markersize": 5.0}
    )
    values_x, values_y = line.x, line.y
    if line.stairs and len(line.x):
        # A distribution begins at nothing, and stays what it is to the right.
        values_x = np.concatenate([[-1e6], line.x, [1e6]])
        values_y = np.concatenate([[0.0], line.y, line.y[-1:]])
    [drawn] = axes.plot(
        values_x,
        values_y,
        color=OWN,
        markeredgecolor=PAGE,
        gid=f"line-{line.entry}",
        clip_on=line.stairs,
        zorder=3,
        **shape,
    )
    if dashes:
        drawn.set_dashes(dashes)


def _for_the_page(text: str, lines: Sequence[Line], description: str) -> Markup:
    """Return matplotlib's drawing with the page's colours, hints and marks for the legend."""
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")
    root = fromstring(text)
    for metadata in root.findall(f"{{{SVG}}}metadata"):
        root.remove(metadata)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.attrib |= {"class": "chart", "role": "img", "aria-label": description}
    by_number = {str(line.entry): line for line in lines}
    for group in root.iter(f"{{{SVG}}}g"):
        kind, _, number = group.attrib.pop("id", "").partition("-")
        if kind in ("line", "band"):
            mark = {"class": kind, "data-entry": number, "style": line_style(int(number))}
            group.attrib |= mark
            _hint(group, by_number[number] if kind == "line" else None)
    page = ElementTree.tostring(root, encoding="unicode")
    for color, variable in VARIABLES.items():
        page = page.replace(color, variable)
    # ElementTree has escaped all that comes from results.
    return Markup(page)  # noqa: S704


def _hint(group: ElementTree.Element, line: Line | None) -> None:
    """Say what a line is, and what each of its points is, to who points at it."""
    if line is None:
        return
    marks = group.findall(f".//{{{SVG}}}use")
    for mark, hint in zip(marks, line.hints, strict=False):
        ElementTree.SubElement(mark, f"{{{SVG}}}title").text = hint
    title = ElementTree.Element(f"{{{SVG}}}title")
    title.text = line.name
    group.insert(0, title)


def distribution(
    values: FloatArray, entry: int, name: str, total: int | None = None
) -> tuple[FloatArray, Line]:
    """Return the finite values, sorted, and the line that tells how many of all are below [%].

    ``total`` counts those as well that have no value, so that the line ends below 100 %.
    """
    finite = np.sort(values[np.isfinite(values)])
    share = 100.0 * np.arange(1, len(finite) + 1) / max(total or len(finite), 1)
    kept = np.unique(np.linspace(0, max(len(finite) - 1, 0), CURVE_POINTS).round().astype(int))
    kept = kept[: len(finite)]
    return finite, Line(entry, name, finite[kept], share[kept], stairs=True)


def line_style(entry: int) -> str:
    """Return the CSS of an entry's lines in legends and charts."""
    dash = " ".join(f"{length:g}" for length in DASHES[entry // COLORS % len(DASHES)])
    return f"--c:var(--e{entry % COLORS})" + (f";stroke-dasharray:{dash}" if dash else "")
