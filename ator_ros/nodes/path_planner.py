"""Nav2's planner server, or another server of ComputePathToPose, as the source of routes."""

from __future__ import annotations

import dataclasses
import math
import time
import uuid
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any

import numpy as np
from action_msgs.msg import GoalInfo, GoalStatus
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
from ator_ros.nodes.server_statuses import ServerStatuses
from ator_ros.printable import quoted
from ator_ros.refinement import RefinementError
from ator_ros.world.grid_map import PlannerBusyError

PLANNER_TYPE = "nav2_msgs/action/ComputePathToPose"
"""Of the action of a planner server."""
NAVIGATORS = ("navigate_to_pose", "navigate_through_poses")
"""Nav2's actions that drive: they ask the planner every second."""
_PATH_TIMEOUT = 1.0  # real s for each path that a request to refinement needs
_TRAINING_TIMEOUT = 10.0  # real s for each path that training needs
# real s before an interrupted request is repeated: first, doubled each time, and at most
_FIRST_PAUSE = 0.05
_LONGEST_PAUSE = 1.0
_DISCOVERY = 0.5  # real s in which DDS connects the statuses of servers to a new client
_PATIENCE = 60.0  # real s for which training waits for the end of a drive
_LASTING = 0.1  # real s for which a server counts as busy without another look
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
    """The client of a planner server, which is asked only while it and its navigators are idle.

    Nav2's server executes one goal at a time: a request beside those of a drive may abort it. While
    a goal is executed, requests wait, or none is sent and PlannerBusyError is raised. It has a node
    and an executor, so that it can be called within callbacks. Raises RemoteError if the type of
    the action is not installed.

    Parameters
    ----------
    name : str
        The action, of type nav2_msgs/ComputePathToPose.
    frame : str
        The frame of the map, in which places and paths are.
    timeout : float
        Longest wait for the server, for each of its answers, for the end of other clients'
        requests, and for the end of a request that it interrupts, in real s.
    navigators : iterable of str
        The actions whose goals are drives that use the planner.
    patience : float
        Longest wait for the end of a drive, in real s. 0: do not wait, raise PlannerBusyError.

    Attributes
    ----------
    withheld : int
        Number of paths that were not requested.
    busy : str
        The server for which the last one of them was not requested.
    """

    def __init__(
        self,
        name: str,
        frame: str,
        timeout: float,
        navigators: Iterable[str] = (),
        patience: float = 0.0,
    ) -> None:
        self._name = name
        self._frame = frame
        self._timeout = timeout
        self._patience = patience
        kind = action_type(PLANNER_TYPE)
        self._no_path = [getattr(kind.Result, name, None) for name in _NO_PATH]
        self._node = Node(
            "path_planner", start_parameter_services=False, use_global_arguments=False
        )
        self._client = ActionClient(self._node, kind, name, **ACTION_QUEUES)
        self._statuses = ServerStatuses(self._node, (*navigators, name))
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._made_at = time.monotonic()
        self._was_called = False
        self._is_held = False
        self._own: deque[bytes] = deque(maxlen=10)  # ids of our last requests
        self._busy_until = -math.inf  # real s
        self.withheld = 0
        self.busy = ""

    def __str__(self) -> str:
        return self._name

    @contextmanager
    def held(self) -> Iterator[None]:
        """Send no request within: PlannerBusyError is raised."""
        self._is_held = True
        try:
            yield
        finally:
            self._is_held = False

    def __call__(self, start: tuple[float, float], goal: tuple[float, float]) -> FloatArray | None:
        """Return the path between two places in m, shape (n, 2), or None if the server finds none.

        A request that the server interrupts is repeated. Raises RefinementError if the server is
        missing, rejects the goal, does not answer in time, interrupts all requests, or answers with
        an unusable path; PlannerBusyError or RefinementError if a navigator executes a goal.
        """
        if self._is_held:
            raise PlannerBusyError
        self._connect()
        end = time.monotonic() + self._timeout
        pause = _FIRST_PAUSE
        while True:
            self._wait_until_idle()
            answer = self._request(start, goal)
            if answer.status == GoalStatus.STATUS_SUCCEEDED:
                break
            code = answer.result.error_code
            if answer.status == GoalStatus.STATUS_ABORTED and code in self._no_path:
                return None
            if time.monotonic() + pause > end:
                ended = "canceled" if answer.status == GoalStatus.STATUS_CANCELED else "aborted"
                raise RefinementError(
                    f"planner: {self._name} {ended} all requests for {self._timeout:g} s "
                    f"(error code {code}); if another client uses it, try again later"
                )
            time.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)
        return path_from(answer.result.path, start, goal, name=self._name, frame=self._frame)

    def _connect(self) -> None:
        """Wait for the server at the first call, when DDS may still be connecting it."""
        is_first = not self._was_called
        self._was_called = True
        if not self._client.wait_for_server(self._timeout if is_first else 0.0):
            raise RefinementError(
                f"planner: expected the action server {self._name}, got none; "
                "start Nav2's planner_server"
            )
        if is_first:
            time.sleep(max(0.0, self._made_at + _DISCOVERY - time.monotonic()))

    def _wait_until_idle(self) -> None:
        """Return once a request interrupts nobody; raise an error if that takes too long."""
        began = time.monotonic()
        if began < self._busy_until:
            self._withhold(self.busy)
        while busy := self._statuses.busy(self._own):
            wait = self._patience
            if busy == self._name:
                wait = max(self._timeout, self._patience)
            if time.monotonic() - began >= wait:
                self._withhold(busy)
            time.sleep(_FIRST_PAUSE)

    def _withhold(self, busy: str) -> None:
        if self._patience:
            raise RefinementError(
                f"planner: expected {busy} to be idle within {self._patience:g} s, got a goal that "
                f"it executes; a request to {self._name} could abort it: try again later"
            )
        self.withheld += 1
        self.busy = busy
        self._busy_until = time.monotonic() + _LASTING
        raise PlannerBusyError

    def _request(self, start: tuple[float, float], goal: tuple[float, float]) -> Any:
        """Return the server's answer to a request, of any status.

        Raises RefinementError without one.
        """
        request = planner_goal(self._frame, Pose(*start, 0.0), Pose(*goal, 0.0))
        goal_id = GoalInfo().goal_id
        goal_id.uuid = list(uuid.uuid4().bytes)
        self._own.append(bytes(goal_id.uuid))
        handle = self._answer(self._client.send_goal_async(request, goal_uuid=goal_id))
        if handle is None:
            raise self._unanswered(start, goal)
        if not handle.accepted:
            raise RefinementError(f"planner: {self._name} rejected the goal; is it active?")
        answer = self._answer(handle.get_result_async())
        if answer is None:
            if not self._statuses.busy(self._own):  # Nav2's server cancels waiting goals, too
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
    domain = _planned_by(
        PlannerClient(name, settings[FRAME.name], _PATH_TIMEOUT, _navigators(name, domain)), domain
    )
    return domain, domain.equip(robot)


def planner_of(robot: Robot) -> PlannerClient | None:
    """Return the client of the planner server whose paths are a robot's routes, if it has one."""
    planner = None if robot.grid is None else robot.grid.planner
    return planner if isinstance(planner, PlannerClient) else None


def planned_by(name: str, frame: str, domain: Domain) -> Domain:
    """Return the domain with the paths of a planner server as its routes, for training.

    Requests wait for the end of drives; see `PlannerClient`.
    """
    client = PlannerClient(name, frame, _TRAINING_TIMEOUT, _navigators(name, domain), _PATIENCE)
    return _planned_by(client, domain)


def _planned_by(client: PlannerClient, domain: Domain) -> Domain:
    return dataclasses.replace(domain, planner=lambda *_: client)


def _navigators(name: str, domain: Domain) -> list[str]:
    """Return the actions of drives that use the planner `name`, which is in their namespace."""
    namespace = name.rpartition("/")[0]
    servers = list(NAVIGATORS)
    for spec in chain.from_iterable(domain.action_sets.values()):
        if spec.remote is not None:
            servers += [call.server for call in spec.remote.servers]
    return [each if each.startswith("/") else f"{namespace}/{each}" for each in servers]
