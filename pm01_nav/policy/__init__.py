# SPDX-License-Identifier: Apache-2.0
"""Policies: the exported file and how to run it. ``OnnxPolicy`` needs numpy and onnxruntime."""

from pm01_nav.policy.onnx_policy import OnnxPolicy
from pm01_nav.policy.protocol import Policy

__all__ = ["OnnxPolicy", "Policy"]
