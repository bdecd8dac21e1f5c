"""A client of our nodes: places robot and objects, asks for refinement, sends chains, logs the path."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

from nav_msgs.msg import Odometry
from rclpy.action import ActionClient

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome, Performance
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import RefineSubgoal
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import situation_of
from ator_ros.nodes.placing import Placing
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.tools.processes import NodesError
from ator_ros.tools.work.demo_report import DemoRun
from ator_ros.world.messages import robot_from
from ator_ros.world.state import World

_FRAME = "odom"
_NEAR = 0.02
_SUBSCRIBING = 10.0  # s that programs have to subscribe to odom
_OUR_LISTENERS = 2
"""Of odom: the executor, and this client."""


class DemoError(NodesError):
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
        self._domain = domain
        self._own = SpunNode("demo", domain=domain, check=check, patience=patience, fails=DemoError)
        self._path: list[tuple[float, float]] = []
        self._pose = Pose(math.inf, math.inf, 0.0)
        node = self._own.node
        node.create_subscription(Odometry, "odom", self._hear, SENSOR_DATA)
        self._placing = Placing(self._own, objects)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal")
        self._server = ActionClient(node, ExecuteChain, "execute_chain")
        self._own.start()

    def _hear(self, message: Odometry) -> None:
        _, robot = robot_from(message, frame=_FRAME)
        self._pose = robot.pose
        self._path.append((robot.pose.x, robot.pose.y))

    def ready(self, servers: Sequence[str] = (), programs: int = 0) -> None:
        """Wait until our nodes and the action servers of others are there, and all programs hear odometry."""
        self._placing.ready()
        self._own.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self._own.until(self._server.server_is_ready, "the action execute_chain")
        self._own.meet("execute_chain")
        where = f"on ROS_DOMAIN_ID {self._domain}, where only our nodes and those under `servers` are started"
        for name in servers:
            there = functools.partial(self._own.node.count_services, f"{name}/_action/send_goal")
            self._own.until(lambda there=there: there() > 0, f"the action {name} {where}")  # type: ignore[misc]
        end = time.monotonic() + _SUBSCRIBING  # a program may use tf, or nothing

        def subscribed() -> bool:
            others = 0 if time.monotonic() > end else programs
            return int(self._own.node.count_subscribers("odom")) >= _OUR_LISTENERS + others

        self._own.until(subscribed, "subscriptions to odom")

    def place(self, start: World) -> None:
        """Place robot and objects at rest where a situation starts; time is paused until a chain runs."""
        self._placing.everything(start)
        self._own.until(lambda: self._pose.distance(start.robot.pose) < _NEAR, "the robot at its start")

    def refine(self, start: World, chain: TopChainMessage) -> Any:
        """Ask for refinement and return the answer.

        Raises
        ------
        DemoError
            The chain cannot be refined, as where there are no models.
        """
        request = RefineSubgoal.Request(situation=situation_of(start, frame=_FRAME), chain=chain)
        answer = self._own.call(self._refine, request)
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
        future = self._own.within(lambda: self._server.send_goal_async(goal, feedback_callback=told.append))
        ended = self._own.within(self._own.answer(future, "the goal").get_result_async)
        # Time continues when the executor is known to steer: at full speed nothing waits for it before.
        self._own.until(lambda: bool(told) or ended.done(), "feedback")
        self._path.clear()
        self._placing.pause(paused=False)
        record: ChainPerformance = self._own.answer(ended, "the goal's end").result.record
        return record

    def close(self) -> None:
        """Leave the graph."""
        self._own.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def predicted_as(run: DemoRun, whole: Performance, actions: Sequence[Performance]) -> DemoRun:
    """Return a run with the prediction that refinement made of its chain from the start.

    The records of actions hold predictions from where each has begun, which do not add up to the chain's.
    """
    predicted = tuple(action.duration for action in actions)
    return dataclasses.replace(run, predicted=predicted, total=(whole.duration, run.total[1]))


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
