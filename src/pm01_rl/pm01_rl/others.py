# SPDX-License-Identifier: Apache-2.0
"""Other nodes that would drive the same robot."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node

DISCOVERY_S = 1.0
"""A node that has just started does not see all others yet [s]."""
LEASE_S = 25.0
"""A node that was killed is seen for so long at most: DDS's lease, 10 to 20 s [s]."""


class Others:
    """Who else serves our actions and publishes commands, when last looked."""

    def __init__(self, node: Node, actions: Iterable[str], output: str, base_topic: str) -> None:
        """Look around ``node``, which serves ``actions`` and publishes commands on ``output``.

        ``base_topic`` is the topic that the base listens to. Where that is another one, whoever
        listens to ``output`` and publishes there passes our commands on, as a watchdog does.
        """
        self._node, self._actions = node, tuple(actions)
        self._output, self._base_topic = output, base_topic
        self.servers: list[str] = []
        """Nodes that serve one of the actions, too: one goal would start both."""
        self.publishers: list[str] = []
        """Nodes that command the base, too."""

    def sees_namesake(self) -> bool:
        """Look again for a server of our name: what is left of a killed one, or another one."""
        self.look()
        return self._node.get_fully_qualified_name() in self.servers

    @property
    def shared_actions(self) -> str | None:
        """Say who serves our actions, too, and what to do about it; None if nobody does."""
        if not self.servers:
            return None
        return (
            f"{' and '.join(self.servers)} also serves {' or '.join(self._actions)}, and one goal "
            "would start both; give ours other names, with navigate.launch.py by "
            "navigate_to_pose:=pm01/navigate_to_pose "
            "navigate_through_poses:=pm01/navigate_through_poses goal_pose:=pm01/goal_pose"
        )

    def look(self) -> None:
        """Look again."""
        statuses = (f"{action}/_action/status" for action in self._actions)
        self.servers = sorted({name for topic in statuses for name in self._publishers(topic)})
        self.look_for_publishers()

    def look_for_publishers(self) -> None:
        """Look again for those who command the base."""
        node = self._node
        output, base = map(node.resolve_topic_name, (self._output, self._base_topic))
        found = set(self._publishers(output))
        if base != output:
            passing = {_name(e) for e in node.get_subscriptions_info_by_topic(output)}
            found |= set(self._publishers(base)) - passing
        self.publishers = sorted(found)

    def _publishers(self, topic: str) -> list[str]:
        node = self._node
        names = [
            _name(e) for e in node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
        ]
        own = node.get_fully_qualified_name()
        if own in names:
            # Once only: another instance of this node has the same name.
            names.remove(own)
        return names


def _name(endpoint: object) -> str:
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
