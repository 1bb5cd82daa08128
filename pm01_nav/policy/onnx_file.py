# SPDX-License-Identifier: Apache-2.0
"""Take from an ONNX file what its exporter left: source lines, paths of its machine, notes."""

from __future__ import annotations

import json
from typing import Any

import onnx
from google.protobuf.message import Message

from pm01_nav.policy.onnx_policy import METADATA_KEY
from pm01_nav.provenance import shown

LEFT_BY_EXPORTER = ("metadata_props", "doc_string", "producer_name", "producer_version")


def set_metadata(model: onnx.ModelProto, metadata: dict[str, Any]) -> None:
    """Leave ``metadata`` in a model and nothing else that is not the network.

    Nodes, values, graphs and functions carry stack traces of the exporting machine. Outputs stay
    the same, bit by bit.
    """
    _clear(model)
    model.metadata_props.add(key=METADATA_KEY, value=json.dumps(shown(metadata)))


def cleaned(content: bytes, metadata: dict[str, Any]) -> bytes:
    """Return a policy's file, whose metadata is given, without what it tells of a machine."""
    model = onnx.ModelProto.FromString(content)
    set_metadata(model, metadata)
    return model.SerializeToString()


def _clear(message: Message) -> None:
    for field, value in message.ListFields():
        if field.name in LEFT_BY_EXPORTER:
            message.ClearField(field.name)
        elif field.message_type is not None:
            for each in [value] if isinstance(value, Message) else value:
                _clear(each)
