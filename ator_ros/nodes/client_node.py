"""A node for programs that call services and actions and wait: `view`, `demo`, and tests."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import SERVICES
from ator_ros.view.backend import NodesError
from ator_ros.world.state import World

_LOG_AFTER = 10.0  # s of waiting after which a warning names the cause
_SPIN = 0.02
_RETRY = 3.0
"""Real s after which a request is sent again: DDS drops an answer to a client not yet discovered."""


class ClientNode:
    """A node that is spun while its program waits; `spin` takes what comes at other times.

    Parameters
    ----------
    domain : int, optional
        ROS domain; by default that of the environment.
    arguments : sequence of str
        ROS arguments, such as remappings.
    check : callable
        Called while waiting; raises to end it.
    timeout : float
        Real time in s for each answer.

    Raises
    ------
    NodesError
        The ROS arguments are invalid. Methods raise it without an answer in time, or if a service answers
        that it failed.
    """

    def __init__(
        self,
        name: str,
        *,
        domain: int | None = None,
        arguments: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
        timeout: float = 10.0,
    ) -> None:
        self._check, self.timeout = check, timeout
        self._context = rclpy.Context()
        try:
            self._context.init(args=list(arguments), domain_id=domain)
            self.node = Node(name, context=self._context)
        except RuntimeError as cause:  # of rcl, in several lines
            text = " ".join(str(cause).split())
            raise NodesError(f"expected arguments of ROS, got {list(arguments)}: {text}") from cause
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Take messages and answers for so many real s."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def call(self, client: Any, request: Any) -> Any:
        """Call a service that is there and return its answer; raise if it answers that it failed.

        The request must be idempotent, because it may be sent again.
        """
        end, what = time.monotonic() + self.timeout, f"an answer of the service {client.srv_name}"
        while True:
            future, retry = self.send(client, request), time.monotonic() + _RETRY
            self.until(partial(_is_done, future, retry), what, end=end)
            if future.done():
                break
            client.remove_pending_request(future)
        answer = future.result()
        if not getattr(answer, "success", True):
            raise NodesError(f"{client.srv_name}: {answer.message}")
        return answer

    def send(self, client: Any, request: Any) -> Future:
        """Call a service that is there; do not wait for the answer."""
        if not client.service_is_ready():
            raise NodesError(f"expected the service {client.srv_name}, it is not available")
        future: Future = client.call_async(request)
        return future

    def answer(self, future: Future, what: str) -> Any:
        """Wait for an answer; raise without one."""
        self.until(future.done, f"an answer of {what}")
        return future.result()

    def until(self, happened: Callable[[], bool], what: str, *, end: float | None = None) -> None:
        """Wait until something has happened; raise after the timeout, or at `end` (monotonic s)."""
        begun, is_logged = time.monotonic(), False
        last = begun + self.timeout if end is None else end
        while not happened():
            self._check()
            if not is_logged and time.monotonic() > begun + _LOG_AFTER:
                is_logged = True
                self.node.get_logger().warning(f"waiting for {what}")
            if time.monotonic() > last:
                raise NodesError(f"expected {what} within {self.timeout:g} s, it did not come")
            self._executor.spin_once(timeout_sec=_SPIN)

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


class SimulationClient:
    """The simulation's services that place the robot and `objects` and pause time.

    `own` is the node that calls them. `paused` is whether the last request from here paused
    time.
    """

    def __init__(self, own: ClientNode, objects: Iterable[str]) -> None:
        self._own, node = own, own.node
        self.paused = False
        self._robot = node.create_client(PlaceRobot, "place_robot", qos_profile=SERVICES)
        self._pause = node.create_client(SetBool, "pause", qos_profile=SERVICES)
        self._objects = {
            name: node.create_client(PlaceObject, f"place_{name}", qos_profile=SERVICES) for name in objects
        }

    def is_available(self) -> bool:
        """Return whether a simulation offers all of them."""
        clients = (self._robot, self._pause, *self._objects.values())
        return all(client.service_is_ready() for client in clients)

    def place_robot(self, pose: Pose) -> Future:
        """Place the robot at rest; does not wait."""
        return self._own.send(self._robot, _at_pose(pose))

    def place_object(self, name: str, x: float, y: float) -> Future:
        """Place an object at (x, y) m, at rest; does not wait."""
        return self._own.send(self._objects[name], _at_point(x, y))

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self.paused = paused or self.paused  # without an answer it may be either
        self._own.call(self._pause, SetBool.Request(data=paused))
        self.paused = paused

    def resume(self) -> Future:
        """Resume time; does not wait, and it is no error if the simulation has ended."""
        answer: Future = self._pause.call_async(SetBool.Request(data=False))
        self.paused = False
        return answer

    def place(self, world: World) -> None:
        """Pause time and place robot and objects; others are removed."""
        self.pause(paused=True)
        for client in self._objects.values():
            self._own.call(client, PlaceObject.Request(remove=True))
        self._own.call(self._robot, _at_pose(world.robot.pose))
        for name, there in world.objects.items():
            if name in self._objects:
                self._own.call(self._objects[name], _at_point(there.x, there.y))


def _is_done(future: Future, end: float) -> bool:
    return future.done() or time.monotonic() > end


def _at_pose(pose: Pose) -> PlaceRobot.Request:
    request = PlaceRobot.Request()
    request.pose.pose = pose_of(pose)
    return request


def _at_point(x: float, y: float) -> PlaceObject.Request:
    request = PlaceObject.Request()
    request.position.point.x, request.position.point.y = x, y
    return request
