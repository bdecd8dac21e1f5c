"""The node `refinement`: subgoal refinement as a service (paper, section 4)."""

from __future__ import annotations

import functools
import time
import traceback
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from visualization_msgs.msg import MarkerArray

from ator_interfaces.srv import RefineSubgoal
from ator_ros.compiled import use_cores
from ator_ros.execution.fence import Fence
from ator_ros.learning.exploring import Explorer
from ator_ros.nodes import conversions
from ator_ros.nodes.deferred_service import Answer, DeferredService
from ator_ros.nodes.diagnostics import STEADY, Diagnostics, Health
from ator_ros.nodes.drawn import Drawn
from ator_ros.nodes.frugal_node import FrugalNode
from ator_ros.nodes.learned_sets import LEARNED, LearnedSets
from ator_ros.nodes.loading import Refiners, load_refiners, set_gates
from ator_ros.nodes.model_sets import problems_of, startup_text, told_of
from ator_ros.nodes.pacing import Outbox, Pace
from ator_ros.nodes.parameters import (
    DOMAIN,
    FENCE,
    FRAME,
    MODELS,
    ROBOT,
    Parameter,
    declare_parameters,
    digest_of,
    domain_of,
    fence_of,
    robot_of,
)
from ator_ros.nodes.plan_service import PlanService
from ator_ros.nodes.refinement_answers import answer_of, markers_of, refused
from ator_ros.nodes.running import run_node
from ator_ros.nodes.turns import Turns
from ator_ros.planning.process import PlanProcess
from ator_ros.refinement.alternatives import Selection, choosing
from ator_ros.refinement.chain_model import predict_chain
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.objective import LEAST_WEIGHT, MOST_WEIGHT
from ator_ros.refinement.refiner import Refiner
from ator_ros.refinement.slices import Slices
from ator_ros.tops.library import TopLibrary
from ator_ros.world.messages import MessageError, pose_from

PARAMETERS = (
    FRAME,
    DOMAIN,
    ROBOT,
    FENCE,
    MODELS,
    LEARNED,
    Parameter("gate", True, "whether to refine only where the gate expects that it pays", live=True),
    Parameter(
        "failure_cost",
        -1.0,
        "s that a failure costs; below 0: the domain's time limit",
        -1.0,
        MOST_WEIGHT,
        smallest=LEAST_WEIGHT,
        live=True,
    ),
    Parameter("explore", 0.0, "greatest share of predicted time to try chains; 0: none", 0.0, 0.5, live=True),
    Parameter(
        "deadline", 0.05, "real s until a request is answered with the best found by then", 0.001, 60.0
    ),
    Parameter("cores", 2, "how many cores search at once; the node itself takes one", 1, 64),
    Parameter("most_requests", 32, "requests under way at once; more are refused as busy", 1, 1000),
)

_WARNING_PERIOD = 2.0
_PLANNING = 2.0
"""Real time in s that the plans for one goal may take; those of the shipped domains take some 15 ms."""
_STRETCH = 0.008
"""Time in s of turns in a row; handing control back to rclpy is slow."""
_FEW = 4
"""Requests that may be answered at once. Each client of a service receives the responses to all clients and
keeps ten of them by default, so it loses its own when more come faster than it reads."""
_ANSWERS_PER_SECOND = 75.0
"""Of twenty clients on a busy machine one lost an answer in 9 of 40 rounds at 150, and none at 75."""
_REFUSALS_PER_SECOND = 1000.0
_MOST_WAITING = 2000


class RefinementNode(FrugalNode):
    """Rewrites the free variables of TOP chains so that the whole chain performs best.

    Parameters: see `PARAMETERS`; `gate`, `failure_cost` and `explore` can change while it runs.

    Services
        refine_subgoal (ator_interfaces/RefineSubgoal): the refined chain, or the chain as it came, with the
        reason. A request that cannot be evaluated is answered with accepted = false, as is one that finds the
        node busy. Requests are served in turns of a millisecond, so that a long one does not delay the
        others. At `deadline` the response is the best found until then, and cut_short is true.
        plan_chains (ator_interfaces/PlanChains): chains for a goal, from the conditions of the TOPs. They are
        planned in a process of their own, which the first request starts.
    Publishes
        refinement_markers (visualization_msgs/MarkerArray, transient local): the naive chain, the
        chain to execute, and the predicted times by heading as rings, of the last request.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    """

    def __init__(self) -> None:
        super().__init__("refinement")
        self._settings = declare_parameters(self, PARAMETERS, self._change)
        use_cores(self._settings["cores"])
        robot = robot_of(self._settings)
        self._fence = fence_of(self._settings, robot)
        self._domain = domain = domain_of(self._settings)
        self._libraries = {name: domain.library(robot, name) for name in domain.action_sets}
        models, learned = self._settings["models"], self._settings["learned"]
        self._sets = LearnedSets(self, models, learned, self._load, self._prepare)
        self._digests = {"robot digest": robot.digest(), "parameters digest": digest_of(self._settings)}
        self._explorer = Explorer(self._settings["explore"])
        self._answered, self._refused, self._cut_short, self._busy = 0, 0, 0, 0
        self._last_refusal, self._last_time = "", 0.0
        self._markers = Drawn(self, MarkerArray, "refinement_markers")
        self._turns = Turns(
            time.monotonic, deadline=self._settings["deadline"], most=self._settings["most_requests"]
        )
        self._service = DeferredService(self, RefineSubgoal, "refine_subgoal", self._begin, work=self._work)
        names = self._settings["domain"], self._settings["robot"]
        process = PlanProcess(*names, time_limit=_PLANNING, fence=self._fence)
        self._plans = PlanService(self, domain, self._libraries, process, frame=self._settings["frame"])
        self._go_on = self.create_guard_condition(self._work)
        answers = Pace(time.monotonic, rate=_ANSWERS_PER_SECOND, at_once=1)
        refusals = Pace(time.monotonic, rate=_REFUSALS_PER_SECOND, at_once=_FEW)
        self._outbox = Outbox(answers, refusals, most=_MOST_WAITING)
        self._crowded = False
        self._posting = self.create_timer(1.0 / _REFUSALS_PER_SECOND, self._post, clock=STEADY)
        self._diagnostics = Diagnostics(self, self._health)
        models = startup_text(self._sets.present.models, self._sets.source)
        gate = self._sets.present.gate_text(gated=self._settings["gate"])
        self.get_logger().info(
            f"refining chains for {robot.name} (domain {domain.name}, ROS domain "
            f"{self.context.get_domain_id()}); {models}; {gate}"
        )

    def _load(self, folder: str) -> Refiners:
        gated, cost = self._settings["gate"], self._failure_cost(self._settings)
        where = self._domain, self._libraries, folder
        return load_refiners(self, *where, fence=self._fence, gated=gated, failure_cost=cost)

    def _failure_cost(self, settings: Mapping[str, Any]) -> float:
        """Return the time in s that a failure costs where a request does not say."""
        cost: float = settings["failure_cost"]
        return cost if cost >= 0.0 else self._domain.time_limit

    def _prepare(self, refiners: Refiners, changes: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Make refiners decide as the parameters say, with `changes` that are about to be made."""
        settings = {**self._settings, **changes}
        set_gates(self, refiners, gated=settings["gate"])
        for refiner in refiners.by_set.values():
            refiner.failure_cost = self._failure_cost(settings)

    def _change(self, values: Mapping[str, Any]) -> None:
        """Use the gates, or no longer; count failures at another cost; try more chains, or fewer."""
        if values.keys() & {"gate", "failure_cost"}:
            self._prepare(self._sets.present, values)
        if "explore" in values:
            self._explorer.share = values["explore"]

    def _begin(self, request: RefineSubgoal.Request, answer: Answer) -> None:
        finish = functools.partial(self._answer, answer)
        if self._turns.add(self._serve(request), finish, size=_size_of(request)):
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
            choice = yield from self._refine(request, action_set)
        except (MessageError, RefinementError) as error:
            self._refused, self._last_refusal = self._refused + 1, str(error)
            self.get_logger().warning(f"refused: {error}", throttle_duration_sec=_WARNING_PERIOD)
            response = refused(str(error), conversions.echo_of(request.chain))
        else:
            self._answered += 1
            self._cut_short += not choice.refinement.complete
            yield
            wanted = request.want_curve
            response = answer_of(choice, request, action_set=action_set, frame=frame, want_curve=wanted)
            yield
            start = pose_from(request.situation.robot, "situation.robot")
            self._markers.offer(functools.partial(markers_of, choice.refinement, start=start, frame=frame))
        self._last_time = response.computation_time = time.perf_counter() - began
        return response

    def _refine(self, request: RefineSubgoal.Request, action_set: str) -> Slices[Selection]:
        present = self._sets.present  # the request keeps these, whatever is learned meanwhile
        if action_set not in present.by_set:
            raise RefinementError(f"action set {action_set}: {present.models[action_set].absent}")
        library, refiner = self._libraries[action_set], present.by_set[action_set]
        frame = self._settings["frame"]
        choice = yield from refining_of(request, refiner, library, frame=frame, fence=self._fence)
        if self._settings["explore"] == 0.0 or request.as_given:
            return choice
        yield
        world = conversions.world_from(request.situation, frame=frame)
        objective = conversions.objective_from(request.objective, refiner.failure_cost)
        found = self._explorer.explored(
            choice.refinement,
            lambda chain: predict_chain(world, chain, refiner.models, library.robot, objective),
        )
        return choice.with_chosen(found)

    def stop(self) -> None:
        """End the process that plans, before the node ends."""
        self._plans.close()

    def _health(self) -> Health:
        present = self._sets.present
        problem = problems_of(present.models)
        return Health(
            problem if present.by_set else problem or "no models for any action set",
            error=not present.by_set,
            values={
                **told_of(present.models),
                **self._sets.told(),
                **self._explorer.told(),
                "requests answered": self._answered,
                "requests refused": self._refused,
                "requests refused as busy": self._busy,
                "plans": self._plans.answered,
                "goals without a plan": self._plans.refused,
                "requests cut short by their deadline": self._cut_short,
                "last error": self._last_refusal,
                **self._digests,
                "last computation (ms)": f"{1000.0 * self._last_time:.2f}",
            },
        )


def _size_of(request: RefineSubgoal.Request) -> int:
    return sum(len(chain.calls) for chain in (request.chain, *request.alternatives))


def refining_of(
    request: RefineSubgoal.Request,
    refiner: Refiner,
    library: TopLibrary,
    *,
    frame: str,
    fence: Fence | None = None,
) -> Slices[Selection]:
    """Refine the chain of a request and its alternatives, in slices, and choose the best.

    Raises
    ------
    MessageError, RefinementError
        The request cannot be read, its chain leads out of the fence, or none of its chains is a valid plan
        from its situation.
    """
    world = conversions.world_from(request.situation, frame=frame)
    chain = conversions.chain_from(request.chain, library, frame=frame, fence=fence)
    others = conversions.alternatives_from(request.alternatives, library, frame=frame, fence=fence)
    objective = conversions.objective_from(request.objective, refiner.failure_cost)
    yield
    placeholders = not request.as_given
    return (yield from choosing(refiner, world, (chain, *others), objective, placeholders=placeholders))


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(RefinementNode, PARAMETERS, args)
