"""Running nodes, observed and used by programs that wait for answers: the view, and tools that drive."""

from __future__ import annotations

import contextlib
import math
import re
import time
import uuid
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import rclpy
from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ChainPerformance, Objective, Outcome, SearchCurve
from ator_interfaces.srv import PlaceObject, PlaceRobot, RefineSubgoal
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.inputs import Subscriptions
from ator_ros.nodes.messages import action_set_from, chain_from, chain_of, pose_of, situation_of
from ator_ros.nodes.network import NodesError, UnavailableError
from ator_ros.nodes.parameters import STATE, SetupError
from ator_ros.nodes.qos import LATCHED, LATCHED_BY_MANY, RESULTS, SERVICES
from ator_ros.nodes.running import uninterrupted
from ator_ros.printable import printable
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.robot.description import Robot
from ator_ros.view.draft import Draft
from ator_ros.view.runs import OTHERS, Answer, History, Run
from ator_ros.world.messages import MessageError, world_from
from ator_ros.world.state import ObjectState, RobotState, World

_SPIN = 0.02
_RETRY = 3.0  # real s after which a request is sent again: DDS drops an answer to a client not yet discovered
_DISCOVERY = 2.0  # real s after which a simulation, or a service of the executor, counts as missing
_PLACED = 0.1  # real s after which all nodes have received what the simulation has placed
_GONE = 5.0  # real s without an executor after which its chain counts as lost
_OBJECT_TIMEOUT = 1.0  # s by the stamps after which an object that is not observed is no longer shown
_WARNING_PERIOD = 2.0
_ROBOT_FROM = {STATE.name: "odom", "robot_frame": "base_link", "frame": "odom"}
"""Parameters of the executor, unless it has others."""
_LONGEST_REASON = 300


class Backend:
    """Simulation or robot, refinement and executor, through a node that is spun while its program waits.

    Methods raise NodesError without an answer in time, or if a node answers that it failed.

    Parameters
    ----------
    frame : str
        Frame of odometry, in which all poses are; empty: that of the executor.
    ros_domain : int, optional
        By default that of the environment.
    arguments : sequence of str
        ROS arguments, such as the namespace of the robot's nodes.
    check : callable
        Called while waiting; raises to end it.
    start_timeout, timeout : float
        Real s that nodes may take to start, and that an answer may take of nodes that may end.

    Attributes
    ----------
    can_place, paused : bool
        Whether robot and objects can be placed, as in a simulation, and whether time is paused from here.
    history : History
        The executed chains, of all clients.
    external : Run or None
        The last goal of another client, active or ended; None if the last goal was ours.
    path : ndarray, shape (n, 2), or None
        The planned path of the active action: x and y in m.
    learned, refused : str
        The learned set of models in use; why robot or object were not placed as requested last; or empty.
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
        self.domain, self._robot, self._frame, self._check = domain, robot, frame, check
        self._timeout, self._timeout_attached = start_timeout, timeout
        self.libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        self.can_place = self._is_shared = self.paused = False
        self.history = History()
        self.external: Run | None = None
        self.path: FloatArray | None = None
        self.learned = self.refused = ""
        self._newest: tuple[float, RobotState] | None = None
        self._objects: dict[str, tuple[float, ObjectState]] = {}
        self._own_runs: dict[str, Run] = {}
        """Our runs by the id of their chain; ended ones are dropped when the next one starts."""
        self._own_ids: set[str] = set()
        """The ids of the chains of all our runs: messages about a chain may arrive after its end."""
        self._active = ("", Run(OTHERS, problem="no goal"))
        self._received_at = self._executor_at = time.monotonic()
        self._executors = 0
        self._context = rclpy.Context()
        try:
            self._context.init(args=list(arguments), domain_id=ros_domain)
            self.node = Node("view", context=self._context)
        except RuntimeError as cause:  # of rcl, in several lines
            text = " ".join(str(cause).split())
            raise NodesError(f"expected arguments of ROS, got {list(arguments)}: {text}") from cause
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._connect()

    def _connect(self) -> None:
        node, name = self.node, f"{self.node.get_namespace().rstrip('/')}/refinement"
        self._status = node.create_subscription(
            ChainPerformance, "chain_under_way", self._take_status, LATCHED
        )
        node.create_subscription(ChainPerformance, "performance/chain", self._take_record, LATCHED_BY_MANY)
        node.create_subscription(Path, "planned_path", self._take_path, LATCHED)
        node.create_subscription(DiagnosticArray, "/diagnostics", partial(self._take_health, name), RESULTS)
        self._place_robot = node.create_client(PlaceRobot, "place_robot", qos_profile=SERVICES)
        self._place_objects = {
            name: node.create_client(PlaceObject, f"place_{name}", qos_profile=SERVICES)
            for name in self._robot.scene.objects
        }
        self._pause = node.create_client(SetBool, "pause", qos_profile=SERVICES)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        self._settings = node.create_client(GetParameters, "executor/get_parameters")
        self._server = ActionClient(node, ExecuteChain, "execute_chain")
        self._cancel = node.create_client(CancelGoal, "execute_chain/_action/cancel_goal")

    def ready(self, *, simulated: bool, refinement: bool = True) -> None:
        """Wait for the executor, for `refinement`, and if `simulated` for the simulation."""
        if simulated:
            self.until(self._simulation_is_there, "the simulation's services")
        if refinement:
            self.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self.until(self._server.server_is_ready, "the action execute_chain")
        settings = self._robot_settings()
        self._frame = settings["frame"] = self._frame or settings["frame"]
        try:
            Subscriptions(
                self.node, settings, self._robot, map(self.domain.source, self.domain.objects),
                take_robot=self._take_robot, take_object=self._take_object, warn=self._warn,
            )  # fmt: skip
        except SetupError as error:
            raise NodesError(str(error)) from error
        if not simulated:
            self.spin(_DISCOVERY)
            self._timeout = self._timeout_attached  # nodes may end, and the page waits for every answer
        self.can_place = self._simulation_is_there()
        nodes, namespace = self.node.get_node_names_and_namespaces(), self.node.get_namespace()
        self._is_shared = ("simulation", namespace) not in nodes and ("simulation", "/") in nodes

    def _simulation_is_there(self) -> bool:
        clients = (self._place_robot, self._pause, *self._place_objects.values())
        return all(client.service_is_ready() for client in clients)

    def _robot_settings(self) -> dict[str, str]:
        """Ask the executor for the source of the robot's state."""
        if not self._settings.wait_for_service(_DISCOVERY):
            return _ROBOT_FROM
        answer = self._call(self._settings, GetParameters.Request(names=list(_ROBOT_FROM)))
        values = dict(zip(_ROBOT_FROM, (value.string_value for value in answer.values), strict=False))
        return {name: values.get(name) or usual for name, usual in _ROBOT_FROM.items()}

    def close(self) -> None:
        """Resume time if it is paused, and destroy the node."""
        if self.paused:
            with contextlib.suppress(NodesError):
                self.pause(paused=False)
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    # Waiting

    def spin(self, seconds: float) -> None:
        """Take messages for so many real s; a chain whose executor has gone or was restarted ends as lost."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._take(min(left, _SPIN))
        now, former = time.monotonic(), self._executors
        self._executors = self.node.count_publishers(self._status.topic_name)
        if self._executors:
            self._executor_at = now
        # One that was killed counts for 20 s: with it, one that was restarted is the second.
        if now - self._executor_at > _GONE or self._executors > max(former, 1):
            self._lose()

    def _take(self, seconds: float) -> None:
        """Take at most one message within so many real s."""
        with uninterrupted():
            self._executor.spin_once(timeout_sec=seconds)

    def until(self, happened: Callable[[], object], what: str, timeout: float | None = None) -> None:
        """Wait until something has happened; by default as long as for an answer."""
        limit = self._timeout if timeout is None else timeout
        end = time.monotonic() + limit
        while not happened():
            self._check()
            if time.monotonic() > end:
                raise NodesError(f"expected {what} within {limit:g} s, it did not come")
            self._take(_SPIN)

    def _call(self, client: Any, request: Any) -> Any:
        """Call a service and return its answer; the request must be idempotent: it may be sent again."""
        future, again_at = self._send(client, request), time.monotonic() + _RETRY

        def answered() -> bool:
            nonlocal future, again_at
            if not future.done() and time.monotonic() > again_at:
                client.remove_pending_request(future)
                future, again_at = self._send(client, request), time.monotonic() + _RETRY
            return bool(future.done())

        self.until(answered, f"an answer of the service {client.srv_name}")
        answer = future.result()
        if not getattr(answer, "success", True):
            raise NodesError(f"{client.srv_name}: {answer.message}")
        return answer

    def _send(self, client: Any, request: Any) -> Future:
        """Call a service; do not wait for the answer."""
        if not client.service_is_ready():
            raise UnavailableError(f"expected the service {client.srv_name}, it is not there")
        future: Future = client.call_async(request)
        return future

    def _warn(self, text: str) -> None:
        self.node.get_logger().warning(text, throttle_duration_sec=_WARNING_PERIOD)

    # State

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._newest, self._received_at = (stamp, robot), time.monotonic()
        _, run = self._active
        if not run.ended:
            run.record_pose(stamp, robot.pose)

    def _take_object(self, name: str, stamp: float, there: ObjectState) -> None:
        self._objects[name] = stamp, there

    def _take_path(self, message: Path) -> None:
        places = [(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]
        self.path = np.array(places) if places and np.isfinite(places).all() else None

    def _take_health(self, node: str, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == node:
                learned = (each.value for each in status.values if each.key == "learned set")
                self.learned = printable(next(learned, ""), _LONGEST_REASON)

    def silence(self) -> float:
        """Return the real s since the last state of the robot."""
        return time.monotonic() - self._received_at

    def world(self) -> World | None:
        """Return the newest state, None before the first; objects not observed any more are not in it."""
        if self._newest is None:
            return None
        now, robot = self._newest
        known = self._objects.items()
        objects = {name: there for name, (stamp, there) in known if abs(now - stamp) < _OBJECT_TIMEOUT}
        return World(now, robot, objects)

    # Refinement

    def refine(self, draft: Draft, *, as_given: bool = False) -> Answer:
        """Return the answer of refinement; raises UnavailableError if refinement is not running.

        Values of open variables are placeholders, unless `as_given`.
        """
        answer = self._call(
            self._refine,
            RefineSubgoal.Request(
                situation=situation_of(draft.world, frame=self._frame),
                want_curve=True,
                as_given=as_given,
                **self._written(draft),
            ),
        )
        if not answer.accepted:
            raise NodesError(answer.reason)
        library = self.libraries[draft.action_set]
        return Answer(
            chain_from(answer.original, library, frame=self._frame, where="original"),
            chain_from(answer.chain, library, frame=self._frame),
            answer.refined,
            answer.reason,
            tuple(action.duration for action in answer.before_actions),
            tuple(action.duration for action in answer.after_actions),
            tuple(map(_curve_from, answer.curves)),
            answer.chosen,
        )

    def _written(self, draft: Draft) -> dict[str, Any]:
        """Write chain, alternatives and weights of a draft, by the fields of requests and goals."""
        chains = (draft.chain, *draft.alternatives)
        chain, *others = (chain_of(each, action_set=draft.action_set, frame=self._frame) for each in chains)
        return {"chain": chain, "alternatives": others, "objective": Objective(**draft.weights)}

    # Simulation

    def place_robot(self, pose: Pose) -> None:
        """Place the robot at rest; does not wait."""
        self._send(self._place_robot, _at_pose(pose)).add_done_callback(self._placed)

    def place_object(self, name: str, x: float, y: float) -> None:
        """Place an object at (x, y) m, at rest; does not wait."""
        self._send(self._place_objects[name], _at_point(x, y)).add_done_callback(self._placed)

    def _placed(self, future: Future) -> None:
        answer = future.result()
        self.refused = "" if answer is None or answer.success else printable(answer.message, _LONGEST_REASON)

    def place(self, world: World) -> None:
        """Place robot and objects, remove other objects, and wait until they are observed there.

        Time stands still afterwards, unless other robots live in the same simulation, or this fails.
        """
        stays_paused = False
        try:
            self.pause(paused=True)
            for client in self._place_objects.values():
                self._call(client, PlaceObject.Request(remove=True))
            self._call(self._place_robot, _at_pose(world.robot.pose))
            for name, there in world.objects.items():
                if name in self._place_objects:
                    self._call(self._place_objects[name], _at_point(there.x, there.y))
            self.spin(_PLACED)
            stays_paused, self.refused = not self._is_shared, ""
        finally:
            if not stays_paused:
                self._resume()

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self.paused = paused or self.paused  # without an answer it may be either
        self._call(self._pause, SetBool.Request(data=paused))
        self.paused = paused

    def _resume(self) -> None:
        """Resume time; does not wait, and it is no error if the simulation has ended."""
        self._pause.call_async(SetBool.Request(data=False))
        self.paused = False

    # Execution

    def drive(self, label: str, draft: Draft, *, refine: bool) -> Run:
        """Execute the chain of a draft to its end, or cancel it if this is interrupted.

        Raises NodesError if the chain is lost.
        """
        run = Run(label)
        try:
            self.execute(run, draft, refine=refine)
            self.until(lambda: run.ended, "the record of the chain", math.inf)
        finally:
            try:
                if self._active[1] is run:  # not the goal of another client
                    self.stop()
            except NodesError as error:
                raise NodesError(f"the robot may still drive: {error}") from error
        if run.problem:
            raise NodesError(run.problem)
        return run

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        """Start to execute the chain of a draft, and keep `run` up to date.

        Time is resumed once the executor controls the robot, or if this fails.
        """
        try:
            self._start(run, draft, refine=refine)
        finally:
            if self.paused or self.can_place:  # another page may have paused it
                self._resume()

    def _start(self, run: Run, draft: Draft, *, refine: bool) -> None:
        if not self._server.server_is_ready():
            raise NodesError("expected the action execute_chain, it is not there")
        goal_id = uuid.uuid4()
        ongoing = {name: other for name, other in self._own_runs.items() if not other.ended}
        self._own_runs = {**ongoing, goal_id.hex: run}
        self._own_ids.add(goal_id.hex)
        self._active = goal_id.hex, run
        goal = ExecuteChain.Goal(refine=refine, **self._written(draft))
        future = self._server.send_goal_async(goal, goal_uuid=_goal_info(goal_id.hex).goal_id)
        try:
            self.until(lambda: run.record or _is_rejected(future), "the status of execute_chain")
        except NodesError:
            with contextlib.suppress(NodesError):  # it may have been accepted, and would not be watched
                self._send(self._cancel, CancelGoal.Request(goal_info=_goal_info(goal_id.hex)))
            raise
        if _is_rejected(future):
            run.problem = "the executor accepts no goal"
            raise NodesError(run.problem)

    def stop(self) -> None:
        """Cancel the active goal, of any client, and wait until it has ended."""
        chain_id, run = self._active
        if run.ended:
            return
        try:
            self._call(self._cancel, CancelGoal.Request(goal_info=_goal_info(chain_id)))
            if self.can_place:
                self.pause(paused=False)  # the robot can brake only while time passes
            self.until(lambda: run.ended or self._active[1] is not run, "the end of the chain")
        finally:
            if self._active[1] is run:
                self._lose()

    def _lose(self) -> None:
        """End the active run, if it has not ended: its executor does not answer."""
        _, run = self._active
        if not run.ended:
            run.problem = "lost: the executor does not answer"

    def _run_of(self, chain_id: str) -> Run | None:
        """Return our run of a chain, or the external one; None for other chains and for dropped runs."""
        if self.external is not None and self.external.record.chain_id == chain_id:
            return self.external
        return self._own_runs.get(chain_id)

    def _take_status(self, message: ChainPerformance) -> None:
        run, self.external = self._run_of(message.chain_id), None
        if message.chain_id not in self._own_ids:
            try:
                draft = self._draft_from(message)
            except MessageError as error:
                self._warn(f"chain_under_way: ignored: {error}")
                return
            self.external = run = Run(OTHERS) if run is None else run
            run.draft = draft
        if run is not None and not run.ended:
            self._active, run.record = (message.chain_id, run), message

    def _draft_from(self, message: ChainPerformance) -> Draft:
        """Read another client's goal; raises MessageError."""
        if not re.fullmatch("[0-9a-f]{32}", message.chain_id):
            raise MessageError("chain_id: expected 32 hexadecimal digits")
        action_set = action_set_from(message.chain, allowed=self.libraries)
        chain = chain_from(message.chain, self.libraries[action_set], frame=self._frame)
        start = world_from(message.start, frame=self._frame, where="start")
        return Draft(start, chain, action_set)

    def _take_record(self, message: ChainPerformance) -> None:
        run = self._run_of(message.chain_id)
        if run is not None and not run.ended:  # of the status only the newest message is sure to arrive
            run.record = message
        if message.outcome.code == Outcome.REFUSED:
            return
        try:
            self.history.add(message)
        except MessageError as error:
            self._warn(f"performance/chain: ignored: {error}")


def _curve_from(curve: SearchCurve) -> SubgoalCurve:
    names, totals = tuple(curve.variables), np.asarray(curve.totals, dtype=float)
    values = np.asarray(curve.values, dtype=float).reshape(len(totals), len(names))
    return SubgoalCurve(curve.subgoal, names, values, totals)


def _goal_info(chain_id: str) -> GoalInfo:
    info = GoalInfo()
    info.goal_id.uuid = list(bytes.fromhex(chain_id))
    return info


def _is_rejected(future: Future) -> bool:
    return future.done() and not future.result().accepted


def _at_pose(pose: Pose) -> PlaceRobot.Request:
    request = PlaceRobot.Request()
    request.pose.pose = pose_of(pose)
    return request


def _at_point(x: float, y: float) -> PlaceObject.Request:
    request = PlaceObject.Request()
    request.position.point.x, request.position.point.y = x, y
    return request
