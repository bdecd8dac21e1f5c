"""Whether action servers execute goals, by the statuses that they publish."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.node import Node

from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.subscriptions import PolledTopic

_ACTIVE = (
    GoalStatus.STATUS_ACCEPTED,
    GoalStatus.STATUS_EXECUTING,
    GoalStatus.STATUS_CANCELING,
)


class ServerStatuses:
    """The goals that action servers execute, whoever sent them.

    The servers need not run. It works without an executor, also within callbacks.

    Parameters
    ----------
    node : Node
        Has the subscriptions.
    servers : iterable of str
        Names of the actions.
    """

    def __init__(self, node: Node, servers: Iterable[str]) -> None:
        self._node = node
        self._servers = {name: _Server(node, name) for name in dict.fromkeys(servers)}

    def busy(self, own: Collection[bytes] = ()) -> str:
        """Return the first server that executes a goal, except those with the ids `own`.

        Empty if none does.
        """
        for name, server in self._servers.items():
            if server.active() - set(own):
                return name
        return ""


class _Server:
    """The goals of one server, by its newest status message."""

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._topic = f"{name}/_action/status"
        self._status = PolledTopic(node, GoalStatusArray, self._topic, LATCHED)
        self._active: set[bytes] = set()
        self._publishers: set[bytes] = set()

    def active(self) -> set[bytes]:
        """Return the ids of the goals that the server executes; none if it has ended."""
        message = self._status.take()
        if message is None and not self._active:
            return self._active
        publishers = {
            bytes(info.endpoint_gid)
            for info in self._node.get_publishers_info_by_topic(self._topic)
        }
        if message is not None:
            self._publishers = publishers
            self._active = {
                bytes(goal.goal_info.goal_id.uuid)
                for goal in message.status_list
                if goal.status in _ACTIVE
            }
        elif publishers.isdisjoint(self._publishers):  # it has ended, or was started again
            self._active = set()
        return self._active
