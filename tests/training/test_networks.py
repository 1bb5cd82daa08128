# SPDX-License-Identifier: Apache-2.0
"""How networks read an observation: a circle of sectors, and a critic that sees more."""

from __future__ import annotations

import pytest
import torch

from pm01_nav.policy.actors import actor_of
from pm01_nav.task.config import observation_layout
from pm01_nav.task.privileged import Privileged
from pm01_nav.task.tasks import task_config
from pm01_nav.training.algorithm_config import ConvolutionConfig
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.config import TrainConfig
from pm01_nav.training.networks import ScanConvolution, ScanShape, scan_shape


def layout_of(task: str):
    config = task_config(task)
    return observation_layout(config, config.robot_spec())


def test_turning_a_closed_scan_turns_its_features():
    torch.manual_seed(0)
    net = ScanConvolution(ConvolutionConfig(), ScanShape(frames=3, sectors=36, closed=True))
    scans = torch.rand(5, 3, 36)
    turned = torch.roll(scans, 4, dims=-1)  # 4 sectors are one output: two strides of 2
    first, second = (net(s.flatten(1)).reshape(5, 16, 9) for s in (scans, turned))
    assert torch.allclose(torch.roll(first, 1, dims=-1), second, atol=1e-6)
    assert net.size == 16 * 9
    assert not torch.allclose(first, second, atol=1e-3)


def test_open_scan_repeats_its_ends():
    torch.manual_seed(0)
    shape = ScanShape(frames=1, sectors=20, closed=False)
    net = ScanConvolution(ConvolutionConfig(stride=1), shape)
    # The same everywhere looks the same at the ends, whatever is not seen beyond them.
    features = net(torch.full((1, 20), 0.7)).reshape(16, 20)
    assert torch.allclose(features, features[:, :1].expand(-1, 20), atol=1e-6)


@pytest.mark.parametrize(
    ("task", "expected"),
    [
        ("static", ScanShape(1, 36, True)),
        ("mixed", ScanShape(3, 36, True)),
        ("barn_like", ScanShape(1, 72, False)),  # 270 degrees
        ("article", ScanShape(1, 20, True)),
    ],
)
def test_where_scans_are(task, expected):
    assert scan_shape(layout_of(task)) == expected


@pytest.mark.parametrize("algo", list(ALGORITHMS))
def test_only_the_critic_sees_what_a_robot_cannot(algo):
    torch.manual_seed(0)
    layout, more = layout_of("static"), Privileged().size
    settings = {"steps": 1, "algo": algo, algo: {"asymmetric_critic": True}}
    config = TrainConfig.model_validate(settings).hyperparameters
    policy = config.implementation().make_policy(config, layout)
    seen = torch.rand(4, layout.size)
    one, two = (torch.cat([seen, torch.full((4, more), value)], dim=1) for value in (0.0, 1.0))
    actor = actor_of(policy)
    memory = [torch.zeros(4, actor.memory_size)] if actor.memory_size else []
    answers = [actor(o, *memory) for o in (one, two, seen)]
    answers = [a[0] if isinstance(a, tuple) else a for a in answers]
    assert torch.equal(answers[0], answers[1])
    assert torch.equal(answers[0], answers[2])
    assert not torch.allclose(values(policy, one), values(policy, two))


def values(policy, observation):
    action = torch.zeros(len(observation), 2)
    if hasattr(policy, "lstm_actor"):
        state = (torch.zeros(1, len(observation), policy.lstm_output_dim),) * 2
        return policy.predict_values(observation, state, torch.zeros(len(observation)))
    if hasattr(policy, "predict_values"):
        return policy.predict_values(observation)
    answer = policy.critic(observation, action)
    return answer[0] if isinstance(answer, tuple) else answer
