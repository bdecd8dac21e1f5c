"""The view's backend on ROS: monitors of robot and goals, and requests to the nodes."""

from __future__ import annotations

import contextlib
import math
import re
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from nav_msgs.msg import Path
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Outcome, SearchCurve, TopChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import Domain
from ator_ros.execution.chain_executor import Ending
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.client_node import ClientNode, SimulationClient
from ator_ros.nodes.inputs import ObjectSources, RobotSource, TfListener
from ator_ros.nodes.messages import action_set_from, chain_from, chain_of, situation_of
from ator_ros.nodes.parameters import STATE, SetupError
from ator_ros.nodes.qos import LATCHED, LATCHED_BY_MANY, SERVICES
from ator_ros.printable import printable
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary
from ator_ros.view.backend import (
    OTHERS,
    Answer,
    ExecutedChain,
    ExternalGoal,
    History,
    NodesError,
    Run,
    UnavailableError,
)
from ator_ros.view.draft import Draft
from ator_ros.world.messages import MessageError, pose_from, world_from
from ator_ros.world.state import ObjectState, RobotState, World

_DISCOVERY = 2.0  # real s after which a simulation, or a service of the executor, counts as missing
_PLACED = 0.2  # real s after which all nodes have received what the simulation has placed
_GONE = 5.0  # real s without an executor after which its chain counts as lost
_OBJECT_TIMEOUT = 1.0  # s by the stamps after which an object that is not observed is no longer shown
_WARNING_PERIOD = 2.0
_ROBOT_FROM = {STATE.name: "odom", "robot_frame": "base_link"}
"""The source of the robot's state, unless the executor names another."""
_OUTCOMES = {ending.value: ending.name.lower().replace("_", " ") for ending in Ending}
_LONGEST_NAME, _LONGEST_REASON = 60, 300


class WorldMonitor:
    """The newest state of a robot and of a domain's objects, all poses in `frame`."""

    def __init__(self, node: Node, domain: Domain, robot: Robot, *, frame: str) -> None:
        self._node, self._robot, self._frame = node, robot, frame
        self._tf = TfListener(node)
        self._newest: tuple[float, RobotState] | None = None
        self._objects: dict[str, tuple[float, ObjectState]] = {}
        self._received_at = time.monotonic()
        self._source: RobotSource | None = None
        sources = map(domain.source, domain.objects)
        self._sources = ObjectSources(node, sources, self._take_object, self._reject, self._tf, frame=frame)

    def follow_robot(self, settings: Mapping[str, Any]) -> None:
        """Subscribe to the robot's state, with the parameters of its executor; raises NodesError."""
        settings = {**settings, "frame": self._frame}
        try:
            self._source = RobotSource(
                self._node, settings, self._robot, self._take_robot, self._reject, self.warn, self._tf
            )
        except SetupError as error:
            raise NodesError(str(error)) from error

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._newest, self._received_at = (stamp, robot), time.monotonic()

    def _take_object(self, name: str, stamp: float, there: ObjectState) -> None:
        self._objects[name] = stamp, there

    def _reject(self, _: str, error: MessageError) -> None:
        self.warn(f"ignored: {error}")

    def warn(self, text: str) -> None:
        """Log a warning, at most every two seconds."""
        self._node.get_logger().warning(text, throttle_duration_sec=_WARNING_PERIOD)

    def silence(self) -> float:
        """Return the real s since the last state of the robot."""
        return time.monotonic() - self._received_at

    def world(self) -> World | None:
        """Return the newest state; objects that are no longer observed are not in it."""
        if self._newest is None:
            return None
        now, robot = self._newest
        known = self._objects.items()
        objects = {name: there for name, (stamp, there) in known if abs(now - stamp) < _OBJECT_TIMEOUT}
        return World(now, robot, objects)


class GoalMonitor:
    """Follows the goals of one executor, our own and those of other clients.

    Subscribes to
        chain_under_way, performance/chain (ator_interfaces/ChainPerformance): status and records.
        planned_path (nav_msgs/Path): the planned path of the active action.

    `history`, `external` and `path` are those of `ator_ros.view.backend.Backend`.
    """

    def __init__(
        self, node: Node, world: WorldMonitor, libraries: Mapping[str, TopLibrary], *, frame: str
    ) -> None:
        self._node, self._world, self._libraries, self._frame = node, world, libraries, frame
        self.history = History()
        self.external: ExternalGoal | None = None
        self.path: FloatArray | None = None
        self._own_runs: dict[str, Run] = {}
        self._active = ("", Run(OTHERS, ended=True))
        self._there_at = time.monotonic()  # when an executor was last there
        self._status = node.create_subscription(ChainPerformance, "chain_under_way", self._take, LATCHED)
        node.create_subscription(ChainPerformance, "performance/chain", self._take_record, LATCHED_BY_MANY)
        node.create_subscription(Path, "planned_path", self._take_path, LATCHED)

    def expect(self, chain_id: str, run: Run) -> None:
        """Follow a goal that this client is about to send, and keep `run` up to date."""
        self._own_runs[chain_id] = run
        self._active = chain_id, run

    @property
    def active_goal(self) -> str | None:
        """The UUID of the goal that is active, of any client; None without one."""
        chain_id, run = self._active
        return None if run.ended else chain_id

    def _take(self, message: ChainPerformance) -> None:
        run, former = self._own_runs.get(message.chain_id), self.external
        if run is not None:
            self.external = None
        else:
            is_new = former is None or former.chain_id != message.chain_id
            run = Run(OTHERS) if former is None or is_new else former.run
            try:
                self.external = self._external_goal(message, run)
            except MessageError as error:
                self.external = None
                self._world.warn(f"chain_under_way: ignored: {error}")
                return
        if not run.ended:
            self._active = message.chain_id, run
            _update(run, message)

    def _external_goal(self, message: ChainPerformance, run: Run) -> ExternalGoal:
        """Read another client's goal; raises MessageError."""
        if not re.fullmatch("[0-9a-f]{32}", message.chain_id):
            raise MessageError("chain_id: expected 32 hexadecimal digits")
        action_set = action_set_from(message.chain, allowed=self._libraries)
        chain = chain_from(message.chain, self._libraries[action_set], frame=self._frame)
        driven = math.isfinite(message.actual.duration)
        return ExternalGoal(
            message.chain_id,
            Draft(world_from(message.start, frame=self._frame, where="start"), chain, action_set),
            run,
            driven=driven,
            refined=message.refined,
            changes=message.refined_again,
            reason=printable(message.refinement if driven else message.outcome.reason, _LONGEST_REASON),
        )

    def _take_record(self, message: ChainPerformance) -> None:
        run = self._own_runs.get(message.chain_id)
        if run is None and self.external is not None and self.external.chain_id == message.chain_id:
            run = self.external.run
        if run is not None and not run.ended:  # of the status only the newest message is sure to arrive
            _update(run, message)
        if message.outcome.code == Outcome.REFUSED:
            return
        try:
            self.history.add(_executed_chain(message))
        except MessageError as error:
            self._world.warn(f"performance/chain: ignored: {error}")

    def _take_path(self, message: Path) -> None:
        places = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        self.path = np.array(places) if places and np.isfinite(places).all() else None

    def watch(self) -> None:
        """End the active run as lost if its executor has gone."""
        now = time.monotonic()
        if self._node.count_publishers(self._status.topic_name):
            self._there_at = now
        elif now - self._there_at > _GONE:
            self.lose()

    def lose(self) -> None:
        """End the active run; its executor does not answer."""
        _, run = self._active
        if not run.ended:
            run.status, run.ended = "lost: the executor does not answer", True


def _update(run: Run, message: ChainPerformance) -> None:
    """Write the status of a chain into its run."""
    actions, code = message.actions, message.outcome.code
    run.started = True
    run.actual[:] = [each.actual.duration for each in actions if each.outcome.code == Outcome.SUCCEEDED]
    reason = printable(message.outcome.reason, _LONGEST_REASON)
    refinement = printable(message.refinement, _LONGEST_REASON)
    prefix = "of others: " if run.label == OTHERS else ""
    if not code:
        run.status = f"{prefix}{reason}"
        return
    succeeded = code == Outcome.SUCCEEDED
    run.duration = message.actual.duration if succeeded else math.nan
    run.status = f"{prefix}{'done' if succeeded else reason} ({refinement})"
    run.ended = True


def _executed_chain(message: ChainPerformance) -> ExecutedChain:
    """Read a record; raises MessageError."""
    code, start = message.outcome.code, world_from(message.start, where="start")
    places = [start.robot.pose, *(Pose(there.x, there.y, 0.0) for there in start.objects.values())]
    places += [pose_from(call.goal.pose, "chain") for call in message.chain.calls[-1:]]
    return ExecutedChain(
        tuple(printable(call.top, _LONGEST_NAME) for call in message.chain.calls),
        message.refined,
        message.predicted.duration,
        message.actual.duration if code == Outcome.SUCCEEDED else math.nan,
        _OUTCOMES.get(code, f"outcome {code}"),
        tuple(places),
    )


class RosBackend(GoalMonitor):
    """Running nodes, observed and used through a client node; see `ator_ros.view.backend.Backend`.

    Parameters
    ----------
    ros_domain : int, optional
        By default that of the environment.
    arguments : sequence of str
        ROS arguments, such as the namespace of the robot's nodes.
    check : callable
        Called while waiting; raises to end it.
    start_timeout, timeout : float
        Real s that nodes may take to start, and that an answer may take of nodes that may end.
    """

    def __init__(
        self,
        domain: Domain,
        robot: Robot,
        *,
        frame: str = "odom",
        ros_domain: int | None = None,
        arguments: Sequence[str] = (),
        check: Callable[[], None] = lambda: None,
        start_timeout: float = 60.0,
        timeout: float = 5.0,
    ) -> None:
        self._client = client = ClientNode(
            "view", domain=ros_domain, arguments=arguments, check=check, timeout=start_timeout
        )
        libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        node = client.node
        super().__init__(node, WorldMonitor(node, domain, robot, frame=frame), libraries, frame=frame)
        self._timeouts = start_timeout, timeout
        self.can_place = self._is_shared = False
        self._simulation = SimulationClient(client, robot.scene.objects)
        self._refinement = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        self._settings = node.create_client(GetParameters, "executor/get_parameters")
        self._server = ActionClient(node, ExecuteChain, "execute_chain")
        self._cancel = node.create_client(CancelGoal, "execute_chain/_action/cancel_goal")

    def ready(self, *, simulated: bool) -> None:
        """Wait for refinement and executor, and if `simulated` for the simulation.

        NodesError is raised if one did not start in time, or the robot cannot be observed.
        """
        self._client.timeout = self._timeouts[0]
        if simulated:
            self._client.until(self._simulation.is_available, "the simulation's services")
        self._client.until(self._refinement.service_is_ready, f"the service {self._refinement.srv_name}")
        self._client.until(self._server.server_is_ready, "the action execute_chain")
        self._world.follow_robot(self._robot_settings())
        self._client.spin(_DISCOVERY)
        self.can_place = self._simulation.is_available()
        node = self._client.node
        nodes = node.get_node_names_and_namespaces()
        self._is_shared = ("simulation", node.get_namespace()) not in nodes and ("simulation", "/") in nodes
        if not simulated:  # they may end, and the page waits for every answer
            self._client.timeout = self._timeouts[1]

    def _robot_settings(self) -> dict[str, str]:
        """Ask the executor for the source of the robot's state."""
        if not self._settings.wait_for_service(_DISCOVERY):
            return _ROBOT_FROM
        answer = self._client.call(self._settings, GetParameters.Request(names=list(_ROBOT_FROM)))
        values = dict(zip(_ROBOT_FROM, (value.string_value for value in answer.values), strict=False))
        return {name: values.get(name) or usual for name, usual in _ROBOT_FROM.items()}

    def close(self) -> None:
        """Resume time if this backend has paused it, and destroy the node."""
        if self._simulation.paused:
            with contextlib.suppress(NodesError):
                self.pause(paused=False)
        self._client.close()

    # State

    def spin(self, seconds: float) -> None:
        """Take messages for so many real s."""
        self._client.spin(seconds)

    def world(self) -> World | None:
        """Return the newest state; objects that are no longer observed are not in it."""
        return self._world.world()

    def silence(self) -> float:
        """Return the real s since the last state of the robot."""
        return self._world.silence()

    # Refinement

    def refine(self, draft: Draft, *, as_given: bool = False) -> Answer:
        """Ask the node `refinement`; values of open variables are placeholders, unless `as_given`."""
        if not self._refinement.service_is_ready():
            raise UnavailableError(f"expected the service {self._refinement.srv_name}, it is not there")
        request = RefineSubgoal.Request(
            situation=situation_of(draft.world, frame=self._frame),
            chain=self._chain(draft),
            want_curve=True,
            as_given=as_given,
        )
        answer = self._client.call(self._refinement, request)
        if not answer.accepted:
            raise NodesError(answer.reason)
        library = self._libraries[draft.action_set]
        return Answer(
            chain_from(answer.original, library, frame=self._frame, where="original"),
            chain_from(answer.chain, library, frame=self._frame),
            answer.refined,
            answer.reason,
            tuple(action.duration for action in answer.before_actions),
            tuple(action.duration for action in answer.after_actions),
            tuple(map(_curve_from, answer.curves)),
        )

    def _chain(self, draft: Draft) -> TopChain:
        return chain_of(draft.chain, action_set=draft.action_set, frame=self._frame)

    # Simulation

    def place_robot(self, pose: Pose) -> None:
        """Place the robot at rest; does not wait."""
        self._simulation.place_robot(pose)

    def place_object(self, name: str, x: float, y: float) -> None:
        """Place an object at (x, y) m, at rest; does not wait."""
        self._simulation.place_object(name, x, y)

    def place(self, world: World) -> None:
        """Place robot and objects, remove other objects, and wait until they are observed there.

        Time stands still afterwards, unless other robots live in the same simulation, or this fails.
        """
        paused = False
        try:
            self._simulation.place(world)
            self._client.spin(_PLACED)
            paused = not self._is_shared
        finally:
            if not paused:
                self._simulation.resume()

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self._simulation.pause(paused=paused)

    # Execution

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        """Start to execute a chain; resume time once the executor controls the robot, or if this fails."""
        try:
            self._start(run, draft, refine=refine)
        except BaseException:
            if self._simulation.paused:
                self._simulation.resume()
            raise
        if self.can_place:
            self.pause(paused=False)

    def _start(self, run: Run, draft: Draft, *, refine: bool) -> None:
        if not self._server.server_is_ready():
            raise NodesError("expected the action execute_chain, it is not there")
        goal = ExecuteChain.Goal(chain=self._chain(draft), refine=refine)
        goal_id = uuid.uuid4()
        self.expect(goal_id.hex, run)
        future = self._server.send_goal_async(goal, goal_uuid=_goal_info(goal_id.hex).goal_id)
        try:
            self._client.until(lambda: run.started or _is_rejected(future), "the status of execute_chain")
        except NodesError:
            with contextlib.suppress(NodesError):  # it may have been accepted, and would not be watched
                self._client.send(self._cancel, CancelGoal.Request(goal_info=_goal_info(goal_id.hex)))
            raise
        if _is_rejected(future):
            raise NodesError("the executor accepts no goal")

    def stop(self) -> None:
        """Cancel the active goal, of any client, and wait until it has ended."""
        goal = self.active_goal
        if goal is None:
            return
        try:
            self._client.call(self._cancel, CancelGoal.Request(goal_info=_goal_info(goal)))
            if self.can_place:
                self.pause(paused=False)  # the robot can brake only while time passes
            self._client.until(lambda: self.active_goal != goal, "the end of the chain")
        finally:
            if self.active_goal == goal:
                self.lose()


def _goal_info(chain_id: str) -> GoalInfo:
    info = GoalInfo()
    info.goal_id.uuid = list(bytes.fromhex(chain_id))
    return info


def _is_rejected(future: Future) -> bool:
    return future.done() and not future.result().accepted


def _curve_from(curve: SearchCurve) -> SubgoalCurve:
    names, totals = tuple(curve.variables), np.asarray(curve.totals, dtype=float)
    values = np.asarray(curve.values, dtype=float).reshape(len(totals), len(names))
    return SubgoalCurve(curve.subgoal, names, values, totals)
