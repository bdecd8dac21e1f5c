"""Paths of a running planner server, such as Nav2's, as the routes of drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray
from ator_ros.nodes.parameters import PLANNER
from ator_ros.nodes.remote_messages import action_type
from ator_ros.refinement import RefinementError
from ator_ros.robot.description import Robot

_PATIENCE = 5.0  # real s until a server or its answer counts as missing
_SUCCEEDED = 4  # action_msgs/GoalStatus


class PathPlanner:
    """The client of a planner server. It can be called within callbacks: it has a node and an executor.

    Parameters
    ----------
    name : str
        The action, of type nav2_msgs/ComputePathToPose.
    frame : str
        Of all places: that of the map.

    Raises
    ------
    RemoteError
        The type is not installed.
    """

    def __init__(self, name: str, frame: str = "map") -> None:
        self._name, self._frame = name, frame
        self._kind = action_type("nav2_msgs/action/ComputePathToPose")
        self._node = Node("path_planner", start_parameter_services=False, use_global_arguments=False)
        self._client = ActionClient(self._node, self._kind, name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def __str__(self) -> str:
        """Return the name of the action."""
        return self._name

    def __call__(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the path between two places in m, shape (n, 2), or None if the server finds none.

        Raises RefinementError if the server is missing or does not answer.
        """
        if not self._client.wait_for_server(_PATIENCE):
            raise RefinementError(f"planner: expected the action server {self._name}, there is none")
        request = self._kind.Goal(start=self._place(*start), goal=self._place(*goal), use_start=True)
        handle = self._result_of(self._client.send_goal_async(request))
        if not handle.accepted:
            return None
        answer = self._result_of(handle.get_result_async())
        path = [(item.pose.position.x, item.pose.position.y) for item in answer.result.path.poses]
        return np.array(path) if answer.status == _SUCCEEDED and len(path) > 1 else None

    def _place(self, x: float, y: float) -> PoseStamped:
        place = PoseStamped()
        place.header.frame_id = self._frame
        place.pose.position.x, place.pose.position.y = x, y
        return place

    def _result_of(self, future: Any) -> Any:
        self._executor.spin_until_future_complete(future, _PATIENCE)
        if not future.done():
            raise RefinementError(f"planner: expected an answer of {self._name} within {_PATIENCE:g} s")
        return future.result()


def with_planner(
    node: Node, settings: Mapping[str, Any], domain: Domain, robot: Robot
) -> tuple[Domain, Robot]:
    """Return domain and robot with the routes that the parameter `PLANNER` asks for; raises RemoteError."""
    name = settings[PLANNER.name]
    if not name:
        return domain, robot
    client = PathPlanner(node.resolve_topic_name(name), settings["frame"])
    domain = dataclasses.replace(domain, planner=lambda *_: client)
    return domain, domain.equip(robot)
