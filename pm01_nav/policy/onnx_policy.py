# SPDX-License-Identifier: Apache-2.0
"""Run an exported policy; needs numpy and onnxruntime alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pm01_nav.drives import Drive
from pm01_nav.errors import InputError
from pm01_nav.policy.network_policy import NetworkPolicy
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.zoo import resolved

if TYPE_CHECKING:
    from pm01_nav.robot import RobotSpec

METADATA_KEY = "pm01_nav"
FORMAT = 2
"""Version of the metadata's layout. Files of format 1 are read, too: they list no parts."""


class OnnxPolicy(NetworkPolicy):
    """A policy file that explains itself: it knows its sensors, its limits and its origin."""

    def __init__(self, path: str | Path, robot: RobotSpec | None = None) -> None:
        """Load ``policy.onnx``, or ``zoo:NAME``; with ``robot``, make sure that the two fit.

        Raises:
            InputError: the file is no policy of ours, or its lidar or limits are not the robot's.
        """
        self.path = resolved(path)
        session, self.metadata = _open(self.path)
        try:
            control_dt = float(self.metadata["control_dt"])
            layout = ObservationLayout.from_dict(self.metadata["observation"], control_dt)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: unusable metadata: {error}") from error
        inputs = {given.name: given.shape[-1] for given in session.get_inputs()}
        width = next(iter(inputs.values()))
        if width != layout.size:
            raise InputError(f"{path}: network of {width} inputs, metadata of {layout.size}")
        names, memory_size = tuple(inputs), int(inputs.get("memory", 0))

        def network(*given: Any) -> Any:
            answer = session.run(None, dict(zip(names, given, strict=True)))
            return answer if memory_size else answer[0]

        super().__init__(layout, network, control_dt, memory_size)
        if robot is not None:
            self.check_robot(robot)
            # How its driver says "no return" is the robot's own, not what was learned.
            scan = replace(layout.scan, zero_means=robot.lidar.zero_means)
            self.layout = replace(layout, scan=scan)

    def check_robot(self, robot: RobotSpec) -> None:
        """Make sure that the policy fits ``robot``.

        Raises:
            InputError: its lidar, its limits or its size are not those of the training.
        """
        lidar, mine = robot.lidar, self.layout
        mount = self.metadata.get("lidar_mount", [0.0, 0.0, 0.0])
        radius = self.metadata.get("footprint_radius", 0.0)
        pairs = [
            ("lidar.num_beams", mine.scan.num_beams, lidar.num_beams),
            ("lidar.angle_min", mine.scan.angle_min, lidar.angle_min),
            ("lidar.angle_increment", mine.scan.angle_increment, lidar.angle_increment),
            ("lidar.range_min", mine.scan.range_min, lidar.range_min),
            ("lidar.range_max", mine.scan.range_max, min(lidar.range_max, mine.scan.range_max)),
            ("lidar.x", mount[0], lidar.x),
            ("lidar.y", mount[1], lidar.y),
            ("lidar.yaw", mount[2], lidar.yaw),
            ("footprint's radius", radius, robot.footprint.circumscribed_radius),
            *self._limits(robot.base),
        ]
        for key, of_policy, of_robot in pairs:
            if abs(of_policy - of_robot) > 1e-4:
                raise InputError(
                    f"{self.path}: does not fit robot {robot.name}: {key} is {of_robot:g}, "
                    f"but the policy was trained with {of_policy:g} "
                    f"(robot {self.metadata.get('robot', 'unknown')})"
                )

    def _limits(self, base: Drive) -> list[tuple[str, float, float]]:
        """Return the limits of speed: by name, of the training, and of another drive.

        Raises:
            InputError: it is another kind of drive.
        """
        mine = self.layout.drive
        if mine.name != base.name:
            raise InputError(f"{self.path}: was trained for the drive {mine.name}, not {base.name}")
        speeds, others = mine.speeds(), base.speeds()
        numbers = [name for name, value in speeds.items() if isinstance(value, float)]
        return [(f"limits.{name}", speeds[name], others[name]) for name in numbers]


def _open(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return an inference session and the file's metadata."""
    try:
        import onnxruntime
    except ImportError as error:
        raise InputError("onnxruntime is missing: pip install 'pm01-nav[deploy]'") from error
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions have no common base but this
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: is not a readable ONNX file: {reason}") from error
    text = session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
    if text is None:
        raise InputError(f"{path}: has no pm01_nav metadata; make policy files with `pm01 export`")
    try:
        metadata = json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: its pm01_nav metadata is not valid JSON") from error
    found = metadata.get("format") if isinstance(metadata, dict) else None
    if found not in (1, FORMAT):
        raise InputError(f"{path}: metadata format is {found!r}, this version reads 1 and {FORMAT}")
    return session, metadata
