# SPDX-License-Identifier: Apache-2.0
"""Line charts as inline SVG; colours are the page's CSS variables, text stays text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WIDTH, HEIGHT = 360, 226
LEFT, RIGHT, TOP, BOTTOM = 38, 10, 10, 38
"""Space around the plot for ticks and labels."""
COLORS = 10
"""Lines beyond so many begin anew with another dash."""
DASHES = ("", "6 3", "2 3")
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
CURVE_POINTS = 100
"""Steps that an empirical distribution is drawn with at most."""


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

    def at(self) -> Sequence[float]:
        """Return where the ticks are."""
        return self.ticks or nice_ticks(self.low, self.high)


def line_chart(lines: Sequence[Line], x: Axis, y: Axis, description: str) -> Markup:
    """Return an SVG element."""
    body = [_grid(x, y)]
    body += [_band(line, x, y) for line in lines if line.band is not None]
    body += [_line(line, x, y) for line in lines]
    return Markup(
        '<svg class="chart" viewBox="0 0 {} {}" role="img" aria-label="{}">{}</svg>'
    ).format(WIDTH, HEIGHT, description, Markup("").join(body))


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


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Return about ``count`` round numbers from ``low`` to ``high``."""
    if not high > low:
        return [low]
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s for s in STEPS if s * power >= rough * 0.999) * power
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def line_style(entry: int) -> str:
    """Return the CSS of an entry's lines."""
    dash = DASHES[entry // COLORS % len(DASHES)]
    return f"--c:var(--e{entry % COLORS})" + (f";stroke-dasharray:{dash}" if dash else "")


def _grid(x: Axis, y: Axis) -> Markup:
    """Draw grid lines, numbers and labels of both axes."""
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    parts = []
    for value in y.at():
        row = _row(y, value)
        parts.append(f'<path class="grid" d="M{LEFT} {row:.1f}H{right}"/>')
        parts.append(
            f'<text x="{LEFT - 6}" y="{row + 3.5:.1f}" text-anchor="end">{value:.6g}</text>'
        )
    for value in x.at():
        column = _column(x, value)
        parts.append(f'<path class="tick" d="M{column:.1f} {bottom}v4"/>')
        parts.append(
            f'<text x="{column:.1f}" y="{bottom + 16}" text-anchor="middle">{value:.6g}</text>'
        )
    parts.append(f'<path class="axis" d="M{LEFT} {bottom}H{right}"/>')
    middle = (LEFT + right) / 2
    label = Markup('<text class="label" x="{}" y="{}" text-anchor="middle">{}</text>')
    # The numbers above are ours; labels come from results.
    return Markup("".join(parts)) + label.format(middle, HEIGHT - 5, x.label)  # noqa: S704


def _line(line: Line, x: Axis, y: Axis) -> Markup:
    columns, rows = _points(line.x, line.y, x, y)
    points = list(zip(columns, rows, strict=True))
    if not points:
        return Markup("")
    if line.stairs:
        path = f"M{_column(x, x.low):.1f} {_row(y, y.low):.1f}"
        path += "".join(f"H{column:.1f}V{row:.1f}" for column, row in points)
        path += f"H{_column(x, x.high):.1f}"
    else:
        path = "M" + "L".join(f"{column:.1f} {row:.1f}" for column, row in points)
    hints = line.hints or [""] * len(points)
    dots = Markup("").join(
        Markup('<circle cx="{}" cy="{}" r="3"><title>{}</title></circle>').format(
            f"{column:.1f}", f"{row:.1f}", hint
        )
        for (column, row), hint in zip(points, hints, strict=True)
        if not line.stairs
    )
    title = Markup("<title>{}</title>").format(line.name)
    return Markup('<g class="line" data-entry="{}" style="{}"><path d="{}">{}</path>{}</g>').format(
        line.entry, line_style(line.entry), path, title, dots
    )


def _band(line: Line, x: Axis, y: Axis) -> Markup:
    assert line.band is not None
    columns, low = _points(line.x, line.band[0], x, y)
    _, high = _points(line.x, line.band[1], x, y)
    there = [f"{column:.1f} {row:.1f}" for column, row in zip(columns, low, strict=True)]
    back = [f"{column:.1f} {row:.1f}" for column, row in zip(columns, high, strict=True)]
    path = "M" + "L".join(there + back[::-1]) + "Z"
    return Markup('<path class="band" data-entry="{}" style="{}" d="{}"/>').format(
        line.entry, f"--c:var(--e{line.entry % COLORS})", path
    )


def _points(
    values_x: FloatArray, values_y: FloatArray, x: Axis, y: Axis
) -> tuple[list[float], list[float]]:
    columns = [_column(x, value) for value in np.clip(values_x, x.low, x.high).tolist()]
    return columns, [_row(y, value) for value in np.clip(values_y, y.low, y.high).tolist()]


def _column(axis: Axis, value: float) -> float:
    part = (value - axis.low) / ((axis.high - axis.low) or 1.0)
    return LEFT + part * (WIDTH - LEFT - RIGHT)


def _row(axis: Axis, value: float) -> float:
    part = (value - axis.low) / ((axis.high - axis.low) or 1.0)
    return HEIGHT - BOTTOM - part * (HEIGHT - TOP - BOTTOM)
