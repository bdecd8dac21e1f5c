"""Nav2's planner server, or another server of ComputePathToPose, as the source of routes."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.parameters import FRAME, MAP, PLANNER, SetupError
from ator_ros.nodes.qos import ACTION_QUEUES
from ator_ros.nodes.remote_messages import RemoteError, action_type
from ator_ros.printable import quoted
from ator_ros.refinement import RefinementError

PLANNER_TYPE = "nav2_msgs/action/ComputePathToPose"
"""Of the action of a planner server."""
_PATH_TIMEOUT = 1.0  # real s for each path that a request to refinement needs
# real s before an interrupted request is repeated: first, doubled each time, and at most
_FIRST_PAUSE = 0.05
_LONGEST_PAUSE = 1.0
# The answers that there is no path. Nav2's server ends a request without any if another client,
# such as bt_navigator, sends one, or cancels all; TIMEOUT and TF_ERROR may pass, too.
_NO_PATH = (
    "START_OUTSIDE_MAP",
    "GOAL_OUTSIDE_MAP",
    "START_OCCUPIED",
    "GOAL_OCCUPIED",
    "NO_VALID_PATH",
)
_ENDS_WITHIN = 1.0  # m between a place and the end of its path; Nav2's planners allow 0.5 m


class PlannerClient:
    """The client of a planner server.

    It has a node and an executor, so that it can be called within callbacks. Raises RemoteError if
    the type of the action is not installed.

    Parameters
    ----------
    name : str
        The action, of type nav2_msgs/ComputePathToPose.
    frame : str
        The frame of the map, in which places and paths are.
    timeout : float
        Longest wait for the server, for each of its answers, and for the end of a request that it
        interrupts, in real s.
    """

    def __init__(self, name: str, frame: str, timeout: float) -> None:
        self._name = name
        self._frame = frame
        self._timeout = timeout
        kind = action_type(PLANNER_TYPE)
        self._no_path = [getattr(kind.Result, name, None) for name in _NO_PATH]
        self._node = Node(
            "path_planner", start_parameter_services=False, use_global_arguments=False
        )
        self._client = ActionClient(self._node, kind, name, **ACTION_QUEUES)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._was_called = False

    def __str__(self) -> str:
        return self._name

    def __call__(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the path between two places in m, shape (n, 2), or None if the server finds none.

        A request that the server interrupts is repeated. Raises RefinementError if the server is
        missing, rejects the goal, does not answer in time, interrupts all requests, or answers with
        an unusable path.
        """
        # At the first call, DDS may still be connecting the server. Later calls do not wait.
        discovery_timeout = 0.0 if self._was_called else self._timeout
        self._was_called = True
        if not self._client.wait_for_server(discovery_timeout):
            raise RefinementError(
                f"planner: expected the action server {self._name}, got none; "
                "start Nav2's planner_server"
            )
        end = time.monotonic() + self._timeout
        pause = _FIRST_PAUSE
        while (answer := self._request(start, goal)).status != GoalStatus.STATUS_SUCCEEDED:
            code = answer.result.error_code
            if answer.status == GoalStatus.STATUS_ABORTED and code in self._no_path:
                return None
            if time.monotonic() + pause > end:
                ended = "canceled" if answer.status == GoalStatus.STATUS_CANCELED else "aborted"
                raise RefinementError(
                    f"planner: {self._name} {ended} all requests for {self._timeout:g} s "
                    f"(error code {code}); if another client uses it, such as a driving Nav2, "
                    "try again later"
                )
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)
        return path_from(answer.result.path, start, goal, name=self._name, frame=self._frame)

    def _request(self, start: tuple[float, float], goal: tuple[float, float]) -> Any:
        """Return the server's answer to a request, of any status.

        Raises RefinementError without one.
        """
        request = planner_goal(self._frame, Pose(*start, 0.0), Pose(*goal, 0.0))
        handle = self._answer(self._client.send_goal_async(request))
        if handle is None:
            raise self._unanswered(start, goal)
        if not handle.accepted:
            raise RefinementError(f"planner: {self._name} rejected the goal; is it active?")
        answer = self._answer(handle.get_result_async())
        if answer is None:
            handle.cancel_goal_async()
            raise self._unanswered(start, goal)
        return answer

    def _answer(self, future: Any) -> Any:
        """Return what a request was answered, None if it was not."""
        self._executor.spin_until_future_complete(future, self._timeout)
        return future.result() if future.done() else None

    def _unanswered(self, start: tuple[float, float], goal: tuple[float, float]) -> RefinementError:
        wanted = f"a path {_between(start, goal)} of {self._name} within {self._timeout:g} s"
        return RefinementError(f"planner: expected {wanted}, got none")


def planner_goal(frame: str, start: Pose, goal: Pose) -> Any:
    """Return the goal of nav2_msgs/ComputePathToPose for a path between two poses in a frame."""
    header = Header(frame_id=frame)
    return action_type(PLANNER_TYPE).Goal(
        use_start=True,
        start=PoseStamped(header=header, pose=pose_of(start)),
        goal=PoseStamped(header=header, pose=pose_of(goal)),
    )


def path_from(
    found: Path, start: Sequence[float], goal: Sequence[float], *, name: str, frame: str
) -> FloatArray:
    """Return the places of a path from `start` to `goal` in m, shape (n, 2).

    Raises RefinementError if the planner server `name` has sent one that is empty, has places that
    are not finite, is in another frame, or leads elsewhere.
    """
    path = np.array([(item.pose.position.x, item.pose.position.y) for item in found.poses])
    if not len(path) or not np.isfinite(path).all() or found.header.frame_id not in ("", frame):
        raise RefinementError(
            f"planner: expected a path of finite places in {frame} from {name}, "
            f"got {len(path)} places in {quoted(found.header.frame_id)}"
        )
    if max(math.dist(path[0], start), math.dist(path[-1], goal)) > _ENDS_WITHIN:
        raise RefinementError(
            f"planner: expected a path {_between(start, goal)}, "
            f"got one {_between(path[0], path[-1])}"
        )
    return path


def _between(start: Sequence[float], goal: Sequence[float]) -> str:
    return f"from x {start[0]:.2f} m, y {start[1]:.2f} m to x {goal[0]:.2f} m, y {goal[1]:.2f} m"


def planner_name(node: Node, settings: Mapping[str, Any], domain: Domain) -> str:
    """Return the full name of the action that the parameter `PLANNER` names.

    Empty if it names none. Raises SetupError if it is no name, or set without a map or without
    nav2_msgs.
    """
    name = settings[PLANNER.name]
    if not name:
        return ""
    if domain.grid is None and not settings[MAP.name]:
        raise SetupError("parameter planner: expected a map, too; set the parameter map")
    try:
        action_type(PLANNER_TYPE)
        return str(node.resolve_topic_name(name))
    except RemoteError as error:
        raise SetupError(f"parameter planner: {error}") from error
    except (ValueError, RuntimeError) as error:
        expected = "expected the name of an action"
        raise SetupError(f"parameter planner: {expected}, got {quoted(name)}") from error


def with_planner(
    node: Node, settings: Mapping[str, Any], domain: Domain, robot: Robot
) -> tuple[Domain, Robot]:
    """Return domain and robot as the parameter `PLANNER` of the node `refinement` asks for.

    If it names a planner server, their routes are its paths; else they are returned unchanged.
    Raises SetupError as `planner_name` does.
    """
    name = planner_name(node, settings, domain)
    if not name:
        return domain, robot
    domain = planned_by(name, settings[FRAME.name], domain, timeout=_PATH_TIMEOUT)
    return domain, domain.equip(robot)


def planned_by(name: str, frame: str, domain: Domain, *, timeout: float = 10.0) -> Domain:
    """Return the domain with the paths of a planner server as its routes; see `PlannerClient`.

    The tool `train` and the node `learning` call it with the default timeout, as training may wait.
    """
    client = PlannerClient(name, frame, timeout)
    return dataclasses.replace(domain, planner=lambda *_: client)
