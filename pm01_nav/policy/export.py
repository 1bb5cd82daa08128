# SPDX-License-Identifier: Apache-2.0
"""Write a trained policy as one ONNX file: normaliser, network, action limits and metadata."""

from __future__ import annotations

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy

from pm01_nav.config import write_atomically
from pm01_nav.policy.network_policy import NetworkPolicy
from pm01_nav.policy.onnx_policy import FORMAT, METADATA_KEY
from pm01_nav.robot import RobotSpec
from pm01_nav.task.observation import ObservationLayout

OPSET = 18


class DeployedPolicy(torch.nn.Module):
    """From an observation in physical units to a command in m/s and rad/s."""

    scale: torch.Tensor
    half_range: torch.Tensor
    low: torch.Tensor

    def __init__(self, policy: ActorCriticPolicy, layout: ObservationLayout) -> None:
        """Wrap the greedy part of ``policy``."""
        super().__init__()
        self.policy = policy
        divisors = layout.scale if layout.normalize else [1.0] * layout.size
        limits = layout.limits
        low = [limits.linear_min, -limits.angular_max]
        high = [limits.linear_max, limits.angular_max]
        self.register_buffer("scale", torch.tensor(divisors))
        self.register_buffer("low", torch.tensor(low))
        self.register_buffer("half_range", 0.5 * (torch.tensor(high) - torch.tensor(low)))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return commands (n, 2) for observations (n, size)."""
        features = self.policy.pi_features_extractor(observation / self.scale)
        mean = self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))
        return self.low + self.half_range * (torch.clamp(mean, -1.0, 1.0) + 1.0)


def greedy_policy(
    policy: ActorCriticPolicy, layout: ObservationLayout, control_dt: float
) -> NetworkPolicy:
    """Return the policy under training as a ``Policy``, for evaluations along the way."""
    module = DeployedPolicy(policy, layout)

    def network(batch: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.no_grad():
            return module(torch.from_numpy(batch)).numpy()

    return NetworkPolicy(layout, network, control_dt)


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
    policy: ActorCriticPolicy,
    layout: ObservationLayout,
    metadata: dict[str, Any],
    path: str | Path,
) -> None:
    """Write ``path``; the file never exists half written."""
    module = DeployedPolicy(policy, layout).eval()
    example = torch.zeros(2, layout.size)
    quiet = logging.getLogger("torch.onnx")
    level = quiet.level
    quiet.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                module,
                (example,),
                dynamo=True,
                verbose=False,
                input_names=["observation"],
                output_names=["command"],
                dynamic_shapes=({0: torch.export.Dim("batch")},),
                opset_version=OPSET,
            )
    finally:
        quiet.setLevel(level)
    assert program is not None
    model: onnx.ModelProto = program.model_proto
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, json.dumps(metadata)
    write_atomically(path, model.SerializeToString())
