# SPDX-License-Identifier: Apache-2.0
"""How a training run went, as one picture."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

History = Mapping[str, Sequence[float]]

INK = "#3a4456"
TRAINING, HELD_OUT = "#2f80ed", "#7c5cd6"
ENDINGS = {
    "success_rate": ("goal reached", "#22a06b"),
    "collision_rate": ("collision", "#d6383e"),
    "timeout_rate": ("time out", "#848d9c"),
}
MEANINGS = {"goal": "#22a06b", "success": "#22a06b", "collision": "#d6383e", "timeout": "#848d9c"}
"""Reward terms whose colour says what they are; the others share ``TERMS``."""
TERMS = ("#2f80ed", "#f28026", "#7c5cd6", "#00a0b0", "#c9508f", "#9a7d0a")
DASHES = ("-", "--", ":")
"""Terms beyond the colours begin anew with another line."""
REWARD = "reward/"
SHARE = "reward_share/"
CURRICULUM = "curriculum/"
EFFECTIVE_WORLDS = f"{CURRICULUM}effective_worlds"
FEW_POINTS = 30
"""Up to so many points each has a mark, so that a single one is seen."""
STYLE: Any = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#b4bcc8",
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e9ecf1",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9,
}


def plot_training(history: History, path: str | Path, title: str) -> None:
    """Draw the history of a training run, of any length, into a PNG.

    ``history`` holds one number per iteration under "seconds", "steps", "return", the rates of
    the endings and "reward/<term>", and one per evaluation under the keys "eval_...". Keys
    "curriculum/<metric>" get a panel of their own.

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError("a plot needs: pip install 'pm01-nav[viz]'") from error
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    with mpl.rc_context(STYLE):
        plots = [_plot_success, _plot_endings, _plot_terms]
        heights = [1.25, 1.0, 1.25]
        for prefix, plot in ((SHARE, _plot_shares), (CURRICULUM, _plot_curriculum)):
            if any(key.startswith(prefix) for key in history):
                plots.append(plot)
                heights.append(0.8)
        size = (9.0, 9.6 / 3.5 * sum(heights))
        figure = Figure(figsize=size, dpi=120, layout="constrained")
        figure.get_layout_engine().set(w_pad=0.12, h_pad=0.1)  # type: ignore[union-attr,call-arg]
        panels = figure.subplots(len(heights), 1, height_ratios=heights)
        figure.suptitle(title, x=0.02, ha="left", fontsize=13, fontweight="bold")
        for axes, plot in zip(panels, plots, strict=True):
            plot(axes, history)
            _share_time(axes, history)
        panels[-1].set_xlabel("training time [s]")
        _add_steps(panels[0], history)
        try:
            figure.savefig(partial, format="png")
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)


def _values(history: History, key: str) -> NDArray[np.float64]:
    return np.asarray(history.get(key, ()), dtype=np.float64)


def _line(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], **style: object) -> None:
    """Draw a line that stays visible when it has a single point."""
    marker = "o" if len(x) <= FEW_POINTS else None
    usual: dict[str, Any] = {"linewidth": 1.8, "marker": marker, "markersize": 3.5}
    axes.plot(x, y, **{**usual, **style})


def _plot_success(axes: Axes, history: History) -> None:
    axes.set_title("Success")
    axes.set_ylabel("episodes that reach the goal [%]")
    seconds, rate = _values(history, "seconds"), 100.0 * _values(history, "success_rate")
    if len(seconds):
        _line(axes, seconds, rate, color=TRAINING, label=_with_last("training worlds", rate))
    seconds, rate = _values(history, "eval_seconds"), 100.0 * _values(history, "eval_success_rate")
    if len(seconds):
        low = 100.0 * _values(history, "eval_success_low")
        high = 100.0 * _values(history, "eval_success_high")
        if len(low) == len(high) == len(seconds):
            style = {"color": HELD_OUT, "capsize": 3.0, "elinewidth": 1.2}
            axes.errorbar(seconds, rate, (rate - low, high - rate), fmt="none", **style)
            axes.fill_between(seconds, low, high, color=HELD_OUT, alpha=0.14, linewidth=0.0)
        label = _with_last("held-out worlds\n(95 % interval)", rate)
        _line(axes, seconds, rate, color=HELD_OUT, marker="o", markersize=5.0, label=label)
    _percent(axes)
    _legend(axes)


def _plot_endings(axes: Axes, history: History) -> None:
    axes.set_title("How training episodes end")
    axes.set_ylabel("episodes [%]")
    seconds = _values(history, "seconds")
    for key, (name, color) in ENDINGS.items():
        rate = 100.0 * _values(history, key)
        if len(rate):
            _line(axes, seconds, rate, color=color, label=_with_last(name, rate))
    _percent(axes)
    _legend(axes)


def _plot_terms(axes: Axes, history: History) -> None:
    axes.set_title("Reward terms")
    axes.set_ylabel("part of an episode's return")
    axes.axhline(0.0, color="#b4bcc8", linewidth=1.0)
    seconds = _values(history, "seconds")
    for key, style in _term_styles(history, REWARD).items():
        label = key.removeprefix(REWARD).replace("_", " ")
        _line(axes, seconds, _values(history, key), label=label, linewidth=1.5, **style)
    total = _values(history, "return")
    if len(total):
        _line(axes, seconds, total, color=INK, linewidth=2.4, label="return")
    _legend(axes)


def _plot_shares(axes: Axes, history: History) -> None:
    axes.set_title("What the return is made of")
    axes.set_ylabel("share, without signs [%]")
    seconds, styles = _values(history, "seconds"), _term_styles(history, SHARE)
    low = np.zeros(len(seconds))
    for key, style in styles.items():
        high = low + 100.0 * np.nan_to_num(_values(history, key))
        label = key.removeprefix(SHARE).replace("_", " ")
        hatch = None if style["linestyle"] == "-" else "//"
        color = style["color"]
        axes.fill_between(
            seconds, low, high, facecolor=color, alpha=0.55, hatch=hatch, label=label, linewidth=0
        )
        low = high
    _percent(axes)
    _legend(axes)


def _term_styles(history: History, prefix: str) -> dict[str, dict[str, Any]]:
    """Return how each term is drawn, the same in every panel."""
    styles, others = {}, 0
    for key in history:
        if not key.startswith(prefix) or not len(history[key]):
            continue
        color, dashes = MEANINGS.get(key.removeprefix(prefix)), "-"
        if color is None:
            color, dashes = TERMS[others % len(TERMS)], DASHES[others // len(TERMS) % len(DASHES)]
            others += 1
        styles[key] = {"color": color, "linestyle": dashes}
    return styles


def _plot_curriculum(axes: Axes, history: History) -> None:
    axes.set_title("Curriculum")
    seconds = _values(history, "seconds")
    names = [key for key in history if key.startswith(CURRICULUM) and key != EFFECTIVE_WORLDS]
    for key, color in zip(names, TERMS, strict=False):
        label = key.removeprefix(CURRICULUM).replace("_", " ")
        _line(axes, seconds, _values(history, key), color=color, label=label)
    worlds = _values(history, EFFECTIVE_WORLDS)
    if len(worlds):
        right = axes.twinx()
        right.tick_params(axis="y", labelcolor=INK)
        right.grid(visible=False)
        _line(right, seconds, worlds, color=INK, linestyle="--")
        right.set_ylim(bottom=0.0)
        # Named on the left axis, whose legend is the panel's.
        axes.plot([], [], color=INK, linestyle="--", label="effective worlds\n(right axis)")
    axes.set_ylim(bottom=0.0)
    _legend(axes, beside=1.08)


def _share_time(axes: Axes, history: History) -> None:
    """Give every panel the same time axis, from zero to the last number."""
    times = np.concatenate([_values(history, "seconds"), _values(history, "eval_seconds")])
    last = float(times.max()) if len(times) else 1.0
    axes.set_xlim(0.0, 1.02 * last if last > 0.0 else 1.0)


def _add_steps(axes: Axes, history: History) -> None:
    """Write the environment steps done by then above the time axis."""
    seconds, steps = _values(history, "seconds"), _values(history, "steps")
    if len(seconds) == 0 or len(steps) != len(seconds):
        return
    above = axes.secondary_xaxis("top")
    times = np.concatenate([[0.0], seconds])
    done = np.concatenate([[0.0], steps])
    above.xaxis.set_major_formatter(lambda time, _: _count(float(np.interp(time, times, done))))
    above.set_xlabel("environment steps")


def _count(steps: float) -> str:
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if steps >= size:
            return f"{steps / size:.3g} {letter}"
    return f"{steps:.0f}"


def _with_last(name: str, values: NDArray[np.float64]) -> str:
    """Name a line together with its last finite value [%]."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return name
    # Rounding may leave a hair below zero, which would read -0.0; zero added makes it 0.0.
    return f"{name}: {round(float(finite[-1]), 1) + 0.0:.1f} %"


def _percent(axes: Axes) -> None:
    axes.set_ylim(-3.0, 103.0)
    axes.set_yticks(range(0, 101, 20))


def _legend(axes: Axes, beside: float = 1.0) -> None:
    """Name the lines ``beside`` panel widths from its left, where no line can run through them."""
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="center left", bbox_to_anchor=(beside, 0.5))
    else:
        axes.text(0.5, 0.5, "no data yet", transform=axes.transAxes, ha="center", color="#848d9c")
