# SPDX-License-Identifier: Apache-2.0
"""The emergency stop as a topic and a service: pressed as long as either presses it."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from pm01_rl.running import LATCHED, NO_EVENTS


class EmergencyStop:
    """Who presses the emergency stop of a node, in every state of its."""

    def __init__(self, node: Node, on_change: Callable[[bool, str], None]) -> None:
        """Listen on ``node``; ``on_change`` hears whether a source presses it, and which."""
        self.sources: set[str] = set()
        """Who presses it; no change of state releases it."""
        self._on_change = on_change
        # A button that latches its state is asked for it; one that does not would not answer that.
        for qos in (QoSProfile(depth=10), LATCHED):
            node.create_subscription(
                Bool, "emergency_stop", self._on_topic, qos, event_callbacks=NO_EVENTS
            )
        node.create_service(SetBool, "~/emergency_stop", self._on_service)

    @property
    def pressed(self) -> bool:
        """Whether anybody presses it."""
        return bool(self.sources)

    def _on_topic(self, message: Bool) -> None:
        self._press(message.data, "topic")

    def _on_service(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._press(request.data, "service")
        response.success = request.data or not self.pressed
        response.message = "released; send a new goal to go on"
        if self.pressed:
            response.message = f"pressed by {' and '.join(sorted(self.sources))}"
        return response

    def _press(self, pressed: bool, source: str) -> None:
        """Press or release it for one source: each releases only its own."""
        (self.sources.add if pressed else self.sources.discard)(source)
        self._on_change(pressed, source)
