# SPDX-License-Identifier: Apache-2.0
"""Figures of merit as cells of a table: how many digits, which unit, what to sort by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

MINUS = "\N{MINUS SIGN}"
DASH = "\N{EN DASH}"


@dataclass(frozen=True)
class Figure:
    """A column of a table."""

    key: str
    """In ``tables.summary_of``."""
    label: str
    unit: str = ""
    digits: int = 2
    factor: float = 1.0
    optional: bool = True
    """Left out where no entry has it."""


FIGURES = (
    Figure("success_rate", "Success", "%", 1, 100.0, optional=False),
    Figure("collision_rate", "Collision", "%", 1, 100.0, optional=False),
    Figure("timeout_rate", "Timeout", "%", 1, 100.0, optional=False),
    Figure("failure_rate", "Failure", "%", 1, 100.0),
    Figure("spl", "SPL", "", 3),
    Figure("time_to_goal_s", "Time to\N{NO-BREAK SPACE}goal", "s", 1),
    Figure("path_length_m", "Path length", "m", 2),
    Figure("min_clearance_m", "Min. clearance", "m", 2),
    Figure("mean_jerk", "Mean jerk", "m/s³", 2),
    Figure("turn_reversals_per_min", "Turn reversals", "1/min", 1),
    Figure("personal_space_intrusion", "Close to\N{NO-BREAK SPACE}people", "% of steps", 1, 100.0),
    Figure("personal_space_time_s", "Close to\N{NO-BREAK SPACE}people", "s an episode", 1),
    Figure("compute_ms_median", "Compute median", "ms", 2),
    Figure("compute_ms_p99", "Compute p99", "ms", 2),
    Figure("barn_score_2024", "BARN 2024", "of 0.5", 3),
    Figure("barn_score_2022", "BARN 2022", "of 0.25", 3),
    Figure("dynabarn_score_as_published", "DynaBARN as\N{NO-BREAK SPACE}published", "of 0.125", 3),
)


@dataclass(frozen=True)
class Cell:
    """A number as it is printed, and as it is sorted."""

    text: str
    value: float | None = None
    interval: str = ""


def columns_of(summaries: list[dict[str, Any]]) -> list[Figure]:
    """Return the figures that at least one of the summaries has."""
    return [
        figure
        for figure in FIGURES
        if not figure.optional or any(s.get(figure.key) is not None for s in summaries)
    ]


def cell(summary: dict[str, Any], figure: Figure) -> Cell:
    """Return a figure of one summary."""
    value = summary.get(figure.key)
    if value is None:
        # Only an entry that failed has a rate of failures.
        return Cell("0.0", 0.0) if figure.key == "failure_rate" else Cell(DASH)
    interval = summary.get(f"{figure.key}_ci95")
    scaled = figure.factor * value
    return Cell(number(scaled, figure.digits), scaled, span(interval, figure.digits, figure.factor))


def number(value: float, digits: int, sign: bool = False) -> str:
    """Return a number with a true minus sign; no -0.0."""
    # Rounding may leave a hair below zero; zero added makes it plain zero.
    text = f"{round(value, digits) + 0.0:{'+' if sign else ''},.{digits}f}"
    text = text.replace("+0.", "0.") if float(text.replace(",", "")) == 0.0 else text
    return text.replace("-", MINUS).replace(",", "\N{NARROW NO-BREAK SPACE}")


def span(
    interval: list[float] | tuple[float, float] | None,
    digits: int,
    factor: float = 1.0,
    sign: bool = False,
) -> str:
    """Return an interval as text, empty where there is none."""
    if interval is None:
        return ""
    low, high = (number(factor * end, digits, sign) for end in interval)
    return f"{low} to {high}" if sign else f"{low}{DASH}{high}"
