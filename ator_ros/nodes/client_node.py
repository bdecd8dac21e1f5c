"""A node for programs that call services and actions and wait: `view`, `demo`, and tests."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import SERVICES
from ator_ros.world.state import World

_POLL = 0.002
_LONG = 20.0  # s
_CHECK_PERIOD = 0.1
_RETRY = 3.0
"""Real s after which a request is sent again: DDS drops an answer to a client not yet discovered."""


class SpinThread:
    """Spins an executor in a thread of its own.

    Shutting down an rclpy executor destroys entities that a spinning thread still uses, so the thread is
    ended first.

    Parameters
    ----------
    executor : SingleThreadedExecutor
        Shut down at the end.
    """

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        self._executor, self._is_ending = executor, False
        self._thread = threading.Thread(target=self._spin, daemon=True)

    @property
    def is_alive(self) -> bool:
        """Whether neither `end` nor an exception has ended it."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Spin from now on."""
        self._thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._is_ending and self._executor.context.ok():
                self._executor.spin_once()

    def end(self, timeout: float | None = None) -> None:
        """Wait until the running callback has returned, at most `timeout` real s; shut the executor down."""
        if self.is_alive:
            self._executor.create_task(self._stop)
            self._thread.join(timeout)
        self._executor.shutdown()

    def _stop(self) -> None:
        self._is_ending = True


class ClientNode:
    """A node with its thread.

    Parameters
    ----------
    name : str
        Of the node.
    domain : int, optional
        ROS domain; by default that of the environment.
    arguments : sequence of str
        ROS arguments, such as remappings.
    check : callable
        Called while waiting; raises to end it.
    timeout : float
        Real time in s for each answer.
    error : type
        Of the exception that is raised without an answer in time, or if a service answers that it failed.

    Raises
    ------
    error
        The ROS arguments are invalid.
    """

    def __init__(
        self,
        name: str,
        *,
        domain: int | None = None,
        arguments: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
        timeout: float = 10.0,
        error: type[RuntimeError] = RuntimeError,
    ) -> None:
        self._check, self.timeout, self._error = check, timeout, error
        self._context = rclpy.Context()
        try:
            self._context.init(args=list(arguments), domain_id=domain)
            self.node = Node(name, context=self._context)
        except RuntimeError as cause:  # of rcl, in several lines
            text = " ".join(str(cause).split())
            raise error(f"expected arguments of ROS, got {list(arguments)}: {text}") from cause
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self.node)
        self._executor, self._thread = executor, SpinThread(executor)

    def start(self) -> None:
        """Spin from now on; publishers, subscriptions and clients were created before."""
        self._thread.start()

    def call(self, client: Any, request: Any) -> Any:
        """Call a service that is there and return its answer; raise if it answers that it failed.

        The request must be idempotent, because it may be sent again.
        """
        end = time.monotonic() + self.timeout
        while True:
            future = self.send(client, request)
            if self._arrives(future, min(end, time.monotonic() + _RETRY)):
                break
            client.remove_pending_request(future)
            self._expect_before(end, f"an answer of the service {client.srv_name}")
        answer = future.result()
        if not getattr(answer, "success", True):
            raise self._error(f"{client.srv_name}: {answer.message}")
        return answer

    def send(self, client: Any, request: Any) -> Future:
        """Call a service that is there; do not wait for the answer."""
        if not client.service_is_ready():
            raise self._error(f"expected the service {client.srv_name}, it is not available")
        future: Future = client.call_async(request)
        return future

    def in_thread(self, request: Callable[[], Future]) -> Future:
        """Send a goal from the spinning thread: ActionClient loses answers that precede the call's return."""
        task = self._executor.create_task(request)
        self.until(task.done, "the thread that spins")
        sent: Future = task.result()
        return sent

    def answer(self, future: Future, what: str) -> Any:
        """Wait for an answer; raise without one."""
        end = time.monotonic() + self.timeout
        while not self._arrives(future, end):
            self._expect_before(end, f"an answer of {what}")
        return future.result()

    def _arrives(self, future: Future, end: float) -> bool:
        """Wait until `end` for an answer, and return whether it came."""
        arrived = threading.Event()
        future.add_done_callback(lambda _: arrived.set())
        while not arrived.wait(_CHECK_PERIOD):
            self._check()
            if time.monotonic() > end:
                return False
        return True

    def until(self, happened: Callable[[], bool], what: str) -> None:
        """Wait until something has happened; log what is waited for after 20 s; raise after the timeout."""
        start, is_logged = time.monotonic(), False
        while not happened():
            self._expect_before(start + self.timeout, what)
            if not is_logged and time.monotonic() > start + _LONG:
                is_logged = True
                self.node.get_logger().warning(f"waiting for {what}")
            time.sleep(_POLL)

    def _expect_before(self, end: float, what: str) -> None:
        self._check()
        if time.monotonic() > end:
            raise self._error(f"expected {what} within {self.timeout:g} s, it did not come")

    def close(self) -> None:
        """Stop spinning and destroy the node."""
        self._thread.end()
        self.node.destroy_node()
        self._context.try_shutdown()


class SimulationClient:
    """The simulation's services that place robot and objects and pause time.

    Parameters
    ----------
    own : ClientNode
        The node that calls them, not started yet.
    objects : iterable of str
        The objects that the simulation can place.

    Attributes
    ----------
    paused : bool
        Whether the last request from here paused time.
    """

    def __init__(self, own: ClientNode, objects: Iterable[str]) -> None:
        self._own, node = own, own.node
        self.paused = False
        self._robot = node.create_client(PlaceRobot, "place_robot", qos_profile=SERVICES)
        self._pause = node.create_client(SetBool, "pause", qos_profile=SERVICES)
        self._objects = {
            name: node.create_client(PlaceObject, f"place_{name}", qos_profile=SERVICES) for name in objects
        }

    def is_available(self, timeout: float = 0.0) -> bool:
        """Return whether a simulation offers all of them within `timeout` real s."""
        end = time.monotonic() + timeout
        clients = (self._robot, self._pause, *self._objects.values())
        return all(client.wait_for_service(max(0.0, end - time.monotonic())) for client in clients)

    def can_place(self, name: str) -> bool:
        """Return whether the simulation can place an object."""
        return name in self._objects

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
        """Pause time and place robot and objects; objects that `world` lacks are removed."""
        self.pause(paused=True)
        for client in self._objects.values():
            self._own.call(client, PlaceObject.Request(remove=True))
        self._own.call(self._robot, _at_pose(world.robot.pose))
        for name, there in world.objects.items():
            if self.can_place(name):
                self._own.call(self._objects[name], _at_point(there.x, there.y))


def _at_pose(pose: Pose) -> PlaceRobot.Request:
    request = PlaceRobot.Request()
    request.pose.pose = pose_of(pose)
    return request


def _at_point(x: float, y: float) -> PlaceObject.Request:
    request = PlaceObject.Request()
    request.position.point.x, request.position.point.y = x, y
    return request
