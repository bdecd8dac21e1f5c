"""A client of the nodes for tests, which subscribes, publishes commands and calls services."""

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from process import PATIENCE
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from ator_interfaces.srv import PlaceObject, PlaceRobot
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of
from ator_ros.nodes.qos import NEWEST, RESULTS, SENSOR_DATA
from ator_ros.nodes.remote_actions import cancel_request_for_unknown_goal
from ator_ros.world.readers import ObjectReader, ObjectSource, OdometryReader, seconds_from
from ator_ros.world.state import ObjectState, RobotState

RETRY = 8.0
"""Real seconds after which an unanswered request is sent again."""


_SPIN = 0.1


class SpinThread(threading.Thread):
    """Spins an executor in a thread of its own.

    Shutting down an rclpy executor destroys entities that a spinning thread still uses, so the
    thread is ended first.
    """

    def __init__(self, executor: SingleThreadedExecutor) -> None:
        super().__init__(daemon=True)
        self._executor, self._ending = executor, threading.Event()

    def run(self) -> None:
        """Spin until `end` is called."""
        with contextlib.suppress(ExternalShutdownException):
            while not self._ending.is_set() and self._executor.context.ok():
                self._executor.spin_once(timeout_sec=_SPIN)

    def end(self, timeout: float | None = None) -> None:
        """Wait until the running callback has returned, at most `timeout` real s.

        Shut the executor down.
        """
        self._ending.set()
        if self.is_alive():
            self.join(timeout)
        self._executor.shutdown()


class Client:
    """A node in this process: it subscribes to odom and ball, commands, and calls services.

    `frame` is the odometry's frame in `namespace`. A `silent` client neither subscribes to them nor
    publishes commands: one process cannot have a topic with two types.
    """

    def __init__(
        self,
        domain: int,
        namespace: str = "",
        frame: str = "odom",
        *,
        name: str = "test_client",
        silent: bool = False,
    ) -> None:
        self.domain, self._frame = domain, frame
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self.node = Node(name, namespace=namespace, context=self._context)
        self.robots: list[tuple[float, RobotState]] = []
        self.balls: list[tuple[float, ObjectState]] = []
        self._ball = ObjectReader(ObjectSource("ball"), frame)
        self._callers: dict[str, Any] = {}
        if not silent:
            self.node.create_subscription(Odometry, "odom", self._on_robot, SENSOR_DATA)
            self.node.create_subscription(Odometry, "ball", self._on_ball, SENSOR_DATA)
        self._commands = None if silent else self.node.create_publisher(Twist, "cmd_vel", NEWEST)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._spinning = SpinThread(self._executor)
        self._spinning.start()

    def _on_robot(self, message: Odometry) -> None:
        self.robots.append(OdometryReader(self._frame).read(message))

    def _on_ball(self, message: Odometry) -> None:
        self.balls.append(self._ball.read(message))

    def add(self, node: Node) -> None:
        """Spin another node, which has the client's context."""
        self._executor.add_node(node)

    def listen(self, kind: type, topic: str, qos: Any) -> list[Any]:
        """Subscribe to a topic; return a list to which every message is appended."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def statuses(self) -> list[DiagnosticStatus]:
        """Subscribe to the diagnostics.

        Return a list to which the status of every message is appended.
        """
        found: list[DiagnosticStatus] = []
        self.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda message: found.extend(message.status), RESULTS
        )
        return found

    def status_of(self, name: str) -> DiagnosticStatus:
        """Wait for the diagnostic status of a node."""
        found = self.statuses()
        return self.eventually(
            lambda: [each for each in found if each.name == f"/{name}"], "diagnostics"
        )[0]

    def eventually(self, happened: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
        """Wait until `happened` returns a true value, and return it; fail after `patience` s."""
        end = time.monotonic() + patience
        while time.monotonic() < end:
            result = happened()
            if result:
                return result
            time.sleep(0.01)
        raise AssertionError(f"expected within {patience:g} s: {what}")

    def robot(self) -> RobotState:
        """Return the latest robot state; wait for the first."""
        return self.eventually(lambda: self.robots and self.robots[-1][1], "odometry")

    def ball(self) -> ObjectState:
        """Return the latest ball state; wait for the first."""
        return self.eventually(lambda: self.balls and self.balls[-1][1], "a ball")

    def time(self) -> float:
        """Return the simulated time of the last odometry in s."""
        self.robot()
        return self.robots[-1][0]

    def command(self, v: float = 0.0, w: float = 0.0) -> None:
        message = Twist()
        message.linear.x, message.angular.z = v, w
        self._commands.publish(message)

    def drive_a_tick(self, v: float) -> None:
        """Send one velocity command and wait for the next odometry."""
        count = len(self.robots)
        self.command(v=v)
        self.eventually(lambda: len(self.robots) > count, "the next tick")

    def call(self, kind: type, name: str, request: Any | None = None) -> Any:
        if name not in self._callers:
            self._callers[name] = self.node.create_client(kind, name)
        client = self._callers[name]
        assert client.wait_for_service(timeout_sec=PATIENCE), f"service {name} is missing"
        sent = kind.Request() if request is None else request  # type: ignore[attr-defined]
        return self.eventually(lambda: self._answer(client, sent), f"an answer of {name}")

    def _answer(self, client: Any, request: Any) -> Any:
        """Call once.

        None without a response: a server that has just ended may still be discovered.
        """
        future = client.call_async(request)
        end = time.monotonic() + RETRY
        while not future.done() and time.monotonic() < end:
            time.sleep(0.005)
        if not future.done():
            client.remove_pending_request(future)
            return None
        return future.result()

    def set_parameters(self, node: str, **values: Any) -> list[SetParametersResult]:
        """Set parameters of a node; return its answers."""
        wanted = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        request = SetParameters.Request(parameters=wanted)
        return list(self.call(SetParameters, f"{node}/set_parameters", request).results)

    def wait_for_discovery_by(self, action: str) -> None:
        """Wait until an action server has discovered this node's action client."""
        self.call(CancelGoal, f"{action}/_action/cancel_goal", cancel_request_for_unknown_goal())

    def place(self, robot: Pose | None = None, ball: tuple[float, float] | None = None) -> None:
        if ball is not None:  # the robot may be placed at the ball's position
            assert self.call(PlaceObject, "place_ball", PlaceObject.Request(remove=True)).success
        if robot is not None:
            request = PlaceRobot.Request()
            request.pose.pose = pose_of(robot)
            assert self.call(PlaceRobot, "place_robot", request).success
        if ball is not None:
            request = PlaceObject.Request()
            request.position.point.x, request.position.point.y = ball
            assert self.call(PlaceObject, "place_ball", request).success

    def within(self, do: Callable[[], Any]) -> Any:
        """Run `do` in the spinning thread: rclpy's action client loses too early responses."""
        task = self._executor.create_task(do)
        return self.eventually(task.done, "a task") and task.result()

    def close(self) -> None:
        self._spinning.end(PATIENCE)
        self.node.destroy_node()
        self._context.try_shutdown()


class SentGoal:
    """An accepted goal of an action client, with its feedback."""

    def __init__(self, client: Client, server: ActionClient, goal: Any) -> None:
        self.client, self.feedback = client, list[Any]()
        future = client.within(
            lambda: server.send_goal_async(
                goal, lambda message: self.feedback.append(message.feedback)
            )
        )
        client.eventually(future.done, "the goal's acceptance")
        self.handle = future.result()
        assert self.handle.accepted
        self._future = client.within(self.handle.get_result_async)

    def cancel(self) -> bool:
        """Cancel the goal; return whether it was still active."""
        future = self.client.within(self.handle.cancel_goal_async)
        self.client.eventually(future.done, "an answer to cancel")
        return bool(future.result().goals_canceling)

    def ended(self) -> bool:
        return bool(self._future.done())

    def response(self, patience: float = 4 * PATIENCE) -> Any:
        """Wait for the end; return the response with status and result."""
        self.client.eventually(self._future.done, "the goal's end", patience)
        return self._future.result()


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def stamp(message: Any) -> float:
    """Return the time in s of a message with a header."""
    return seconds_from(message.header.stamp)
