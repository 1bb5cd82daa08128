# SPDX-License-Identifier: Apache-2.0
"""What a terminal shows: the progress of a training run, tables of results, robots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from pm01_nav.drives.limits import OmnidirectionalLimits

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec


class TrainingDisplay:
    """A progress bar on a terminal, a line an evaluation elsewhere."""

    def __init__(self, console: Console | None = None) -> None:
        """Show on ``console``, standard error by default."""
        self._console = console or Console(stderr=True)
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[success]}"),
            TimeRemainingColumn(compact=True),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task: TaskID | None = None

    def __enter__(self) -> TrainingDisplay:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the bar as it is."""
        self._bar.stop()

    def started(self, message: str) -> None:
        """Say how the run was set up."""
        self._console.print(message, style="dim", highlight=False, soft_wrap=True)
        self._task = self._bar.add_task("training", total=1.0, rate="", success="")

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """Show one iteration."""
        success = row["success_rate"]
        assert self._task is not None
        self._bar.update(
            self._task,
            completed=min(fraction, 1.0),
            rate=f"{steps_per_second / 1e3:5.1f} k steps/s",
            success="" if success != success else f"success {100 * success:5.1f} %",
        )

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Print an evaluation on held-out worlds."""
        rates = [100.0 * summary[f"{n}_rate"] for n in ("success", "collision", "timeout")]
        self._console.print(
            f"{steps:>12,} steps: held-out worlds: success {rates[0]:.1f} %, "
            f"collision {rates[1]:.1f} %, timeout {rates[2]:.1f} %",
            highlight=False,
            soft_wrap=True,
        )

    def warned(self, steps: int, text: str) -> None:
        """Print what seems to go wrong."""
        self._console.print(
            f"{steps:>12,} steps: warning: {escape(text)}",
            style="yellow",
            highlight=False,
            soft_wrap=True,
        )


def results_table(columns: dict[str, dict[str, Any]], title: str) -> Table:
    """Return evaluation results as a table, one column for each policy."""
    table = Table(title=title)
    table.add_column("", justify="left")
    for name in columns:
        table.add_column(name, justify="right")
    for label, key in (
        ("success", "success_rate"),
        ("collision", "collision_rate"),
        ("timeout", "timeout_rate"),
    ):
        table.add_row(label, *(_rate(summary, key) for summary in columns.values()))
    if any("failure_rate" in summary for summary in columns.values()):
        failed = (f"{100 * s.get('failure_rate', 0.0):.1f} %" for s in columns.values())
        table.add_row("the policy failed", *failed)
    for label, key, unit in (
        ("SPL", "spl", ""),
        ("time to goal", "time_to_goal_s", " s"),
        ("path length", "path_length_m", " m"),
        ("least clearance", "min_clearance_m", " m"),
        ("mean clearance", "mean_clearance_m", " m"),
        ("mean jerk", "mean_jerk", " m/s^3"),
        ("turns to the other side", "turn_reversals_per_min", " /min"),
        ("steps close to pedestrians", "personal_space_intrusion", ""),
        ("time close to pedestrians", "personal_space_time_s", " s"),
        ("BARN score 2024 (of 0.5)", "barn_score_2024", ""),
        ("BARN score 2022 (of 0.25)", "barn_score_2022", ""),
        ("DynaBARN as published (of 0.125)", "dynabarn_score_as_published", ""),
    ):
        if any(summary.get(key) is not None for summary in columns.values()):
            table.add_row(label, *(_number(s.get(key), unit) for s in columns.values()))
    return table


def sweep_table(report: dict[str, Any]) -> Table:
    """Return the runs of a sweep, one a row, and what they show together."""
    suites = [name for name in report["success_rate"] if name != "all"]
    table = Table(title=f"{report['algorithm']} on {report['task']}: success %")
    for name in ("seed", *suites, "95 % after", "99 % after", "steps"):
        table.add_column(name, justify="right")
    for run in report["runs"]:
        rates = [f"{100.0 * run['success_rate'][suite]:.1f}" for suite in suites]
        times = [run["seconds_to_95%"], run["seconds_to_99%"]]
        after = ["-" if t is None else f"{t:.1f} s" for t in times]
        table.add_row(str(run["seed"]), *rates, *after, f"{run['steps']:,}")
    table.add_section()
    together = [_iqm(report["success_rate"][suite]) for suite in suites]
    table.add_row("IQM", *together, "", "", "")
    return table


def _iqm(found: dict[str, Any]) -> str:
    text = f"{100.0 * found['iqm']:.1f}"
    if found["ci95"] is None:
        return text
    low, high = (100.0 * value for value in found["ci95"])
    return f"{text} [{low:.1f}, {high:.1f}]"


def tuning_table(report: dict[str, Any], rows: int = 10) -> Table:
    """Return the best trials of a search, one a row."""
    names = list(report["best"]["values"])
    states = ", ".join(f"{n} {s.lower()}" for s, n in report["states"].items() if n)
    table = Table(title=f"{report['algorithm']} on {report['task']}: {states}")
    for name in ("trial", "success %", *names):
        table.add_column(name, justify="right")
    for trial in report["trials"][:rows]:
        values = [_short(trial["values"].get(name)) for name in names]
        table.add_row(str(trial["trial"]), f"{100.0 * trial['success_rate']:.1f}", *values)
    return table


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def episodes_bar() -> Progress:
    """Return a bar that counts episodes, on a terminal only."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[now]}"),
        console=console,
        disable=not console.is_terminal,
    )


def benchmark_table(summaries: list[dict[str, Any]]) -> Table:
    """Return success, and how else episodes ended, of every entry (row) on every suite (column)."""
    suites = list(dict.fromkeys(summary["suite"] for summary in summaries))
    cells = {(s["entry"], s["suite"]): _outcomes(s) for s in summaries}
    table = Table(title="success % (collision, timeout)")
    table.add_column("")
    for suite in suites:
        table.add_column(suite, justify="right")
    for entry in dict.fromkeys(summary["entry"] for summary in summaries):
        table.add_row(entry, *(cells.get((entry, suite), "-") for suite in suites))
    return table


def robot_table(robot: RobotSpec, notes: Mapping[str, str]) -> Table:
    """Return a robot's figures, one a row, and by ``notes`` where they came from."""
    table = Table(title=escape(robot.description or robot.name), show_header=False)
    for _ in range(3 if notes else 2):
        table.add_column(justify="left")
    for group in _robot_rows(robot):
        for label, (text, *keys) in group.items():
            found = dict.fromkeys(notes[key] for key in keys if key in notes)
            table.add_row(label, text, *([escape("; ".join(found))] if notes else []))
        table.add_section()
    return table


MOST_CORNERS = 8
"""A polygon of more is shown by its extent."""
Rows = dict[str, tuple[str, ...]]
"""By its label a figure's text, and then the keys that it comes from."""


def _robot_rows(robot: RobotSpec) -> tuple[Rows, Rows, Rows]:
    return _body_rows(robot), _limit_rows(robot), _lidar_rows(robot)


def _body_rows(robot: RobotSpec) -> Rows:
    footprint = robot.footprint
    outline = f"circle of {footprint.radius:g} m"
    if footprint.vertices:
        corners = ", ".join(f"({x:g}, {y:g})" for x, y in footprint.vertices)
        outline = f"polygon of {corners} m"
    if len(footprint.vertices) > MOST_CORNERS:
        x, y = zip(*footprint.vertices, strict=True)
        outline = (
            f"polygon of {len(x)} corners, x {min(x):g} to {max(x):g} m, "
            f"y {min(y):g} to {max(y):g} m"
        )
    reach = f"{footprint.inscribed_radius:.3f} m, {footprint.circumscribed_radius:.3f} m"
    return {
        "name": (robot.name,),
        "footprint": (outline, "footprint"),
        "reaches, at least and at most": (reach,),
        "drive": (robot.drive, "drive"),
    } | _wheel_rows(robot)


def _wheel_rows(robot: RobotSpec) -> Rows:
    """Return the wheels, and what physics engines know of a robot that has a pair of them."""
    if robot.wheels is None:
        return {}
    from pm01_nav.backends.body import body_model

    return {
        "wheel radius": (f"{robot.wheels.radius:g} m", "wheels.radius"),
        "wheel separation": (f"{robot.wheels.separation:g} m", "wheels.separation"),
        "mass, in physics engines": (f"{body_model(robot).mass:.4g} kg", "body.mass"),
        "height, likewise": (f"{robot.body.height:g} m", "body.height"),
    }


def _limit_rows(robot: RobotSpec) -> Rows:
    limits = robot.limits
    aside: Rows = {}
    if isinstance(limits, OmnidirectionalLimits):
        slantwise = {"box": "both speeds at once", "ellipse": "less of both speeds"}[limits.shape]
        faster = f"{limits.lateral_acceleration:g} m/s^2"
        aside = {
            "speed to either side": (f"{limits.lateral_max:g} m/s", "limits.lateral_max"),
            "acceleration to the side": (faster, "limits.lateral_acceleration"),
            "slantwise": (slantwise, "limits.shape"),
        }
    speed = f"{limits.linear_min:g} to {limits.linear_max:g} m/s"
    turning = f"{limits.angular_acceleration:g} rad/s^2"
    return {
        "speed": (speed, "limits.linear_max", "limits.linear_min"),
        "turn rate": (f"{limits.angular_max:g} rad/s", "limits.angular_max"),
        "acceleration": (f"{limits.linear_acceleration:g} m/s^2", "limits.linear_acceleration"),
        "angular acceleration": (turning, "limits.angular_acceleration"),
        **aside,
        "lag of the base": (f"{robot.actuator.lag_s:g} s", "actuator.lag_s"),
    }


def _lidar_rows(robot: RobotSpec) -> Rows:
    lidar = robot.lidar
    opening = f"{math.degrees(lidar.angle_min):.1f} to {math.degrees(lidar.angle_max):.1f} deg"
    beams = f"{lidar.num_beams}, {opening}, every {math.degrees(lidar.angle_increment):.3g} deg"
    turned = f", turned by {math.degrees(lidar.yaw):.1f} deg" if lidar.yaw else ""
    place = f"({lidar.x:g}, {lidar.y:g}) m{turned}{', upside down' if lidar.upside_down else ''}"
    keys = ("num_beams", "angle_min", "angle_max")
    return {
        "beams": (beams, *(f"lidar.{key}" for key in keys)),
        "range": (
            f"{lidar.range_min:g} to {lidar.range_max:g} m",
            "lidar.range_min",
            "lidar.range_max",
        ),
        "a range of 0": (lidar.zero_means.replace("_", " "), "lidar.zero_means"),
        "place in base_link": (place, "lidar.x", "lidar.y", "lidar.yaw", "lidar.upside_down"),
        "height above the floor": (f"{robot.body.lidar_height:g} m", "body.lidar_height"),
        "noise": (f"{lidar.noise_std:g} m", "lidar.noise_std"),
    }


def _outcomes(summary: dict[str, Any]) -> str:
    success, collision, timeout = (
        100.0 * summary[f"{name}_rate"] for name in ("success", "collision", "timeout")
    )
    failed = f", failed {100.0 * summary['failure_rate']:.1f}" if "failure_rate" in summary else ""
    return f"{success:.1f} ({collision:.1f}, {timeout:.1f}{failed})"


def _rate(summary: dict[str, Any], key: str) -> str:
    low, high = summary[f"{key}_ci95"]
    return f"{100 * summary[key]:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def _number(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.3g}{unit}"
