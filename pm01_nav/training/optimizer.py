# SPDX-License-Identifier: Apache-2.0
"""The optimizer of PPO."""

from __future__ import annotations

from typing import Any

import torch


def _plain(method: Any) -> Any:
    """Return a method of an optimizer without what torch wraps around it for its compiler."""
    return getattr(method, "__wrapped__", method)


class EagerAdam(torch.optim.Adam):
    """Adam that does not load torch's compiler, which takes two seconds of every start.

    torch 2 imports it when the first optimizer is made, only to tell it not to compile that.
    """

    step = torch.no_grad()(_plain(torch.optim.Adam.step))
    zero_grad = _plain(torch.optim.Adam.zero_grad)
    add_param_group = _plain(torch.optim.Adam.add_param_group)
    state_dict = _plain(torch.optim.Adam.state_dict)
    load_state_dict = _plain(torch.optim.Adam.load_state_dict)
