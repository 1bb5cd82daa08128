# SPDX-License-Identifier: Apache-2.0
"""What the networks of all algorithms have in common: how they read an observation."""

from __future__ import annotations

import math
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

    @property
    def place(self) -> slice:
        """Where they lie in an observation."""
        return slice(self.begin, self.begin + self.frames * self.sectors)


def scan_shape(layout: ObservationLayout) -> ScanShape:
    """Return where the scans are in an observation.

    Raises:
        InputError: it has none.
    """
    scan = layout.part("scan")
    if scan is None:
        raise InputError("features_extractor: a convolution needs the part scan")
    frames, sectors = (1, *scan.shape)[-2:]
    return ScanShape(frames, sectors, scan.closed, layout.places["scan"].start)


class ScanConvolution(torch.nn.Module):
    """Two convolutions over the sectors of scans; frames are channels.

    The last sector of a lidar that looks all around lies beside the first one; elsewhere the
    sectors at the ends are repeated.
    """

    def __init__(self, config: ConvolutionConfig, shape: ScanShape) -> None:
        """Build the convolutions."""
        super().__init__()
        self.shape, self.place, self.margin = shape, shape.place, config.kernel_size // 2
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


class ImageConvolution(torch.nn.Module):
    """Two convolutions over a part of the shape (channels, height, width), zeros around it."""

    def __init__(self, config: ConvolutionConfig, place: slice, shape: tuple[int, ...]) -> None:
        """Build the convolutions for the part that lies at ``place`` in an observation."""
        super().__init__()
        self.place, self.shape = place, shape
        size, stride, margin = config.kernel_size, config.stride, config.kernel_size // 2
        self.first = torch.nn.Conv2d(shape[0], config.channels[0], size, stride, margin)
        self.second = torch.nn.Conv2d(*config.channels, size, stride, margin)
        sides = [((side - 1) // stride) // stride + 1 for side in shape[1:]]
        self.size = config.channels[1] * math.prod(sides)
        """How many numbers come out."""

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Return features (n, size) of flattened images (n, channels * height * width)."""
        values = torch.relu(self.first(images.reshape(-1, *self.shape)))
        return torch.relu(self.second(values)).flatten(1)


class Features(BaseFeaturesExtractor):
    """What a network sees of an observation: scaled, convolved if wanted, for critics with more."""

    scale: torch.Tensor

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        scale: tuple[float, ...],
        conv: ConvolutionConfig,
        shape: ScanShape | None = None,
        images: tuple[tuple[slice, tuple[int, ...]], ...] = (),
        privileged: int = 0,
    ) -> None:
        """Divide by ``scale`` the numbers of a robot; ``privileged`` more ones may follow them.

        ``conv`` is for scans of a ``shape`` and for ``images``, each with its place.
        """
        scans = [] if shape is None else [ScanConvolution(conv, shape)]
        pictures = [ImageConvolution(conv, *image) for image in images]
        pieces: list[tuple[slice, Any]] = []
        size, end = len(scale) + privileged, 0
        for net in sorted([*scans, *pictures], key=lambda net: net.place.start):
            pieces += [(slice(end, net.place.start), None), (net.place, net)]
            size, end = size + net.size - (net.place.stop - net.place.start), net.place.stop
        super().__init__(observation_space, size)
        self.size, self.privileged = len(scale), privileged
        self._pieces = [*pieces, (slice(end, self.size), None)]
        self.convolution = scans[0] if scans else None
        self.images = torch.nn.ModuleList(pictures)
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))

    def forward(self, observations: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """Return features of observations (n, at least size), or of a ``Dict``'s parts."""
        if isinstance(observations, dict):
            names = self._observation_space.spaces  # type: ignore[attr-defined]
            observations = torch.cat([observations[name].flatten(1) for name in names], dim=1)
        values = observations[:, : self.size] / self.scale
        parts = [net(values[:, at]) if net else values[:, at] for at, net in self._pieces]
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


def image_places(layout: ObservationLayout) -> tuple[tuple[slice, tuple[int, ...]], ...]:
    """Return place and shape of what a network sees as an image: of a ``Dict``, as SB3 has it."""
    if layout.space == "flat":
        return ()
    found = [part for part in layout.parts if len(part.shape) == 3]
    return tuple((layout.places[part.name], part.shape) for part in found)


def privileged(config: AlgorithmConfig) -> Privileged | None:
    """Return what the critic alone sees, if there is anything."""
    return Privileged() if config.asymmetric_critic else None


def network_space(config: AlgorithmConfig, layout: ObservationLayout) -> spaces.Space[Any]:
    """Return the space of what the networks are given."""
    return widened(observation_space(layout), privileged(config))


def network_arguments(config: AlgorithmConfig, layout: ObservationLayout) -> dict[str, Any]:
    """Return the arguments that the policies of all algorithms take."""
    arguments: dict[str, Any] = {
        "net_arch": list(config.net_arch),
        "activation_fn": ACTIVATIONS[config.activation],
    }
    flat = config.features_extractor == "flat"
    # Without an extractor of ours SB3's passes observations on as they are, which is quicker.
    plain = flat and layout.space == "flat"
    if plain and layout.normalize and not config.asymmetric_critic:
        return arguments
    normalized = layout.normalize or config.norm_obs
    arguments["features_extractor_class"] = Features
    arguments["features_extractor_kwargs"] = {
        "scale": (1.0,) * layout.size if normalized else tuple(layout.scale),
        "conv": config.conv,
        "shape": None if flat else scan_shape(layout),
        "images": image_places(layout),
    }
    if config.asymmetric_critic:
        arguments["share_features_extractor"] = False
    return arguments
