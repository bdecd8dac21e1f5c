"""A client of our nodes: places robot and objects, asks for refinement, sends chains, logs the path."""

from __future__ import annotations

import functools
import math
import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

import rclpy
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import PlaceBall, PlaceRobot, RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.conversions import pose_of, robot_from, situation_of
from ator_ros.nodes.meeting import meeting_client, nobodys_goal
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.tools.work.demo_report import DemoRun
from ator_ros.world.state import World

_FRAME = "odom"
_NEAR = 0.02
_OUR_LISTENERS = 2
_AGAIN = 3.0  # real s
"""Of odom: the executor, and this client."""
_POLL = 0.005


class DemoError(RuntimeError):
    """Something that the demo needs is missing; the message says what."""


class DemoClient:
    """A node in this process, spun by a thread; a context manager.

    Parameters
    ----------
    domain : int
        ROS domain.
    check : callable
        Called while something is waited for; raises when waiting makes no sense.
    objects : sequence of str
        The objects that the simulation can place.
    patience : float
        Real time in s that each thing may take.
    """

    def __init__(
        self, domain: int, check: Callable[[], None], objects: Sequence[str], patience: float = 120.0
    ) -> None:
        self._check, self._patience = check, patience
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self._node = Node("demo", context=self._context)
        self._path: list[tuple[float, float]] = []
        self._pose = Pose(math.inf, math.inf, 0.0)
        self._node.create_subscription(Odometry, "odom", self._hear, SENSOR_DATA)
        self._place_robot = self._node.create_client(PlaceRobot, "place_robot")
        self._place_object = {name: self._node.create_client(PlaceBall, f"place_{name}") for name in objects}
        self._pause = self._node.create_client(SetBool, "pause")
        self._refine = self._node.create_client(RefineSubgoal, "refine_subgoal")
        self._server = ActionClient(self._node, ExecuteChain, "execute_chain")
        self._meeting = meeting_client(self._node, "execute_chain")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _hear(self, message: Odometry) -> None:
        _, robot = robot_from(message, frame=_FRAME)
        self._pose = robot.pose
        self._path.append((robot.pose.x, robot.pose.y))

    def ready(self, servers: Sequence[str] = (), programs: int = 0) -> None:
        """Wait until our nodes and the action servers of others are there, and all programs hear odometry."""
        for what in (self._place_robot, *self._place_object.values(), self._pause, self._refine):
            self._until(what.service_is_ready, f"the service {what.srv_name}")
        self._until(self._server.server_is_ready, "the action execute_chain")
        self._asked(self._meeting, nobodys_goal())
        for name in servers:
            there = functools.partial(self._node.count_services, f"{name}/_action/send_goal")
            self._until(lambda there=there: there() > 0, f"the action {name}")  # type: ignore[misc]
        listening = _OUR_LISTENERS + programs
        self._until(lambda: self._node.count_subscribers("odom") >= listening, "listeners of odom")

    def place(self, start: World) -> None:
        """Place robot and objects at rest where a situation starts; time is paused until a chain runs."""
        self._call(self._pause, SetBool.Request(data=True))
        for client in self._place_object.values():
            self._call(client, PlaceBall.Request(remove=True))
        request = PlaceRobot.Request()
        request.pose.pose = pose_of(start.robot.pose)
        self._call(self._place_robot, request)
        for name, there in start.objects.items():
            placement = PlaceBall.Request()
            placement.position.point.x, placement.position.point.y = there.x, there.y
            self._call(self._place_object[name], placement)
        self._until(lambda: self._pose.distance(start.robot.pose) < _NEAR, "the robot at its start")

    def refine(self, start: World, chain: TopChainMessage) -> Any:
        """Ask for refinement and return the answer.

        Raises
        ------
        DemoError
            The chain cannot be refined, as where there are no models.
        """
        request = RefineSubgoal.Request(situation=situation_of(start, frame=_FRAME), chain=chain)
        answer = self._call(self._refine, request)
        if not answer.accepted:
            raise DemoError(f"{self._refine.srv_name}: {answer.reason}")
        return answer

    def execute(self, chain: TopChainMessage, *, refine: bool) -> DemoRun:
        """Execute a chain, log the path, and return how it went."""
        return run_from(self.record_of(chain, refine=refine), list(self._path))

    def record_of(self, chain: TopChainMessage, *, refine: bool) -> ChainPerformance:
        """Execute a chain, log the path, and return the record."""
        told: list[Any] = []
        goal = ExecuteChain.Goal(chain=chain, refine=refine)
        future = self._within(lambda: self._server.send_goal_async(goal, feedback_callback=told.append))
        ended = self._within(self._answer(future, "the goal").get_result_async)
        # Time goes on when the executor is known to steer: at full speed nothing waits for it before.
        self._until(lambda: bool(told) or ended.done(), "feedback")
        self._path.clear()
        self._call(self._pause, SetBool.Request(data=False))
        record: ChainPerformance = self._answer(ended, "the goal's end").result.record
        return record

    def _call(self, client: Any, request: Any) -> Any:
        answer = self._asked(client, request)
        if getattr(answer, "success", True):
            return answer
        raise DemoError(f"{client.srv_name}: {answer.message}")

    def _asked(self, client: Any, request: Any) -> Any:
        """Return a service's answer. It is asked again meanwhile: see `ator_ros.nodes.meeting`."""
        future, since = client.call_async(request), time.monotonic()

        def answered() -> bool:
            nonlocal future, since
            if time.monotonic() - since > _AGAIN:
                client.remove_pending_request(future)
                future, since = client.call_async(request), time.monotonic()
            return bool(future.done())

        self._until(answered, f"an answer of the service {client.srv_name}")
        return future.result()

    def _within(self, ask: Callable[[], Future]) -> Future:
        """Ask in the thread that spins: rclpy's action client loses answers that outrun the call."""
        task = self._executor.create_task(ask)
        self._until(task.done, "the thread that spins")
        asked: Future = task.result()
        return asked

    def _answer(self, future: Future, what: str) -> Any:
        self._until(future.done, f"an answer of {what}")
        return future.result()

    def _until(self, happened: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + self._patience
        while not happened():
            self._check()
            if time.monotonic() > end:
                raise DemoError(f"expected {what} within {self._patience:g} s, it did not come")
            time.sleep(_POLL)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def run_from(record: ChainPerformance, path: list[tuple[float, float]]) -> DemoRun:
    """Read the record of a chain."""
    predicted = [action.predicted.duration for action in record.actions]
    missing = len(record.chain.calls) - len(predicted)
    return DemoRun(
        success=record.outcome.code == Outcome.SUCCEEDED,
        reason=record.outcome.reason,
        refinement=record.refinement,
        refined=record.refined,
        predicted=(*predicted, *[math.nan] * missing),
        actual=tuple(action.actual.duration for action in record.actions),
        total=(record.predicted.duration, record.actual.duration),
        path=path,
    )
