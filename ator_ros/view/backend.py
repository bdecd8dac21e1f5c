"""Client of the running nodes for programs that wait for answers: view, and tools that drive."""

from __future__ import annotations

import contextlib
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PointStamped, PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.srv import GetParameters
from rclpy.task import Future
from std_srvs.srv import SetBool

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import (
    ChainPerformance,
    Objective,
    Outcome,
    Performance,
    Roles,
    SearchCurve,
)
from ator_interfaces.srv import PlaceObject, PlaceRobot, RefineSubgoal
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.nodes.chain_client import ChainClient
from ator_ros.nodes.client_node import ClientNode
from ator_ros.nodes.messages import (
    action_set_from,
    alternative_of,
    chain_from,
    chain_of,
    order_from,
    pose_of,
    situation_of,
)
from ator_ros.nodes.network import NodesError, UnavailableError
from ator_ros.nodes.parameters import STATE, SetupError
from ator_ros.nodes.qos import LATCHED, LATCHED_BY_MANY, RESULTS, SERVICES
from ator_ros.nodes.subscriptions import Subscriptions
from ator_ros.printable import printable
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.view.draft import Draft
from ator_ros.view.runs import OTHERS, Answer, History, Run, plain
from ator_ros.world.readers import MessageError, world_from
from ator_ros.world.state import ObjectState, RobotState, World

_SPIN = 0.02  # real s
# real s after which a request is sent again: DDS drops an answer to a client not yet discovered
_RETRY = 3.0
_DISCOVERY = 2.0  # real s after which a simulation, or a service of the executor, counts as missing
_PLACEMENT_DELAY = 0.1  # real s after which all nodes have received placed states
# s by the stamps after which an object that is not observed is no longer shown
_OBJECT_TIMEOUT = 1.0
# of the executor
_USUAL_SETTINGS = {STATE.name: "odom", "robot_frame": "base_link", "frame": "odom"}
_LONGEST_REASON = 300  # characters
_KEPT_RUNS = 10  # messages about a chain may arrive after the start of the next one


class Backend(ClientNode):
    """Client of simulation, refinement and executor; its node is spun while the program waits.

    Methods raise NodesError if a node does not answer in time or reports a failure.

    Parameters
    ----------
    frame : str
        Frame of odometry and of all poses; empty: the executor's.
    arguments : sequence of str
        ROS arguments, such as the namespace of the robot's nodes.
    check : callable
        Called while messages are processed; raises an error to stop that.
    start_timeout, timeout : float
        Real s for the start of nodes, and for answers of nodes that may end.
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
        super().__init__(
            "view", arguments=arguments, ros_domain=ros_domain, check=check, timeout=start_timeout
        )
        self.domain = domain
        self.libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        self._robot = robot
        self._frame = frame
        self._timeout_attached = timeout
        self.can_place = False  # whether there is a simulation
        self._is_shared = False  # whether that has several robots
        self.paused = False  # whether this client paused time
        self.history = History()  # the executed chains of all clients
        self.path: list[tuple[float, float]] = []  # planned by the active action: x and y in m
        self.learned = ""  # the learned models in use
        self.role = ""  # in its team, if its node `team` runs
        self.refused = ""  # why the last placement was refused
        self._newest: tuple[float, RobotState] | None = None
        self._objects: dict[str, tuple[float, ObjectState]] = {}
        self._active = Run(OTHERS, problem="no goal")
        self._runs = deque([self._active], maxlen=_KEPT_RUNS)
        self._received_at = time.monotonic()
        self._warn = partial(self.node.get_logger().warning, throttle_duration_sec=2.0)
        self._connect()

    def _connect(self) -> None:
        node = self.node
        subscribe = node.create_subscription
        subscribe(ChainPerformance, "chain_under_way", self._take_status, LATCHED)
        subscribe(ChainPerformance, "performance/chain", self._take_record, LATCHED_BY_MANY)
        subscribe(Path, "planned_path", self._take_path, LATCHED)
        subscribe(Roles, "roles", self._take_roles, LATCHED)
        subscribe(DiagnosticArray, "/diagnostics", self._take_diagnostics, RESULTS)
        self._place_robot = node.create_client(PlaceRobot, "place_robot", qos_profile=SERVICES)
        self._place_objects = {
            name: node.create_client(PlaceObject, f"place_{name}", qos_profile=SERVICES)
            for name in self._robot.scene.objects
        }
        self._pause = node.create_client(SetBool, "pause", qos_profile=SERVICES)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        self._settings = node.create_client(GetParameters, "executor/get_parameters")
        self._chains = ChainClient(node, self._lose)

    def ready(self, *, simulated: bool, refinement: bool = True) -> None:
        """Wait for the executor and, if requested, for refinement and simulation."""
        if simulated:
            self.until(self._simulation_is_ready, "the simulation's services")
        if refinement:
            self.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self.until(self._chains.is_ready, "the action execute_chain")
        settings = self._executor_settings()
        self._frame = settings["frame"] = self._frame or settings["frame"]
        try:
            Subscriptions(
                self.node,
                settings,
                self._robot,
                map(self.domain.source, self.domain.objects),
                take_robot=self._take_robot,
                take_object=self._take_object,
                warn=self._warn,
            )
        except SetupError as error:
            raise NodesError(str(error)) from error
        if not simulated:
            self.spin(_DISCOVERY)
            # these nodes may end, and the page waits for answers
            self.timeout = self._timeout_attached
        self.can_place = self._simulation_is_ready()
        nodes = self.node.get_node_names_and_namespaces()
        is_own = ("simulation", self.node.get_namespace()) in nodes
        self._is_shared = not is_own and ("simulation", "/") in nodes

    def _simulation_is_ready(self) -> bool:
        clients = (self._place_robot, self._pause, *self._place_objects.values())
        return all(client.service_is_ready() for client in clients)

    def _executor_settings(self) -> dict[str, str]:
        """Return the executor's parameters for the source of the robot's state."""
        if not self._settings.wait_for_service(_DISCOVERY):
            return dict(_USUAL_SETTINGS)
        answer = self._call(self._settings, GetParameters.Request(names=list(_USUAL_SETTINGS)))
        values = (value.string_value for value in answer.values)
        given = dict(zip(_USUAL_SETTINGS, values, strict=False))
        return {name: given.get(name) or usual for name, usual in _USUAL_SETTINGS.items()}

    def close(self) -> None:
        """Resume time if it is paused, and destroy the node."""
        if self.paused:
            with contextlib.suppress(NodesError):
                self.pause(paused=False)
        super().close()

    # Waiting

    def _call(self, client: Any, request: Any) -> Any:
        """Call a service and return its answer.

        The request must be idempotent: it may be sent again.
        """
        future = self._send(client, request)
        retry_at = time.monotonic() + _RETRY

        def answered() -> bool:
            nonlocal future, retry_at
            if not future.done() and time.monotonic() > retry_at:
                client.remove_pending_request(future)
                future = self._send(client, request)
                retry_at = time.monotonic() + _RETRY
            return bool(future.done())

        self.until(answered, f"an answer of the service {client.srv_name}")
        answer = future.result()
        if not getattr(answer, "success", True):
            raise NodesError(f"{client.srv_name}: {answer.message}")
        return answer

    def _send(self, client: Any, request: Any) -> Future:
        """Call a service without waiting for the answer."""
        if not client.service_is_ready():
            raise UnavailableError(f"expected the service {client.srv_name}, it is not there")
        future: Future = client.call_async(request)
        return future

    # State

    def _take_robot(self, stamp: float, robot: RobotState) -> None:
        self._newest = stamp, robot
        self._received_at = time.monotonic()
        world = self.world()
        if world is not None and not self._active.ended:
            self._active.observe(world)

    def _take_object(self, name: str, stamp: float, state: ObjectState) -> None:
        self._objects[name] = stamp, state

    def _take_path(self, message: Path) -> None:
        places = [pose.pose.position for pose in message.poses]
        points = [(place.x, place.y) for place in places]
        self.path = points if np.isfinite(points).all() else []

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        refinement = f"{self.node.get_namespace().rstrip('/')}/refinement"
        for status in message.status:
            if status.name == refinement:
                learned = (each.value for each in status.values if each.key == "learned set")
                self.learned = printable(next(learned, ""), _LONGEST_REASON)

    def state_age(self) -> float:
        """Return the real s since the last state of the robot."""
        return time.monotonic() - self._received_at

    def world(self) -> World | None:
        """Return the newest state, without objects that are no longer observed.

        None before the first.
        """
        if self._newest is None:
            return None
        now, robot = self._newest
        objects = {
            name: state
            for name, (stamp, state) in self._objects.items()
            if abs(now - stamp) < _OBJECT_TIMEOUT
        }
        return World(now, robot, objects)

    # Refinement

    def refine(self, draft: Draft, *, as_given: bool = False) -> Answer:
        """Return the answer of refinement; raises UnavailableError if refinement is not running.

        Values of open variables are placeholders unless `as_given`.
        """
        request = RefineSubgoal.Request(
            want_curve=True, as_given=as_given, **self._fields_of(draft)
        )
        request.situation = situation_of(draft.world, frame=self._frame)
        answer = self._call(self._refine, request)
        if not answer.accepted:
            raise NodesError(answer.reason)
        library = self.libraries[draft.action_set]
        naive = chain_from(answer.original, library, frame=self._frame, where="original")
        chain = chain_from(answer.chain, library, frame=self._frame)
        return Answer(
            naive=replace(naive, sent_as=order_from(answer.original_order)),
            chain=replace(chain, sent_as=order_from(answer.order)),
            refined=answer.refined,
            reason=answer.reason,
            before=_durations_as_sent(answer.before_actions, answer.original_order),
            after=_durations_as_sent(answer.after_actions, answer.best_order),
            curves=tuple(map(_curve_from, answer.curves)),
            chosen=answer.chosen,
            cut_short=answer.cut_short,
        )

    def _fields_of(self, draft: Draft) -> dict[str, Any]:
        """Return chain, alternatives and weights of a draft as fields of requests and goals."""
        frame = self._frame
        return {
            "chain": chain_of(draft.chain, action_set=draft.action_set, frame=frame),
            "alternatives": [alternative_of(each, frame=frame) for each in draft.alternatives],
            "objective": Objective(**draft.weights),
        }

    # Simulation

    def place_robot(self, pose: Pose) -> None:
        """Place the robot at rest; does not wait."""
        self._send(self._place_robot, _robot_at(pose)).add_done_callback(self._take_placement)

    def place_object(self, name: str, x: float, y: float) -> None:
        """Place an object at (x, y) m, at rest; does not wait."""
        sent = self._send(self._place_objects[name], _object_at(x, y))
        sent.add_done_callback(self._take_placement)

    def _take_placement(self, future: Future) -> None:
        answer = future.result()
        self.refused = ""
        if answer is not None and not answer.success:
            self.refused = printable(answer.message, _LONGEST_REASON)

    def place(self, world: World) -> None:
        """Place robot and objects, remove other objects, and wait until the nodes received that.

        Time is paused afterwards, unless other robots use the same simulation, or this fails.
        """
        stays_paused = False
        try:
            self.pause(paused=True)
            for client in self._place_objects.values():
                self._call(client, PlaceObject.Request(remove=True))
            self._call(self._place_robot, _robot_at(world.robot.pose))
            for name, state in world.objects.items():
                if name in self._place_objects:
                    self._call(self._place_objects[name], _object_at(state.x, state.y))
            self.spin(_PLACEMENT_DELAY)
            stays_paused = not self._is_shared
            self.refused = ""
        finally:
            if not stays_paused:
                self._resume()

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
        self.paused = paused or self.paused  # without an answer, time may be paused
        self._call(self._pause, SetBool.Request(data=paused))
        self.paused = paused

    def _resume(self) -> None:
        """Resume time; does not wait, and does not fail if the simulation has ended."""
        self._pause.call_async(SetBool.Request(data=False))
        self.paused = False

    # Execution

    @property
    def external(self) -> Run | None:
        """The last goal, active or ended, if another client sent it."""
        return self._active if self._active.chain_id and self._active.label == OTHERS else None

    def drive(self, label: str, draft: Draft, *, refine: bool) -> Run:
        """Execute the chain of a draft to its end, or cancel it if this is interrupted.

        Raises NodesError if the chain is lost.
        """
        run = Run(label)
        try:
            self.execute(run, draft, refine=refine)
            while not run.ended:
                self.spin(_SPIN)
        finally:
            try:
                if self._active is run:  # not the goal of another client
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
            if self.paused or self.can_place:  # another page may have paused time
                self._resume()

    def _start(self, run: Run, draft: Draft, *, refine: bool) -> None:
        goal = ExecuteChain.Goal(refine=refine, **self._fields_of(draft))
        sent = self._chains.send(goal)
        run.chain_id = sent.chain_id
        self._runs.append(run)
        self._active = run
        sent.result.add_done_callback(partial(self._take_result, run))
        try:
            self.until(lambda: run.record or run.problem, "the status of execute_chain")
        except NodesError:
            sent.cancel()  # it may have been accepted, and would not be monitored
            raise
        if run.problem:
            raise NodesError(run.problem)

    def _take_result(self, run: Run, future: Future) -> None:
        """Take the result of our goal; its record is empty if the executor never had or lost it."""
        result = future.result()
        if run.ended:
            return
        if result.record.chain_id:
            run.record = result.record
        else:
            run.problem = result.outcome.reason

    def stop(self) -> None:
        """Cancel the active goal, of any client, and wait until it has ended."""
        run = self._active
        if run.ended:
            return
        self._chains.cancel(run.chain_id)
        try:
            if self.can_place:
                self.pause(paused=False)  # the robot can brake only while time passes
            self.until(lambda: run.ended or self._active is not run, "the end of the chain")
        finally:
            if self._active is run:
                self._lose("the executor does not answer")

    def _lose(self, reason: str) -> None:
        """End the active run, if it has not ended: its executor does not answer."""
        if not self._active.ended:
            self._active.problem = f"lost: {reason}"

    def _run_of(self, chain_id: str) -> Run | None:
        return next((run for run in self._runs if run.chain_id == chain_id), None)

    def _take_roles(self, message: Roles) -> None:
        self.role = plain(message.role)

    def _take_status(self, message: ChainPerformance) -> None:
        run = self._run_of(message.chain_id)
        if run is None or run.label == OTHERS:
            try:
                draft = self._draft_from(message)
            except MessageError as error:
                self._warn(f"chain_under_way: ignored: {error}")
                return
            if run is None:
                run = Run(OTHERS, chain_id=message.chain_id)
                self._runs.append(run)
            run.draft = draft
        if not run.ended:
            self._active = run
            run.record = message

    def _draft_from(self, message: ChainPerformance) -> Draft:
        """Return the goal of another client in its order as sent; raises MessageError."""
        if not re.fullmatch("[0-9a-f]{32}", message.chain_id):
            raise MessageError("chain_id: expected 32 hexadecimal digits")
        action_set = action_set_from(message.chain, allowed=self.libraries)
        chain = chain_from(message.chain, self.libraries[action_set], frame=self._frame)
        if message.order:
            if sorted(message.order) != list(range(len(chain))):
                raise MessageError(f"order: expected {len(chain)} different indices")
            chain = chain.reordered(np.argsort(message.order).tolist())
        start = world_from(message.start, frame=self._frame, where="start")
        return Draft(start, chain, action_set)

    def _take_record(self, message: ChainPerformance) -> None:
        run = self._run_of(message.chain_id)
        # the last status may be lost: only the newest one is kept
        if run is not None and not run.ended:
            run.record = message
        if message.outcome.code == Outcome.REFUSED:
            return
        try:
            self.history.add(message)
        except MessageError as error:
            self._warn(f"performance/chain: ignored: {error}")


def _durations_as_sent(actions: Iterable[Performance], order: Iterable[int]) -> tuple[float, ...]:
    """Return durations in s in the order as sent; `order` has the index as sent of each action."""
    durations = (action.duration for action in actions)
    return tuple(duration for _, duration in sorted(zip(order, durations, strict=True)))


def _curve_from(curve: SearchCurve) -> SubgoalCurve:
    names = tuple(curve.variables)
    totals = np.asarray(curve.totals, dtype=float)
    values = np.asarray(curve.values, dtype=float)
    table = values.reshape(len(totals), len(names))
    return SubgoalCurve(curve.subgoal, names, table, totals)


def _robot_at(pose: Pose) -> PlaceRobot.Request:
    return PlaceRobot.Request(pose=PoseStamped(pose=pose_of(pose)))


def _object_at(x: float, y: float) -> PlaceObject.Request:
    return PlaceObject.Request(position=PointStamped(point=Point(x=x, y=y)))
