# SPDX-License-Identifier: Apache-2.0
"""Write a trained policy as one ONNX file: normaliser, network, action limits and metadata."""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy

from pm01_nav.config import write_atomically
from pm01_nav.policy.actors import actor_of
from pm01_nav.policy.network_policy import NetworkPolicy
from pm01_nav.policy.onnx_policy import FORMAT
from pm01_nav.robot import RobotSpec
from pm01_nav.task.observation import ObservationLayout

if TYPE_CHECKING:
    import onnx

OPSET = 18


@dataclass(frozen=True)
class ObservationStatistics:
    """The running mean and variance by which a policy's observations were normalized."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    """Both (at least size,), of observations as the environment gave them."""
    epsilon: float
    """Added to the variance."""
    clip: float
    """What is normalized stays within this, to both sides."""


class DeployedPolicy(torch.nn.Module):
    """From an observation in physical units to a command in m/s and rad/s."""

    scale: torch.Tensor
    mean: torch.Tensor
    deviation: torch.Tensor
    half_range: torch.Tensor
    low: torch.Tensor

    def __init__(
        self,
        policy: BasePolicy,
        layout: ObservationLayout,
        statistics: ObservationStatistics | None = None,
    ) -> None:
        """Wrap the greedy part of ``policy``, and what its observations were normalized by."""
        super().__init__()
        self.actor, self._layout = actor_of(policy), layout
        self.memory_size = self.actor.memory_size
        divisors = layout.scale if layout.normalize else [1.0] * layout.size
        low, high = torch.tensor([layout.drive.low.tolist(), layout.drive.high.tolist()])
        self.register_buffer("scale", torch.tensor(divisors))
        self.register_buffer("low", low)
        self.register_buffer("half_range", 0.5 * (high - low))
        self.clip = statistics.clip if statistics else None
        if statistics:
            mean = statistics.mean[: layout.size].astype(np.float32)
            deviation = np.sqrt(statistics.variance[: layout.size] + statistics.epsilon)
            self.register_buffer("mean", torch.from_numpy(mean))
            self.register_buffer("deviation", torch.from_numpy(deviation.astype(np.float32)))

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None = None) -> Any:
        """Return commands (n, axes) for observations (n, size).

        An actor that remembers is given its memory (n, memory_size), zeros at first, and the new
        memory is returned, too.
        """
        values = observation / self.scale
        if self.clip is not None:
            values = torch.clamp((values - self.mean) / self.deviation, -self.clip, self.clip)
        given = self._layout.as_space(values)
        if not self.memory_size:
            return self._command(self.actor(given))
        action, after = self.actor(given, memory)
        return self._command(action), after

    def _command(self, action: torch.Tensor) -> torch.Tensor:
        return self.low + self.half_range * (torch.clamp(action, -1.0, 1.0) + 1.0)


def greedy_policy(
    policy: BasePolicy,
    layout: ObservationLayout,
    control_dt: float,
    statistics: ObservationStatistics | None = None,
) -> NetworkPolicy:
    """Return the policy under training as a ``Policy``, for evaluations along the way."""
    module = DeployedPolicy(policy, layout, statistics)

    def network(*given: NDArray[np.float32]) -> Any:
        with torch.no_grad():
            answer = module(*(torch.from_numpy(array) for array in given))
        if isinstance(answer, tuple):
            return tuple(array.numpy() for array in answer)
        return answer.numpy()

    return NetworkPolicy(layout, network, control_dt, module.memory_size)


def policy_metadata(
    layout: ObservationLayout, robot: RobotSpec, control_dt: float, origin: dict[str, Any]
) -> dict[str, Any]:
    """Return what a policy file says of itself; ``origin`` tells how it was made."""
    return {
        "format": FORMAT,
        "observation": layout.to_dict(),
        "control_dt": control_dt,
        "robot": robot.name,
        "lidar_mount": [robot.lidar.x, robot.lidar.y, robot.lidar.yaw],
        "footprint_radius": robot.footprint.circumscribed_radius,
        **origin,
    }


def export_policy(
    policy: BasePolicy,
    layout: ObservationLayout,
    metadata: dict[str, Any],
    path: str | Path,
    statistics: ObservationStatistics | None = None,
) -> None:
    """Write ``path``; the file never exists half written."""
    from pm01_nav.policy.onnx_file import set_metadata  # onnx is needed here alone

    module = DeployedPolicy(policy, layout, statistics).eval()
    inputs, outputs = ["observation"], ["command"]
    examples = [torch.zeros(2, layout.size)]
    if module.memory_size:
        inputs.append("memory")
        outputs.append("memory_after")
        examples.append(torch.zeros(2, module.memory_size))
    model = _to_onnx(module, examples, inputs, outputs)
    set_metadata(model, metadata)
    write_atomically(path, model.SerializeToString())


def _to_onnx(
    module: torch.nn.Module, examples: list[torch.Tensor], inputs: list[str], outputs: list[str]
) -> onnx.ModelProto:
    quiet = logging.getLogger("torch.onnx")
    level = quiet.level
    quiet.setLevel(logging.ERROR)
    rows = {0: torch.export.Dim("batch")}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                module,
                tuple(examples),
                dynamo=True,
                verbose=False,
                input_names=inputs,
                output_names=outputs,
                dynamic_shapes=tuple(rows for _ in examples),
                opset_version=OPSET,
            )
    finally:
        quiet.setLevel(level)
    assert program is not None
    return program.model_proto
