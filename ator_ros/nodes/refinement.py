"""The node `refinement`: subgoal refinement as a service (paper, section 4)."""

from __future__ import annotations

import functools
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.domain import Domain
from ator_ros.execution.rehearsal import rehearse_refinement
from ator_ros.nodes import conversions
from ator_ros.nodes.checks import MessageError, bounds_of
from ator_ros.nodes.deferred_service import Answer, DeferredService
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health
from ator_ros.nodes.model_sets import ModelSet, problems_of, read_models, told_of
from ator_ros.nodes.pacing import Outbox, Pace
from ator_ros.nodes.parameters import (
    DOMAIN,
    ROBOT,
    Parameter,
    declare_parameters,
    digest_of,
    domain_of,
    robot_of,
)
from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.refinement_answers import answer_of, markers_of, refused
from ator_ros.nodes.running import run_node
from ator_ros.nodes.turns import Turns
from ator_ros.performance.model_file import model_path
from ator_ros.refinement.answer import Refinement
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.gate import Gate, OpenGate
from ator_ros.refinement.gate_file import load_gate
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.slices import Slices
from ator_ros.tops.library import TopLibrary

PARAMETERS = (
    Parameter("frame", "odom", "frame that situations and goals must be given in"),
    DOMAIN,
    ROBOT,
    Parameter("models", "", "folder of the performance models and the gate; empty: those that are shipped"),
    Parameter("gate", True, "whether to refine only where the gate expects that it pays", live=True),
    Parameter(
        "deadline", 0.05, "real s until a request is answered with the best found by then", 0.001, 60.0
    ),
    Parameter("most_requests", 32, "requests under way at once; more are refused as busy", 1, 1000),
)

_WARNING_PERIOD = 2.0
_STRETCH = 0.008
"""Time in s of turns in a row; handing control back to rclpy is slow."""
_FEW = 4
"""Requests that may be answered at once. Each client of a service receives the responses to all clients and
keeps ten of them by default, so it loses its own when more come faster than it reads."""
_ANSWERS_PER_SECOND = 150.0
_REFUSALS_PER_SECOND = 1000.0
_MOST_WAITING = 2000


class RefinementNode(Node):
    """Rewrites the free variables of TOP chains so that the whole chain performs best.

    Parameters: see `PARAMETERS`; `gate` can change while it runs.

        Services refine_subgoal (ator_interfaces/RefineSubgoal): the refined chain, or the chain as it came,
        with the reason. A request that cannot be evaluated is answered with accepted = false, as is one that
        finds the node busy. Requests are served in turns of a millisecond, so that a long one does not delay
        the others.
        At `deadline` the response is the best found until then, and cut_short is true.
    Publishes
        refinement_markers (visualization_msgs/MarkerArray, transient local): the naive chain, the
        chain to execute, and the predicted times by heading as rings, while there is a subscriber.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    """

    def __init__(self) -> None:
        super().__init__("refinement")
        self._settings = declare_parameters(self, PARAMETERS, self._change)
        self._refiners: dict[str, Refiner] = {}
        self._libraries: dict[str, TopLibrary] = {}
        self._models: dict[str, ModelSet] = {}
        robot = robot_of(self._settings)
        domain = domain_of(self._settings)
        for name in domain.action_sets:
            self._load(domain, domain.library(robot, name))
        self._digests = {"robot digest": robot.digest(), "parameters digest": digest_of(self._settings)}
        self._answered, self._refused, self._cut_short, self._busy = 0, 0, 0, 0
        self._last_refusal, self._last_time = "", 0.0
        self._markers = self.create_publisher(MarkerArray, "refinement_markers", LATCHED)
        self._turns = Turns(
            time.monotonic, deadline=self._settings["deadline"], most=self._settings["most_requests"]
        )
        self._service = DeferredService(self, RefineSubgoal, "refine_subgoal", self._begin, work=self._work)
        self._go_on = self.create_guard_condition(self._work)
        answers = Pace(time.monotonic, rate=_ANSWERS_PER_SECOND, at_once=1)
        refusals = Pace(time.monotonic, rate=_REFUSALS_PER_SECOND, at_once=_FEW)
        self._outbox = Outbox(answers, refusals, most=_MOST_WAITING)
        self._crowded = False
        self._posting = self.create_timer(1.0 / _REFUSALS_PER_SECOND, self._post, clock=STEADY)
        self._diagnostics = Diagnostics(self, self._health)
        self.get_logger().info(f"refining chains of the action sets {', '.join(self._refiners) or '(none)'}")

    def _load(self, domain: Domain, library: TopLibrary) -> None:
        """Read models and gate of an action set; without models its chains are refused with the reason."""
        action_set, robot = library.action_set, library.robot
        self._libraries[action_set] = library
        self._models[action_set] = read = read_models(
            self, robot, action_set, self._settings["models"], domain
        )
        if read.models:
            file = read.folder / model_path("gate", action_set)
            gate = self._load_gate(file, action_set) if self._settings["gate"] else None
            self._refiners[action_set] = Refiner(
                robot, read.models, gate, ranges=domain.variables, calibration=read.calibration
            )
            rehearse_refinement(library, self._refiners[action_set])

    def _load_gate(self, file: Path, action_set: str) -> Gate | None:
        """Read the gate of an action set; without one the predicted gain alone decides."""
        try:
            return load_gate(file, action_set)
        except RefinementError as error:
            self.get_logger().warning(f"no gate, refining whenever a gain is predicted: {error}")
            return None

    def _change(self, values: Mapping[str, Any]) -> None:
        """Use the gates from now on, or no longer."""
        if "gate" in values:
            for name, refiner in self._refiners.items():
                file = self._models[name].folder / model_path("gate", name)
                refiner.gate = (self._load_gate(file, name) if values["gate"] else None) or OpenGate()

    def _begin(self, request: RefineSubgoal.Request, answer: Answer) -> None:
        finish = functools.partial(self._answer, answer)
        if self._turns.add(self._serve(request), finish, size=len(request.chain.calls)):
            return
        self._busy += 1
        most = self._settings["most_requests"]
        busy = refused(f"busy: expected at most {most} requests at once, got more; ask again later")
        self._answer(answer, busy, urgent=False)

    def _answer(self, answer: Answer, response: RefineSubgoal.Response, *, urgent: bool = True) -> None:
        """Answer at once; once there are many requests, answer at limited rates until there are none."""
        self._crowded = self._crowded or len(self._turns) > _FEW
        if not self._crowded:
            answer(response)
            return
        self._outbox.add(functools.partial(answer, response), urgent=urgent)
        if self._posting.is_canceled():
            self._posting.reset()

    def _post(self) -> None:
        """Send the responses that wait."""
        self._outbox.work()
        if not self._outbox:
            self._posting.cancel()
            self._crowded = len(self._turns) > 0

    def _work(self) -> None:
        """Serve requests in turns, and start new ones meanwhile. Other callbacks wait as long."""
        until = time.monotonic() + _STRETCH
        self._service.take()
        while self._turns and time.monotonic() < until:
            self._turns.work()
            self._service.take()
        if self._turns:
            self._go_on.trigger()

    def _serve(self, request: RefineSubgoal.Request) -> Slices[RefineSubgoal.Response]:
        """Answer a request, in slices; a defect of ours must not break the other requests under way."""
        try:
            return (yield from self._response_to(request))
        except Exception as error:
            self._refused, self._last_refusal = self._refused + 1, f"internal error: {error!r}"
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=_WARNING_PERIOD)
            return refused(self._last_refusal)

    def _response_to(self, request: RefineSubgoal.Request) -> Slices[RefineSubgoal.Response]:
        """Return the response to a request, in slices."""
        began, frame = time.perf_counter(), self._settings["frame"]
        try:
            action_set = conversions.action_set_from(request.chain, allowed=self._libraries)
            refinement = yield from self._refine(request, action_set)
        except (MessageError, RefinementError) as error:
            self._refused, self._last_refusal = self._refused + 1, str(error)
            self.get_logger().warning(f"refused: {error}", throttle_duration_sec=_WARNING_PERIOD)
            response = refused(str(error), conversions.echo_of(request.chain))
        else:
            self._answered += 1
            self._cut_short += not refinement.complete
            yield
            wanted = request.want_curve
            response = answer_of(refinement, action_set=action_set, frame=frame, want_curve=wanted)
            if self._markers.get_subscription_count():
                yield
                start = conversions.pose_from(request.situation.robot, "situation.robot")
                self._markers.publish(markers_of(refinement, start=start, frame=frame))
        self._last_time = response.computation_time = time.perf_counter() - began
        return response

    def _refine(self, request: RefineSubgoal.Request, action_set: str) -> Slices[Refinement]:
        if action_set not in self._refiners:
            raise RefinementError(f"action set {action_set}: {self._models[action_set].absent}")
        library, refiner = self._libraries[action_set], self._refiners[action_set]
        return (yield from refining_of(request, refiner, library, frame=self._settings["frame"]))

    def _health(self) -> Health:
        problem = problems_of(self._models)
        return Health(
            problem if self._refiners else problem or "no models for any action set",
            error=not self._refiners,
            values={
                **told_of(self._models),
                "requests answered": self._answered,
                "requests refused": self._refused,
                "requests refused as busy": self._busy,
                "requests cut short by their deadline": self._cut_short,
                "last error": self._last_refusal,
                **self._digests,
                "last computation (ms)": f"{1000.0 * self._last_time:.2f}",
            },
        )


def refining_of(
    request: RefineSubgoal.Request, refiner: Refiner, library: TopLibrary, *, frame: str
) -> Slices[Refinement]:
    """Refine the chain of a request, in slices.

    Raises
    ------
    MessageError, RefinementError
        The request cannot be read, or the chain is no valid plan from its situation.
    """
    world = conversions.world_from(request.situation, frame=frame, bounds=bounds_of(library.robot))
    chain = conversions.chain_from(request.chain, library, frame=frame)
    objective = conversions.objective_from(request.objective)
    yield
    violations = chain.violations(world, library.robot)
    if violations:
        raise RefinementError(f"no valid plan: {'; '.join(violations)}")
    yield
    return (yield from refiner.refining(world, chain, objective, placeholders=not request.as_given))


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(RefinementNode, PARAMETERS, args)
