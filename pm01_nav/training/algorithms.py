# SPDX-License-Identifier: Apache-2.0
"""The table of algorithms: their names, and where each one is. A new one is a line here.

A module is imported when its algorithm is asked for, since each second of a short training counts.
"""

from __future__ import annotations

from importlib import import_module

from pm01_nav.training.learner import Algorithm

ALGORITHMS = {
    "ppo": ("ppo", "PPO_ALGORITHM"),
    "ppo_lstm": ("ppo_lstm", "PPO_LSTM_ALGORITHM"),
    "sac": ("off_policy", "SAC_ALGORITHM"),
    "td3": ("off_policy", "TD3_ALGORITHM"),
    "tqc": ("off_policy", "TQC_ALGORITHM"),
}
"""Name -> module of ``pm01_nav.training`` and what it is called there."""


def algorithm(name: str) -> Algorithm:
    """Return an algorithm by its name."""
    module, attribute = ALGORITHMS[name]
    return getattr(import_module(f"pm01_nav.training.{module}"), attribute)
