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
from ator_ros.nodes.parameters import FRAME, MAP, PLANNER, SetupError
from ator_ros.nodes.remote_messages import RemoteError, action_type
from ator_ros.printable import quoted
from ator_ros.refinement import RefinementError
from ator_ros.robot.description import Robot

LONGEST_PLAN = 10.0
"""Longest wait in real s for a path that is learned from."""
_LONGEST_REQUEST = 1.0  # real s for each path of a request to refinement
_DISCOVERY_TIMEOUT = 1.0  # real s until a server counts as missing; DDS may still be connecting it
_SUCCEEDED = 4  # action_msgs/GoalStatus


class PathPlanner:
    """The client of a planner server. It can be called within callbacks: it has a node and an executor.

    Parameters
    ----------
    name : str
        The action, of type nav2_msgs/ComputePathToPose.
    frame : str
        The frame of the map, in which places and paths are.
    timeout : float
        Longest wait for each answer in real s.

    Raises
    ------
    RemoteError
        The type is not installed.
    """

    def __init__(self, name: str, frame: str, timeout: float) -> None:
        self._name, self._frame, self._timeout = name, frame, timeout
        self._kind = action_type("nav2_msgs/action/ComputePathToPose")
        self._node = Node("path_planner", start_parameter_services=False, use_global_arguments=False)
        self._client = ActionClient(self._node, self._kind, name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._was_ready = False

    def __str__(self) -> str:
        """Return the name of the action."""
        return self._name

    def __call__(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the path between two places in m, shape (n, 2), or None if the server finds none.

        Raises RefinementError if the server is missing, rejects the goal, does not answer in time, or answers
        with an unusable path.
        """
        patience = 0.0 if self._was_ready else _DISCOVERY_TIMEOUT
        if not (self._client.server_is_ready() or self._client.wait_for_server(patience)):
            self._was_ready = True
            raise RefinementError(
                f"planner: expected the action server {self._name}, got none; start Nav2's planner_server"
            )
        self._was_ready = True
        request = self._kind.Goal(start=self._pose_stamped(*start), goal=self._pose_stamped(*goal))
        request.use_start = True
        handle = self._answer(self._client.send_goal_async(request))
        if handle is None:
            raise self._unanswered(start, goal)
        if not handle.accepted:
            raise RefinementError(f"planner: {self._name} rejected the goal; is it active?")
        answer = self._answer(handle.get_result_async())
        if answer is None:
            handle.cancel_goal_async()
            raise self._unanswered(start, goal)
        if answer.status != _SUCCEEDED:
            return None
        found = answer.result.path
        path = np.array([(item.pose.position.x, item.pose.position.y) for item in found.poses])
        if len(path) < 2 or not np.isfinite(path).all() or found.header.frame_id not in ("", self._frame):
            raise RefinementError(
                f"planner: expected a path of finite places in {self._frame} from {self._name}, got "
                f"{len(path)} places in {quoted(found.header.frame_id)}"
            )
        return path

    def _pose_stamped(self, x: float, y: float) -> PoseStamped:
        place = PoseStamped()
        place.header.frame_id = self._frame
        place.pose.position.x, place.pose.position.y = x, y
        return place

    def _answer(self, future: Any) -> Any:
        """Return what a request was answered, None if it was not."""
        self._executor.spin_until_future_complete(future, self._timeout)
        return future.result() if future.done() else None

    def _unanswered(self, start: tuple[float, float], goal: tuple[float, float]) -> RefinementError:
        places = " to ".join(f"x {x:.2f} m, y {y:.2f} m" for x, y in (start, goal))
        return RefinementError(
            f"planner: expected a path of {self._name} from {places} within {self._timeout:g} s, got none"
        )


def with_planner(
    node: Node, settings: Mapping[str, Any], domain: Domain, robot: Robot
) -> tuple[Domain, Robot]:
    """Return domain and robot with the routes that the parameter `PLANNER` asks for; raises SetupError."""
    name = settings[PLANNER.name]
    if not name:
        return domain, robot
    if domain.grid is None and not settings[MAP.name]:
        raise SetupError("parameter planner: expected a map, too; set the parameter map")
    try:
        client = PathPlanner(node.resolve_topic_name(name), settings[FRAME.name], _LONGEST_REQUEST)
    except RemoteError as error:
        raise SetupError(f"parameter planner: {error}") from error
    domain = dataclasses.replace(domain, planner=lambda *_: client)
    return domain, domain.equip(robot)
