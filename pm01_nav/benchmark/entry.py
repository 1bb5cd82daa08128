# SPDX-License-Identifier: Apache-2.0
"""Who takes part in a benchmark: policy files and planners, each under a name of its own."""

from __future__ import annotations

import hashlib
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from pm01_nav.benchmark.policies import load_policy, policy_file
from pm01_nav.benchmark.suite import Suite
from pm01_nav.durations import CONTROL_DT
from pm01_nav.errors import InputError
from pm01_nav.planners import PLANNERS, planner_params
from pm01_nav.policy import Policy
from pm01_nav.provenance import shown_path

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}")


@dataclass(frozen=True)
class Entry:
    """One that takes part."""

    name: str
    kind: Literal["policy", "planner"]
    source: str
    """The planner's name or the policy's file."""
    fingerprint: str
    """SHA-256 of the policy's file, or of the planner's parameters."""

    def describe(self) -> dict[str, str]:
        """Return it as plain data."""
        return asdict(self) | {"source": shown_path(self.source)}

    def load(self, suite: Suite) -> Policy:
        """Return the policy, made for the suite's robot.

        Raises:
            InputError: it does not fit the robot or the control rate; the message names all three.
        """
        try:
            return load_policy(self.source, suite.robot, suite.task.control_dt)
        except InputError as error:
            raise InputError(f"{self.name} on suite {suite.name}: {error}") from None


COUNTED = {"replan_s": "replan_steps", "patience_s": "patience_steps", "horizon_s": "steps"}
"""Planners' parameters that were counted in control steps."""


def planner_entry(name: str) -> Entry:
    """Return the entry of a planner.

    Raises:
        InputError: no such planner.
    """
    if name not in PLANNERS:
        raise InputError(f"planner = {name!r}: unknown; allowed: {', '.join(PLANNERS)}")
    # With control steps of 0.1 s, as of old: what was recorded is still of the same entry.
    text = re.sub(
        rf'"({"|".join(COUNTED)})":([-+.e\d]+)',
        lambda found: f'"{COUNTED[found[1]]}":{float(found[2]) / CONTROL_DT:.9g}',
        planner_params(name).model_dump_json(),
    )
    params = f"{name} {text}"
    return Entry(name, "planner", name, hashlib.sha256(params.encode()).hexdigest())


def policy_entry(text: str) -> Entry:
    """Return the entry of ``FILE``, ``RUN_FOLDER`` or ``NAME=`` and one of these.

    Without a name it is that of the file, or of the folder in which a policy.onnx lies.

    Raises:
        InputError: there is no such file, or the name is not made of letters, digits and _.+-.
    """
    name, separator, source = text.rpartition("=")
    file = policy_file(source)
    if not separator:
        folder = file.resolve().parent.name
        name = folder if file.name == "policy.onnx" and folder else file.stem
    if not NAME.fullmatch(name) or name in PLANNERS:
        raise InputError(
            f"policy = {text!r}: cannot be called {name!r}; write --policy NAME={source}"
        )
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error
    return Entry(name, "policy", str(file), hashlib.sha256(content).hexdigest())
