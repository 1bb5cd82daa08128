# SPDX-License-Identifier: Apache-2.0
"""Our Adam is torch's Adam, and starts faster."""

from __future__ import annotations

import subprocess
import sys

import torch

from pm01_nav.training.optimizer import EagerAdam


def trained(make: type[torch.optim.Adam], steps: int) -> tuple[torch.nn.Module, torch.optim.Adam]:
    torch.manual_seed(0)
    network = torch.nn.Linear(3, 2)
    optimizer = make(network.parameters(), lr=0.1, eps=1e-5)
    inputs = torch.randn(8, 3)
    for _ in range(steps):
        optimizer.zero_grad()
        network(inputs).square().mean().backward()
        optimizer.step()
    return network, optimizer


def test_it_learns_bit_for_bit_what_adam_learns() -> None:
    ours, optimizer = trained(EagerAdam, 5)
    theirs, reference = trained(torch.optim.Adam, 5)
    for mine, other in zip(ours.parameters(), theirs.parameters(), strict=True):
        assert torch.equal(mine, other)
    assert optimizer.state_dict()["state"][0]["step"] == 5
    # Checkpoints of one are those of the other.
    optimizer.load_state_dict(reference.state_dict())


def test_parameters_do_not_remember_the_step() -> None:
    network, _ = trained(EagerAdam, 1)
    assert all(parameter.grad_fn is None for parameter in network.parameters())


def test_the_compiler_is_not_loaded() -> None:
    code = """
import sys, torch
from stable_baselines3 import PPO
from pm01_nav.training.optimizer import EagerAdam
optimizer = EagerAdam(torch.nn.Linear(1, 1).parameters())
optimizer.zero_grad()
optimizer.step()
optimizer.load_state_dict(optimizer.state_dict())
print("torch._dynamo" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
