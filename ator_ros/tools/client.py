"""A client of our nodes: places robot and objects, requests refinement, sends chains, logs the path."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Any, Self

import pandas as pd
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import RefineSubgoal
from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import Domain
from ator_ros.experience.collect import episode_generator
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.records import ENDED, episode_of
from ator_ros.experience.table import episode_frame
from ator_ros.geometry import Pose
from ator_ros.nodes.client_node import ClientNode, SimulationClient
from ator_ros.nodes.messages import chain_of, situation_of
from ator_ros.nodes.qos import SENSOR_DATA
from ator_ros.robot.description import Robot
from ator_ros.tools.processes import NodesError, all_nodes
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.outcome import top_of
from ator_ros.world.messages import MessageError, robot_from
from ator_ros.world.state import World

FRAME = "odom"
_TRIES = 3
"""Drives from one situation, until one ends by itself."""
_NEAR = 0.02
_SUBSCRIBING = 10.0  # s that action servers have to subscribe to odom
_OUR_LISTENERS = 2
"""Of odom: the executor, and this client."""


class ClientError(NodesError):
    """The nodes did not do what the client needs; the message says what is missing."""


class Client:
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
        self._own = ClientNode("client", domain=domain, check=check, timeout=patience, error=ClientError)
        self.path: list[tuple[float, float]] = []
        self._pose = Pose(math.inf, math.inf, 0.0)
        node = self._own.node
        node.create_subscription(Odometry, "odom", self._hear, SENSOR_DATA)
        self._placing = SimulationClient(self._own, objects)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal")
        self._server = ActionClient(node, ExecuteChain, "execute_chain")
        self._own.start()

    def _hear(self, message: Odometry) -> None:
        _, robot = robot_from(message, frame=FRAME)
        self._pose = robot.pose
        self.path.append((robot.pose.x, robot.pose.y))

    def ready(self, servers: Sequence[str] = (), started: int = 0) -> None:
        """Wait until all nodes and action servers are there, and `started` servers subscribe to odometry."""
        self._own.until(self._placing.is_there, "the simulation")
        self._own.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self._own.until(self._server.server_is_ready, "the action execute_chain")
        where = f"on ROS_DOMAIN_ID {self._domain}, where only our nodes and those under `servers` are started"
        for name in servers:
            there = functools.partial(self._own.node.count_services, f"{name}/_action/send_goal")
            self._own.until(lambda there=there: there() > 0, f"the action {name} {where}")  # type: ignore[misc]
        end = time.monotonic() + _SUBSCRIBING  # a server may use tf, or nothing

        def subscribed() -> bool:
            others = 0 if time.monotonic() > end else started
            return int(self._own.node.count_subscribers("odom")) >= _OUR_LISTENERS + others

        self._own.until(subscribed, "subscriptions to odom")

    def place(self, start: World) -> None:
        """Place robot and objects at rest where a situation starts; time is paused until a chain runs."""
        self._placing.place(start)
        self._own.until(lambda: self._pose.distance(start.robot.pose) < _NEAR, "the robot at its start")

    def refine(self, start: World, chain: TopChainMessage) -> Any:
        """Ask for refinement and return the answer.

        Raises
        ------
        ClientError
            The chain cannot be refined, as where there are no models.
        """
        request = RefineSubgoal.Request(situation=situation_of(start, frame=FRAME), chain=chain)
        answer = self._own.call(self._refine, request)
        if not answer.accepted:
            raise ClientError(f"{self._refine.srv_name}: {answer.reason}")
        return answer

    def execute(self, chain: TopChainMessage, *, refine: bool) -> ChainPerformance:
        """Execute a chain, log its path in `path`, and return the record."""
        told: list[Any] = []
        goal = ExecuteChain.Goal(chain=chain, refine=refine)
        future = self._own.in_thread(
            lambda: self._server.send_goal_async(goal, feedback_callback=told.append)
        )
        ended = self._own.in_thread(self._own.answer(future, "the goal").get_result_async)
        # Time continues when the executor is known to steer: at full speed nothing waits for it before.
        self._own.until(lambda: bool(told) or ended.done(), "feedback")
        self.path.clear()
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


def drives(
    domain: Domain,
    robot: Robot,
    missing: Sequence[tuple[str, int]],
    *,
    action_set: str,
    seed: int,
    files: tuple[str, str],
    factor: float,
) -> Iterator[pd.DataFrame]:
    """Drive over ROS, each time a chain of one step; yield a row of each of the executor's records.

    The situations are those that `collect` draws without ROS from the same seed.

    Parameters
    ----------
    domain, robot
        The domain and its robot.
    missing : sequence of (str, int)
        Action and number of each drive.
    action_set, seed
        Name of the set of actions, and seed of the situations.
    files : (str, str)
        Name or file of the domain, and file of the robot's description, for the nodes.
    factor : float
        Simulated per real seconds.
    """
    if not missing:
        return
    with (
        all_nodes(factor, domain=files[0], robot=files[1]) as nodes,
        Client(nodes.domain, nodes.check, domain.objects) as client,
    ):
        client.ready(domain.remote_servers(action_set), len(domain.servers))
        for action, number in missing:
            rng = episode_generator(action, seed, number)
            situation = domain.actions(action_set)[action].sample(robot, rng)
            yield _driven(client, domain, robot, situation, action_set, number)


def _driven(
    client: Client, domain: Domain, robot: Robot, situation: Situation, action_set: str, number: int
) -> pd.DataFrame:
    """Drive from a situation to its goal; return the row of the executor's record."""
    top = top_of(situation, domain.tops_for(robot), robot)
    start = World(0.0, situation.robot, situation.objects)
    message = chain_of(TopChain((TopCall(top, situation.goal),)), action_set=action_set, frame=FRAME)
    reason = ""
    for _ in range(_TRIES):  # a drive that another program or a busy machine broke off teaches nothing
        client.place(start)
        for record in client.execute(message, refine=False).actions:
            reason = record.outcome.reason
            if record.outcome.code in ENDED:
                try:
                    return episode_frame(number, episode_of(record, domain, robot), domain.objects)
                except MessageError as error:
                    reason = str(error)
    raise ExperienceError(
        f"{situation.action}, drive {number + 1}: expected a drive that ends by itself in {_TRIES} tries, "
        f"the last one ended with {reason!r}"
    )
