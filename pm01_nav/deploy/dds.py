# SPDX-License-Identifier: Apache-2.0
"""Speak ROS 2's DDS directly, without ROS: PyPI's ``cyclonedds`` is all it takes."""

from __future__ import annotations

import ipaddress
import os
import threading
from typing import Any

from pm01_nav.deploy.link import Inbox, Topics
from pm01_nav.deploy.messages import ros_twist
from pm01_nav.deploy.safety import Command
from pm01_nav.errors import InputError

WAIT_NS = 100_000_000
"""The reading thread looks up at least this often [ns]."""
LOOPBACK = "127.0.0.1"


def dds_config(address: str, peers: tuple[str, ...]) -> str:
    """Return Cyclone DDS's configuration: which interface, and whom to look for.

    ``address`` is this machine's on the robot's network. On loopback there is no multicast, so
    peers are named there.

    Raises:
        InputError: something is no IP address, or a peer is beyond loopback and the interface not.
    """
    local = _is_loopback(address)
    if not all([_is_loopback(peer) for peer in peers]) and local:
        raise InputError(
            f"dds: peer {peers[0]} cannot be reached from {address}; give --dds-address, this "
            "machine's own address on the robot's network"
        )
    named = "".join(
        f'<Peer address="{peer}"/>' for peer in (peers or (LOOPBACK,) if local else peers)
    )
    multicast = "false" if local else "spdp"
    return (
        "<CycloneDDS><Domain><General>"
        f'<Interfaces><NetworkInterface address="{address}"/></Interfaces>'
        f"<AllowMulticast>{multicast}</AllowMulticast></General>"
        "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>99</MaxAutoParticipantIndex><Peers>{named}</Peers></Discovery>"
        "</Domain></CycloneDDS>"
    )


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError as error:
        raise InputError(f"dds: {address!r}: must be an IP address") from error


class DdsLink:
    """A robot's topics over DDS. It finds the robot, and finds it again, by DDS's own discovery."""

    def __init__(
        self,
        topics: Topics,
        *,
        domain: int | None = None,
        address: str = LOOPBACK,
        peers: tuple[str, ...] = (),
    ) -> None:
        """Prepare for a DDS ``domain``, by default that of ROS_DOMAIN_ID.

        Raises:
            InputError: cyclonedds is missing, or an address is none.
        """
        try:
            import cyclonedds  # noqa: F401
        except ImportError as error:
            raise InputError("cyclonedds is missing: pip install 'pm01-nav[dds]'") from error
        self.topics = topics
        self._domain = _domain_from_environment() if domain is None else domain
        self._config = dds_config(address, peers)
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._writer: Any = None

    def open(self, inbox: Inbox) -> None:
        """Join the domain and listen."""
        from cyclonedds.core import Qos, ReadCondition, WaitSet
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        from pm01_nav.deploy import dds_types as types

        self._entity = Domain(self._domain, self._config)
        participant = DomainParticipant(self._domain)
        topics = self.topics
        latest, kept = Qos(best_effort(), keep_last(5)), Qos(reliable(), keep_last(10))
        latched = Qos(reliable(), keep_last(1), transient_local())
        # The clock is read first: what follows may be as new as the clock, not newer by much.
        # A button that latches its state is asked for it, one that does not would not answer that.
        sources = (
            ("clock", topics.clock, types.Clock, latest),
            ("scan", topics.scan, types.LaserScan, latest),
            ("odometry", topics.odometry, types.Odometry, latest),
            ("goal", topics.goal, types.PoseStamped, kept),
            ("emergency_stop", topics.emergency_stop, types.Bool, kept),
            ("emergency_stop", topics.emergency_stop, types.Bool, latched),
        )
        self._waiting: Any = WaitSet(participant)
        self._readers: list[tuple[str, Any]] = []
        for kind, name, message, qos in sources:
            reader = DataReader(participant, Topic(participant, f"rt/{name}", message), qos=qos)
            self._waiting.attach(ReadCondition(reader, any_state()))
            self._readers.append((kind, reader))
        command = types.TwistStamped if topics.stamped else types.Twist
        topic = Topic(participant, f"rt/{topics.command}", command)
        self._writer = DataWriter(participant, topic, qos=Qos(reliable(), keep_last(1)))
        self._types, self._participant = types, participant
        self._thread = threading.Thread(target=self._read, args=(inbox,), daemon=True)
        self._thread.start()

    def _read(self, inbox: Inbox) -> None:
        while not self._ended.is_set():
            self._waiting.wait(WAIT_NS)
            for kind, reader in self._readers:
                for sample in reader.take(100):
                    # A writer that leaves sends a sample without data.
                    if not hasattr(sample, "sample_info") or sample.sample_info.valid_data:
                        inbox.put(kind, sample)

    def tell(self, command: Command) -> None:
        """Send a command to whoever listens."""
        if self._writer is None:
            return
        types, (x, y, yaw) = self._types, ros_twist(command)
        twist = types.Twist(types.Vector3(x=x, y=y), types.Vector3(z=yaw))
        self._writer.write(types.TwistStamped(twist=twist) if self.topics.stamped else twist)

    def age(self) -> float:
        """Return 0: there is nothing between the robot and us that would queue."""
        return 0.0

    def close(self) -> None:
        """Leave the domain."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        self._writer = None
        self._readers.clear()
        self._waiting = self._participant = self._entity = None


def best_effort() -> Any:
    """Take what comes from any writer, reliable or not."""
    from cyclonedds.core import Policy

    return Policy.Reliability.BestEffort


def reliable() -> Any:
    """Send again what was lost: readers may ask for that."""
    from cyclonedds.core import Policy
    from cyclonedds.util import duration

    return Policy.Reliability.Reliable(duration(milliseconds=100))


def keep_last(count: int) -> Any:
    """Keep so many messages, not more."""
    from cyclonedds.core import Policy

    return Policy.History.KeepLast(count)


def transient_local() -> Any:
    """Ask for what was said before, too."""
    from cyclonedds.core import Policy

    return Policy.Durability.TransientLocal


def any_state() -> int:
    """Wait for messages of any kind."""
    from cyclonedds.core import InstanceState, SampleState, ViewState

    return ViewState.Any | InstanceState.Any | SampleState.NotRead


def _domain_from_environment() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "0")
    if not text.isdigit() or int(text) > 232:
        raise InputError(f"ROS_DOMAIN_ID = {text!r}: must be a number from 0 to 232")
    return int(text)
