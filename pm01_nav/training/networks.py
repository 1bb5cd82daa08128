# SPDX-License-Identifier: Apache-2.0
"""What the networks of all algorithms have in common: how they read an observation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor

from pm01_nav.envs.spaces import observation_space, widened
from pm01_nav.errors import InputError
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.task.privileged import Privileged
from pm01_nav.training.algorithm_config import AlgorithmConfig, ConvolutionConfig

ACTIVATIONS = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh, "elu": torch.nn.ELU}


@dataclass(frozen=True)
class ScanShape:
    """Where an observation's scans are, and whether they close to a circle."""

    frames: int
    sectors: int
    closed: bool
    begin: int = 0


def scan_shape(layout: ObservationLayout) -> ScanShape:
    """Return where the scans are in an observation.

    Raises:
        InputError: it has none.
    """
    scan = layout.part("scan")
    if scan is None:
        raise InputError("features_extractor: a convolution needs the part scan")
    return ScanShape(scan.shape[0], scan.shape[1], scan.closed, layout.places["scan"].start)


class ScanConvolution(torch.nn.Module):
    """Two convolutions over the sectors of scans; frames are channels.

    The last sector of a lidar that looks all around lies beside the first one; elsewhere the
    sectors at the ends are repeated.
    """

    def __init__(self, config: ConvolutionConfig, shape: ScanShape) -> None:
        """Build the convolutions."""
        super().__init__()
        self.shape, self.margin = shape, config.kernel_size // 2
        size, stride = config.kernel_size, config.stride
        self.first = torch.nn.Conv1d(shape.frames, config.channels[0], size, stride)
        self.second = torch.nn.Conv1d(config.channels[0], config.channels[1], size, stride)
        length = shape.sectors
        for _ in config.channels:
            length = (length - 1) // stride + 1
        self.size = config.channels[1] * length
        """How many numbers come out."""

    def forward(self, scans: torch.Tensor) -> torch.Tensor:
        """Return features (n, size) of scans (n, frames * sectors)."""
        values = scans.reshape(-1, self.shape.frames, self.shape.sectors)
        values = torch.relu(self.first(self._padded(values)))
        return torch.relu(self.second(self._padded(values))).flatten(1)

    def _padded(self, values: torch.Tensor) -> torch.Tensor:
        m = self.margin
        if self.shape.closed:
            return torch.cat([values[..., -m:], values, values[..., :m]], dim=-1)
        ends = values[..., :1].expand(-1, -1, m), values[..., -1:].expand(-1, -1, m)
        return torch.cat([ends[0], values, ends[1]], dim=-1)


class Features(BaseFeaturesExtractor):
    """What a network sees of an observation: scaled, convolved if wanted, for critics with more."""

    scale: torch.Tensor

    def __init__(
        self,
        observation_space: spaces.Box,
        scale: tuple[float, ...],
        shape: ScanShape | None = None,
        conv: ConvolutionConfig | None = None,
        privileged: int = 0,
    ) -> None:
        """Divide by ``scale`` the numbers of a robot; ``privileged`` more ones may follow them."""
        convolution, begin, end = None, 0, 0
        if conv is not None and shape is not None:
            convolution = ScanConvolution(conv, shape)
            begin, end = shape.begin, shape.begin + shape.frames * shape.sectors
        size = len(scale) + (convolution.size if convolution else 0) - (end - begin) + privileged
        super().__init__(observation_space, features_dim=size)
        self.size, self.begin, self.end, self.privileged = len(scale), begin, end, privileged
        self.convolution = convolution
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return features of observations (n, at least size)."""
        values = observations[:, : self.size] / self.scale
        parts = [values]
        if self.convolution is not None:
            scans = self.convolution(values[:, self.begin : self.end])
            parts = [scans, values[:, : self.begin], values[:, self.end :]]
        if self.privileged:
            parts.append(observations[:, self.size :])
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)


def critic_features(policy: BasePolicy) -> Features:
    """Return a features extractor like the policy's that also reads the privileged numbers."""
    settings = policy.features_extractor_kwargs
    space = policy.observation_space
    assert isinstance(space, spaces.Box)
    return Features(space, **settings, privileged=space.shape[0] - len(settings["scale"]))


class AsymmetricActorCritic(ActorCriticPolicy):
    """SB3's policy whose critic sees more than its actor."""

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        features = critic_features(self)
        self.vf_features_extractor = features
        self.mlp_extractor.value_net = MlpExtractor(
            features.features_dim,
            net_arch=self.net_arch,
            activation_fn=self.activation_fn,
            device=self.device,
        ).value_net


class AsymmetricCritics:
    """Mixed into a policy of SAC, TD3 or TQC, its critics see more than its actor."""

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Build critics with a features extractor of their own."""
        policy: Any = self
        return super().make_critic(critic_features(policy))  # type: ignore[misc]


def privileged(config: AlgorithmConfig) -> Privileged | None:
    """Return what the critic alone sees, if there is anything."""
    return Privileged() if config.asymmetric_critic else None


def network_space(config: AlgorithmConfig, layout: ObservationLayout) -> spaces.Box:
    """Return the box of what the networks are given."""
    return widened(observation_space(layout), privileged(config))


def network_arguments(config: AlgorithmConfig, layout: ObservationLayout) -> dict[str, Any]:
    """Return the arguments that the policies of all algorithms take."""
    arguments: dict[str, Any] = {
        "net_arch": list(config.net_arch),
        "activation_fn": ACTIVATIONS[config.activation],
    }
    flat = config.features_extractor == "flat"
    # Without an extractor of ours SB3's passes observations on as they are, which is quicker.
    if flat and layout.normalize and not config.asymmetric_critic:
        return arguments
    normalized = layout.normalize or config.norm_obs
    arguments["features_extractor_class"] = Features
    arguments["features_extractor_kwargs"] = {
        "scale": (1.0,) * layout.size if normalized else tuple(layout.scale),
        "shape": None if flat else scan_shape(layout),
        "conv": None if flat else config.conv,
    }
    if config.asymmetric_critic:
        arguments["share_features_extractor"] = False
    return arguments
