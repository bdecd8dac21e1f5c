"""A view's stage on ROS: it listens, places, asks for refinement and sends chains."""

from __future__ import annotations

import math
import threading
import time
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, Outcome
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.advice import advice_from, goal_of, request_of
from ator_ros.nodes.checks import MessageError, bounds_of
from ator_ros.nodes.conversions import robot_from
from ator_ros.nodes.heard import Heard
from ator_ros.nodes.object_sources import ObjectSources, Reader
from ator_ros.nodes.placing import Placing
from ator_ros.nodes.qos import RESULTS, SENSOR_DATA, SERVICES
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.nodes.tf_listener import TfListener
from ator_ros.robot.description import Robot
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.runs import Run
from ator_ros.viewing.stage import AbsentError, StageError
from ator_ros.world.state import ObjectState, RobotState, World

_NEAR = 0.02
_PATIENCE = 5.0
"""Real s that an answer of nodes may take that are not ours to watch."""
_DISCOVERY = 2.0
"""Real s after which a simulation that has not been found is taken for missing."""
_FORGOTTEN = 1.0
"""Seconds by the stamps after which an object that nobody sees is taken for gone."""


class LiveStage:
    """Nodes that run, seen and used through a node of its own.

    Parameters
    ----------
    own : SpunNode
        Not started yet.
    domain, robot : Domain, Robot
        What is played, and by whom.
    frame : str
        The frame of odometry and goals.
    """

    def __init__(self, own: SpunNode, domain: Domain, robot: Robot, *, frame: str = "odom") -> None:
        self._own, self._frame = own, frame
        self._libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        self._robot: tuple[float, RobotState] | None = None
        self._objects: dict[str, tuple[float, ObjectState]] = {}
        self._heard_at = time.monotonic()
        self._run: Run | None = None
        self._goal: Any = None
        self.can_place = False
        node = own.node
        self._heard = Heard(node)
        self.history = self._heard.history
        sources = map(domain.source, domain.objects)
        tf, bounds = TfListener(node), bounds_of(robot)
        self._sources = ObjectSources(node, sources, self._take_object, tf, frame=frame, bounds=bounds)
        node.create_subscription(Odometry, "odom", self._take_odom, SENSOR_DATA)
        node.create_subscription(ActionPerformance, "performance/action", self._take_action, RESULTS)
        self._placing = Placing(own, robot.scene.objects)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        self._factors = [  # of a simulation of this robot, or of several
            node.create_client(SetParameters, f"{space}simulation/set_parameters") for space in ("", "/")
        ]
        self._server = ActionClient(node, ExecuteChain, "execute_chain")

    def ready(self, *, simulated: bool) -> None:
        """Wait until refinement and executor answer, and where it is `simulated` the simulation, too.

        Raises
        ------
        StageError
            One did not in time.
        """
        if simulated:
            self._placing.ready()
        self._own.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self._own.until(self._server.server_is_ready, "the action execute_chain")
        self._own.meet("execute_chain")
        self.can_place = simulated or self._placing.offered(_DISCOVERY)
        if not simulated:  # they may end, and the page waits for every answer
            self._own.patience = _PATIENCE

    # What is heard

    def _take_odom(self, message: Odometry) -> None:
        try:
            self._robot = robot_from(message, frame=self._frame)
            self._heard_at = time.monotonic()
        except MessageError as error:
            self._own.node.get_logger().warning(f"ignored: {error}", throttle_duration_sec=2.0)

    def _take_object(self, name: str, read: Reader, message: Any) -> None:
        try:
            self._objects[name] = read(message)
        except MessageError as error:
            self._own.node.get_logger().warning(f"ignored: {error}", throttle_duration_sec=2.0)

    def _take_action(self, message: ActionPerformance) -> None:
        run = self._run
        if run is not None and not run.ended and message.outcome.code == Outcome.SUCCEEDED:
            run.actual.append(message.actual.duration)

    @property
    def silence(self) -> float:
        """Real s since the last odometry."""
        return time.monotonic() - self._heard_at

    @property
    def learned(self) -> str:
        """What the refinement node tells of the learned set of models in use."""
        return self._heard.learned

    def way(self) -> FloatArray | None:
        """Return the way that the executor last said is planned."""
        return self._heard.way

    def world(self) -> World | None:
        """Return the newest state; objects that nobody sees any more are not in it."""
        if self._robot is None:
            return None
        now, robot = self._robot
        seen = list(self._objects.items())
        objects = {name: there for name, (when, there) in seen if abs(now - when) < _FORGOTTEN}
        return World(now, robot, objects)

    # Refinement

    def refine(self, draft: Draft) -> Advice:
        """Ask the node `refinement`."""
        library = self._libraries[draft.action_set]
        if not self._refine.service_is_ready():
            raise AbsentError(f"expected the service {self._refine.srv_name}, it is not there")
        request = request_of(draft, frame=self._frame)
        answer = self._own.call(self._refine, request)
        if not answer.accepted:
            raise StageError(answer.reason)
        try:
            return advice_from(answer, library, frame=self._frame)
        except MessageError as error:
            raise StageError(str(error)) from error

    # Simulation

    def place_robot(self, pose: Pose) -> None:
        """Put the robot somewhere, at rest; not waited for."""
        self._placing.robot(pose)

    def place_object(self, name: str, x: float, y: float) -> None:
        """Put an object somewhere (m), at rest; not waited for."""
        self._placing.object(name, x, y)

    def place(self, world: World) -> None:
        """Put everything to its place and wait until it is seen there; time then stands still."""
        self._placing.everything(world)
        self._own.until(partial(self._is_there, world), "robot and objects at their start")

    def _is_there(self, wanted: World) -> bool:
        seen = self.world()
        if seen is None or seen.robot.pose.distance(wanted.robot.pose) > _NEAR:
            return False
        pairs = [
            (there, seen.objects.get(name))
            for name, there in wanted.objects.items()
            if self._placing.knows(name)
        ]
        return all(o is not None and math.hypot(o.x - there.x, o.y - there.y) < _NEAR for there, o in pairs)

    def pause(self, *, paused: bool) -> None:
        """Let time stand still, or go on."""
        self._placing.pause(paused=paused)

    def set_factor(self, factor: float) -> None:
        """Set the simulated seconds per real second."""
        value = Parameter("real_time_factor", value=factor).to_parameter_msg()
        there = [client for client in self._factors if client.service_is_ready()] or self._factors
        answer = self._own.call(there[0], SetParameters.Request(parameters=[value]))
        if not answer.results[0].successful:
            raise StageError(answer.results[0].reason)

    # Execution

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        """Start to execute a chain, and let time go on once the executor steers."""
        goal = goal_of(draft, frame=self._frame, refine=refine)
        self._run = run
        told = threading.Event()

        def hear(feedback: Any) -> None:
            run.status = f"{feedback.feedback.top}: {feedback.feedback.status}"
            told.set()

        future = self._own.within(lambda: self._server.send_goal_async(goal, feedback_callback=hear))
        self._goal = handle = self._own.answer(future, "execute_chain")
        if not handle.accepted:
            raise StageError("the executor accepts no goal")
        ended = self._own.within(handle.get_result_async)
        ended.add_done_callback(partial(_finish, run))
        self._own.until(lambda: told.is_set() or ended.done(), "feedback of execute_chain")
        if self.can_place:
            self.pause(paused=False)

    def stop(self) -> None:
        """Cancel what is executed; wait until it has ended."""
        run, handle = self._run, self._goal
        if run is None or run.ended or handle is None:
            return
        try:
            if self.can_place:
                self.pause(paused=False)  # the robot can stand only in time
            self._own.within(handle.cancel_goal_async)
            self._own.until(lambda: run.ended, "the end of the chain")
        finally:
            if not run.ended:  # whoever executed it is gone; nothing will end it any more
                run.ended, run.status = True, "lost: the executor does not answer"


def _finish(run: Run, future: Future) -> None:
    answer = future.result()
    if answer is None:
        run.status = "no result"
    else:
        record = answer.result.record
        is_done = answer.result.outcome.code == Outcome.SUCCEEDED
        run.actual[:] = [action.actual.duration for action in record.actions]
        run.duration = record.actual.duration if is_done else math.nan
        run.status = f"{'done' if is_done else answer.result.outcome.reason} ({record.refinement})"
    run.ended = True
