"""A view's stage on ROS: it listens, places, asks for refinement and sends chains."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from functools import partial

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.task import Future

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import Domain
from ator_ros.geometry import FloatArray, Pose
from ator_ros.nodes.advice import advice_from, goal_of, request_of
from ator_ros.nodes.guests import Guests
from ator_ros.nodes.heard import Heard
from ator_ros.nodes.live_chain import LiveChain
from ator_ros.nodes.parameters import STATE
from ator_ros.nodes.placing import Placing
from ator_ros.nodes.qos import SERVICES
from ator_ros.nodes.seen import SeenWorld
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.robot.description import Robot
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import Guest
from ator_ros.viewing.runs import Run
from ator_ros.viewing.stage import AbsentError, StageError
from ator_ros.world.messages import MessageError
from ator_ros.world.state import World

_PATIENCE = 5.0
"""Real s that an answer of nodes may take that are not ours to watch."""
_DISCOVERY = 2.0
"""Real s after which a simulation, or a service of the executor, that was not found is taken for missing."""
_SEEING = 2.0
"""Real s after which what the simulation says that it has placed is believed to be there, seen or not."""
_LEAVING = 1.0
_ROBOT_FROM = {STATE.name: "odom", "robot_frame": "base_link"}
"""How the robot is seen where its executor does not say it."""


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
        self.can_place = False
        self._is_shared = False
        self._refused: dict[str, str] = {}
        node = own.node
        self._heard = Heard(node)
        self.history = self._heard.history
        self._seen = SeenWorld(node, domain, robot, frame=frame)
        self._placing = Placing(own, robot.scene.objects)
        self._refine = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
        self._factors = [  # of a simulation of this robot, or of several
            node.create_client(SetParameters, f"{space}simulation/set_parameters") for space in ("", "/")
        ]
        self._settings = node.create_client(GetParameters, "executor/get_parameters")
        self._chain = LiveChain(own)
        self._guests = Guests(own, self._libraries, frame=frame, is_ours=self._chain.is_ours)

    def ready(self, *, simulated: bool) -> None:
        """Wait until refinement and executor answer, and where it is `simulated` the simulation, too.

        Raises
        ------
        StageError
            One did not in time.
        SetupError
            The robot's state comes from tf, and tf2_msgs is not installed.
        """
        if simulated:
            self._placing.ready()
        self._own.until(self._refine.service_is_ready, f"the service {self._refine.srv_name}")
        self._chain.ready()
        self._seen.follow(self._robot_from())
        self.can_place = simulated or self._placing.offered(_DISCOVERY)
        alone, several = self._factors
        self._is_shared = not alone.service_is_ready() and several.service_is_ready()
        if not simulated:  # they may end, and the page waits for every answer
            self._own.patience = _PATIENCE

    def _robot_from(self) -> dict[str, str]:
        """Ask the executor where the robot's state comes from."""
        if not self._settings.wait_for_service(_DISCOVERY):
            return _ROBOT_FROM
        answer = self._own.call(self._settings, GetParameters.Request(names=list(_ROBOT_FROM)))
        said = dict(zip(_ROBOT_FROM, (value.string_value for value in answer.values), strict=False))
        return {name: said.get(name) or value for name, value in _ROBOT_FROM.items()}

    def leave(self) -> None:
        """Resume time if this stage has paused it; wait at most a second for the answer."""
        if not self._placing.paused:
            return
        with contextlib.suppress(StageError):
            answer, end = self._placing.go_on(), time.monotonic() + _LEAVING
            while not answer.done() and time.monotonic() < end:
                time.sleep(0.01)

    # What is heard

    @property
    def silence(self) -> float:
        """Real s since the robot was last heard of."""
        return self._seen.silence

    @property
    def learned(self) -> str:
        """The refinement node's report on the learned set of models in use."""
        return self._heard.learned

    def way(self) -> FloatArray | None:
        """Return the way that the executor last said is planned."""
        return self._heard.way

    def world(self) -> World | None:
        """Return the latest state without lost objects."""
        return self._seen.world()

    @property
    def guest(self) -> Guest | None:
        """The chain that somebody else sent last."""
        return self._guests.present

    # Refinement

    def refine(self, draft: Draft, *, as_given: bool = False) -> Advice:
        """Ask the node `refinement`."""
        library = self._libraries[draft.action_set]
        if not self._refine.service_is_ready():
            raise AbsentError(f"expected the service {self._refine.srv_name}, it is not there")
        request = request_of(draft, frame=self._frame, as_given=as_given)
        answer = self._own.call(self._refine, request)
        if not answer.accepted:
            raise StageError(answer.reason)
        try:
            return advice_from(answer, library, frame=self._frame)
        except MessageError as error:
            raise StageError(str(error)) from error

    # Simulation

    @property
    def refused(self) -> str:
        """Why the simulation did not put robot or objects where they were put last; empty if it did."""
        return "; ".join(f"{name}: {why}" for name, why in tuple(self._refused.items()))

    def place_robot(self, pose: Pose) -> None:
        """Put the robot somewhere, at rest; not waited for."""
        self._send("robot", partial(self._placing.robot, pose))

    def place_object(self, name: str, x: float, y: float) -> None:
        """Put an object somewhere (m), at rest; not waited for."""
        self._send(name, partial(self._placing.object, name, x, y))

    def _send(self, name: str, place: Callable[[], Future]) -> None:
        try:
            place().add_done_callback(partial(self._placed, name))
        except StageError as error:
            self._refused[name] = str(error)

    def _placed(self, name: str, future: Future) -> None:
        answer = future.result()
        if answer is None or answer.success:
            self._refused.pop(name, None)
        else:
            self._refused[name] = answer.message

    def place(self, world: World) -> None:
        """Put everything to its place and wait until it is seen there.

        Time then stands still, unless other robots live in the same simulation, or something went wrong.
        """
        self._refused.clear()
        stands_still = False
        try:
            self._placing.everything(world)
            self._see(world)
            stands_still = not self._is_shared
        finally:
            if not stands_still:
                self._placing.go_on()

    def _see(self, world: World) -> None:
        """Wait until robot and objects are heard of at their places, as the executor then has heard, too."""
        placed = [name for name in world.objects if self._placing.knows(name)]
        self._seen.anew()
        end = time.monotonic() + _SEEING
        self._own.until(lambda: self._seen.heard_anew(placed) or time.monotonic() > end, "robot and objects")

    def pause(self, *, paused: bool) -> None:
        """Pause or resume time."""
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
        """Start to execute a chain; resume time once the executor steers or the start fails."""
        try:
            self._chain.execute(run, goal_of(draft, frame=self._frame, refine=refine))
        except BaseException:
            if self._placing.paused:
                self._placing.go_on()
            raise
        if self.can_place:
            self.pause(paused=False)

    def watch(self) -> None:
        """End the run under way as lost where its executor is gone, or silent."""
        world = self._seen.world()
        stamp = 0.0 if world is None else world.time
        self._chain.watch(stamp)
        self._guests.watch(stamp)

    def stop(self) -> None:
        """Cancel what is executed, whoever sent it; wait until it has ended."""
        guest = self.guest
        if not self._chain.under_way and (guest is None or guest.run.ended):
            return
        try:
            if self.can_place:
                self.pause(paused=False)  # the robot can stand only in time
        finally:
            if self._chain.under_way:
                self._chain.cancel()
            self._guests.cancel()
