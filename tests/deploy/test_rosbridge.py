# SPDX-License-Identifier: Apache-2.0
"""Driving through a real websocket server that speaks rosbridge's protocol, on loopback."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

pytest.importorskip("roslibpy")
websockets = pytest.importorskip("websockets.sync.server")

from roslibpy.core import RosTimeoutError  # noqa: E402

from pm01_nav.deploy.link import Inbox, Topics  # noqa: E402
from pm01_nav.deploy.rosbridge import RosbridgeLink  # noqa: E402
from pm01_nav.errors import InputError  # noqa: E402

ODOMETRY = {
    "header": {"stamp": {"sec": 5, "nanosec": 500_000_000}, "frame_id": "odom"},
    "pose": {
        "pose": {
            "position": {"x": 1.0, "y": 2.0, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
    },
    "twist": {"twist": {"linear": {"x": 0.25}, "angular": {"z": None}}},
}


class Bridge:
    """The part of rosbridge that a drive uses: subscribe, advertise, publish."""

    def __init__(self, port: int = 0) -> None:
        self.heard: list[dict[str, Any]] = []
        self.clients: list[Any] = []
        self.echoes = True
        self._server = websockets.serve(self._serve, "127.0.0.1", port)
        self.port = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _serve(self, client: Any) -> None:
        self.clients.append(client)
        for text in client:
            self.heard.append(message := json.loads(text))
            if message["op"] == "publish" and message["topic"].endswith("/echo") and self.echoes:
                self.publish(message["topic"], message["msg"])

    def publish(self, topic: str, message: Any) -> None:
        self.clients[-1].send(json.dumps({"op": "publish", "topic": topic, "msg": message}))

    def operations(self, op: str) -> list[str]:
        return [message["topic"] for message in self.heard if message["op"] == op]

    def close(self) -> None:
        for client in self.clients:
            client.close()
        self._server.shutdown()


def until(condition, seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.02)
    return False


@pytest.fixture(scope="module")
def session():
    """One link and its server: twisted's reactor starts only once in a process."""
    bridge = Bridge()
    link, inbox = RosbridgeLink(f"ws://127.0.0.1:{bridge.port}", Topics()), Inbox()
    link.open(inbox)
    assert until(lambda: "/odom" in bridge.operations("subscribe"))
    yield bridge, link, inbox
    link.close()
    bridge.close()


def test_messages_come_and_commands_go(session):
    bridge, link, inbox = session
    bridge.publish("/odom", ODOMETRY)
    (event,) = inbox.take(5.0)
    assert event.kind == "odometry"
    assert event.message.twist.twist.linear.x == 0.25
    # JSON's null is a number that is none.
    assert event.message.twist.twist.angular.z != event.message.twist.twist.angular.z
    assert until(lambda: "/cmd_vel" in bridge.operations("advertise"))
    link.tell((0.3, -0.5))
    assert until(lambda: "/cmd_vel" in bridge.operations("publish"))
    sent = next(m["msg"] for m in bridge.heard if m.get("topic") == "/cmd_vel" and "msg" in m)
    assert sent["linear"]["x"] == 0.3
    assert sent["angular"]["z"] == -0.5


def test_a_bridge_that_falls_behind_is_noticed(session):
    bridge, link, _ = session

    def told() -> bool:
        link.tell((0.1, 0.0))
        return link.age() < 0.4

    assert until(told)
    bridge.echoes = False
    time.sleep(0.5)
    link.tell((0.1, 0.0))
    # What was sent before the bridge fell behind is half a second old, whatever is sent now.
    assert link.age() >= 0.5
    bridge.echoes = True
    assert until(told)


def test_no_press_of_the_emergency_stop_falls_out_of_a_queue(session):
    bridge, _, _ = session
    queues = {m["topic"]: m["queue_length"] for m in bridge.heard if m["op"] == "subscribe"}
    # Of a state only the newest counts; a press that is followed by a release must arrive, too.
    assert queues["/scan"] == 1
    assert queues["/emergency_stop"] == 0


def test_a_lost_connection_comes_back(session):
    bridge, link, inbox = session
    bridge.clients[-1].close()
    assert until(lambda: link.losses == 1)
    assert not inbox.take(0.0)
    link.tell((0.4, 0.0))
    assert until(lambda: len(bridge.clients) == 2)
    assert until(lambda: bridge.operations("subscribe").count("/odom") == 2)
    bridge.publish("/odom", ODOMETRY)
    assert until(lambda: [event.kind for event in inbox.take(0.0)] == ["odometry"])
    # What was said meanwhile must not be sent now: it would come seconds too late.
    sent = [m["msg"] for m in bridge.heard if m["op"] == "publish" and m["topic"] == "/cmd_vel"]
    assert 0.4 not in [message["linear"]["x"] for message in sent]


def test_who_leaves_takes_back_what_it_asked_for(session):
    bridge, link, _ = session
    asked = set(bridge.operations("subscribe"))
    link.close()
    assert until(lambda: set(bridge.operations("unsubscribe")) == asked)
    link.close()


def test_a_bridge_that_hangs_is_left_nevertheless():
    class Hanging:
        is_connected = False
        factory = type("Factory", (), {"stopTrying": staticmethod(lambda: None)})

        def close(self) -> None:
            raise RosTimeoutError("Failed to disconnect to ROS")

    link = RosbridgeLink("ws://127.0.0.1:9090", Topics())
    link._ros = Hanging()
    link.close()
    assert link._ros is None


@pytest.mark.parametrize("url", ["http://127.0.0.1:9090", "127.0.0.1:9090", "ws://"])
def test_what_is_no_websocket_is_refused(url):
    with pytest.raises(InputError, match="must look like ws://"):
        RosbridgeLink(url, Topics())


def test_the_command_line_wants_one_way():
    code = "from pm01_nav.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "drive", "no.onnx"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
