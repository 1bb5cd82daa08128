# SPDX-License-Identifier: Apache-2.0
"""Drive through rosbridge, from a machine with no ROS: PyPI's ``roslibpy`` is all it takes."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any
from urllib.parse import urlsplit
from uuid import uuid4

from pm01_nav.deploy.link import Inbox, Topics
from pm01_nav.deploy.messages import from_json, ros_twist
from pm01_nav.deploy.safety import Command
from pm01_nav.errors import InputError

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 5.0
"""Between two tries to reconnect; each pause is about 2.7 times the last."""
PING_S = 1.0
"""A server that leaves a ping unanswered for this long is gone, even if nothing said so."""


class RosbridgeLink:
    """A robot's topics over a websocket to rosbridge.

    The bridge handles one message after the other and queues what it cannot keep up with, so what
    comes may be late without being seen to be: in simulated time its clock is late, too. With each
    command goes a number to a topic of ours; when it comes back tells how late the bridge is.
    """

    def __init__(self, url: str, topics: Topics) -> None:
        """Prepare to connect to ``url``, such as ws://127.0.0.1:9090.

        Raises:
            InputError: roslibpy is missing, or that is no address of a websocket.
        """
        try:
            import roslibpy  # noqa: F401
        except ImportError as error:
            raise InputError("roslibpy is missing: pip install 'pm01-nav[rosbridge]'") from error
        parts = urlsplit(url)
        if parts.scheme not in ("ws", "wss") or not parts.hostname:
            raise InputError(f"rosbridge = {url!r}: must look like ws://127.0.0.1:9090")
        self.url = url
        self.topics = topics
        self.losses = 0
        """How often the connection was lost."""
        self._ros: Any = None
        self._commands: Any = None
        self._echoes: Any = None
        self._heard: list[Any] = []
        self._echoed = -math.inf
        """When the newest number was sent that came back, by the monotonic clock [s]."""

    def open(self, inbox: Inbox) -> None:
        """Begin to connect, and go on until it works, now and after every loss."""
        import roslibpy

        self._ros = ros = roslibpy.Ros(self.url, transport="twisted")
        factory: Any = ros.factory
        factory.initialDelay = factory.delay = FIRST_PAUSE_S
        factory.maxDelay = LONGEST_PAUSE_S
        factory.setProtocolOptions(autoPingInterval=PING_S, autoPingTimeout=PING_S)
        ros.on("close", self._on_close)
        topics = self.topics
        for kind, name, message, kept in (
            ("clock", topics.clock, "rosgraph_msgs/Clock", 1),
            ("scan", topics.scan, "sensor_msgs/LaserScan", 1),
            ("odometry", topics.odometry, "nav_msgs/Odometry", 1),
            # Of these each counts: 0 is no queue, so nothing falls out of it.
            ("goal", topics.goal, "geometry_msgs/PoseStamped", 0),
            ("emergency_stop", topics.emergency_stop, "std_msgs/Bool", 0),
        ):
            topic = roslibpy.Topic(ros, f"/{name}", message, queue_length=kept)
            topic.subscribe(_putter(inbox, kind))
            self._heard.append(topic)
        kind = "geometry_msgs/TwistStamped" if topics.stamped else "geometry_msgs/Twist"
        self._commands = roslibpy.Topic(ros, f"/{topics.command}", kind, queue_size=1)
        self._commands.advertise()
        name = f"/pm01_drive_{uuid4().hex}/echo"
        self._echoes = roslibpy.Topic(ros, name, "std_msgs/Float64", queue_length=1, queue_size=1)
        self._echoes.advertise()
        self._echoes.subscribe(self._hear_echo)
        self._heard.append(self._echoes)
        factory.manager.run()

    def _hear_echo(self, message: dict[str, Any]) -> None:
        self._echoed = max(self._echoed, float(message["data"]))

    def age(self) -> float:
        """Return how long ago the newest number was sent that has come back [s]."""
        return time.monotonic() - self._echoed

    def _on_close(self, _: Any) -> None:
        self.losses += 1

    def tell(self, command: Command) -> None:
        """Send a command, unless there is no connection: kept ones would come much too late."""
        if self._ros is None or not self._ros.is_connected:
            return
        x, y, yaw = ros_twist(command)
        twist = {
            "linear": {"x": x, "y": y, "z": 0.0},
            "angular": {"x": 0.0, "y": 0.0, "z": yaw},
        }
        if self.topics.stamped:
            header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base_link"}
            twist = {"header": header, "twist": twist}
        self._commands.publish(twist)
        self._echoes.publish({"data": time.monotonic()})

    def close(self) -> None:
        """Disconnect for good."""
        from roslibpy.core import RosTimeoutError

        if self._ros is None:
            return
        self._ros.factory.stopTrying()
        if self._ros.is_connected:
            # Bridges have gone on sending to clients that left without a word, until they hung.
            for topic in self._heard:
                topic.unsubscribe()
        # A bridge that hangs does not confirm; we leave nevertheless.
        with suppress(RosTimeoutError):
            self._ros.close()
        self._heard.clear()
        self._ros = None


def _putter(inbox: Inbox, kind: str) -> Any:
    return lambda message: inbox.put(kind, from_json(message))
