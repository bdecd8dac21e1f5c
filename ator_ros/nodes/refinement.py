"""The node `refinement`: subgoal refinement (paper, section 4) and plans as services."""

from __future__ import annotations

import inspect
import random
import time
import traceback
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from threading import current_thread, main_thread
from typing import Any

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from ator_interfaces.srv import PlanChains, PredictDurations, RefineSubgoal
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import warm_up_refinement
from ator_ros.learning.gains import Gains
from ator_ros.nodes import messages
from ator_ros.nodes.diagnostics import Diagnostics, Health
from ator_ros.nodes.drawing import LazyPublisher, marker_array
from ator_ros.nodes.main_loop import pause, run_node
from ator_ros.nodes.maps import FollowedMap
from ator_ros.nodes.models import LEARNED, LearnedSets, ModelSet
from ator_ros.nodes.parameters import (
    FENCE,
    FRAME,
    MODELS,
    PLANNER,
    WORLD,
    Parameter,
    declare_parameters,
    domain_and_robot,
    fence_of,
    live,
)
from ator_ros.nodes.path_planner import planner_of, with_planner
from ator_ros.nodes.qos import SERVICES
from ator_ros.nodes.segments import refinement_shapes, station_labels
from ator_ros.nodes.subscriptions import WARNING_PERIOD, TfListener
from ator_ros.performance.path_times import path_times_remark
from ator_ros.planning.goals import PlanningError
from ator_ros.planning.planner import chains_for
from ator_ros.printable import one_line
from ator_ros.refinement import RefinementError
from ator_ros.refinement.gate import NO_GATE, Gate
from ator_ros.refinement.objective import MOST_WEIGHT
from ator_ros.refinement.refiner import Refiner, Selection, choose
from ator_ros.refinement.search import Deadline, no_deadline
from ator_ros.refinement.step_durations import Durations, DurationTable
from ator_ros.tops.chain import TopChain
from ator_ros.tops.conditions import state_variables
from ator_ros.tops.library import TopLibrary
from ator_ros.world.grid_map import PATHS_OF
from ator_ros.world.readers import MessageError, count, pose_from, world_from
from ator_ros.world.state import World

_LONGEST_DEADLINE = 60.0  # s, as the longest `refinement_timeout` of the executor

PARAMETERS = (
    FRAME,
    *WORLD,
    FENCE,
    MODELS,
    LEARNED,
    PLANNER,
    live("gate", True, "refine only where the predicted gain exceeds its uncertainty"),
    live(
        "comparison_share",
        0.1,
        "greatest share of chains that run the other way, to measure gains; only with `learned`",
        0.0,
        0.1,
    ),
    live(
        "failure_cost",
        -1.0,
        "s that a failure costs; below 0: the domain's time limit",
        -1.0,
        MOST_WEIGHT,
    ),
    Parameter(
        "deadline",
        1.0,
        "s of CPU time, with `planner` of real time, after which the best chain is the answer",
        0.001,
        _LONGEST_DEADLINE,
    ),
)

_ROOM = 1.2  # factor of a recommended deadline, for answers that are not always as fast
_MOST_PREDICTED = 100  # situations, and calls, of one request
_FIRST_BLOCK = 10  # situations from which a step is predicted at once, before its pace is known
_BLOCK_TIME = 0.03  # real s; on maps and with planners a prediction takes 0.5 to 10 ms


class RefinementNode(Node):
    """Sets the free variables of TOP chains so that the whole chain performs best.

    Services
        refine_subgoal (ator_interfaces/RefineSubgoal): the refined chain, or the chain as it was
        sent, with the reason. A request that cannot be evaluated is answered with accepted = false.
        Requests are answered one by one. After `deadline` the answer is the best chain found,
        cut_short is true, and the reason names the deadline that the whole search needs.
        plan_chains (ator_interfaces/PlanChains): chains for a goal, from the conditions of the
        TOPs. predict_durations (ator_interfaces/PredictDurations): how long steps take from several
        situations.
    Subscribes to
        /tf and /tf_static, from the first request in another frame than `frame` on.
        the topic of a map (nav_msgs/OccupancyGrid, transient local), if `map` names one.
    Publishes
        refinement_markers (visualization_msgs/MarkerArray, transient local): the naive chain, the
        chain to execute, and the predicted times by heading as rings, of the last request.
        /diagnostics (diagnostic_msgs/DiagnosticArray): once a second.
    """

    def __init__(self) -> None:
        super().__init__("refinement", automatically_declare_parameters_from_overrides=True)
        self._settings = declare_parameters(self, PARAMETERS)
        self._frame = self._settings["frame"]
        domain, robot = domain_and_robot(self._settings)
        domain, robot = with_planner(self, self._settings, domain, robot)
        self._use(domain, robot)
        self._fence = fence_of(self._settings, robot)
        # places are searched inside the fence
        self._ranges = self._fence.narrowed(domain.ranges, robot)
        self._sets = LearnedSets(self, domain, self._libraries, self._settings, self._warm_up)
        self._map = FollowedMap(self, self._settings, domain, robot, self._take_map)
        self._goals = domain.goals(robot)
        self._variables = state_variables(domain.objects, holder=robot.holder is not None)
        self._answered = 0
        self._cut_short = 0
        self._last_error = ""
        self._tf = TfListener(self)
        self._markers = LazyPublisher(self, MarkerArray, "refinement_markers")
        # A request between two blocks keeps its group locked: only others of this service wait.
        blocks = MutuallyExclusiveCallbackGroup()
        for kind, name, answer, group in (
            (RefineSubgoal, "refine_subgoal", self._refine, None),
            (PlanChains, "plan_chains", self._plan, None),
            (PredictDurations, "predict_durations", self._predict, blocks),
        ):
            serve = partial(self._serve, answer)
            self.create_service(kind, name, serve, qos_profile=SERVICES, callback_group=group)
        Diagnostics(self, self._health)
        policy = "a chain is changed where the predicted gain exceeds its uncertainty"
        if not self._settings["gate"]:
            policy = "gate is false: a chain is changed whenever a gain is predicted"
        self.get_logger().info(
            f"refining chains for {robot.name} (domain {domain.name}, ROS domain "
            f"{self.context.get_domain_id()}); {self._sets.startup_text()}; {policy}"
        )

    def _warm_up(self, library: TopLibrary, read: ModelSet) -> None:
        """Compile what refinement needs, and warn of models that were learned on other routes."""
        grid = self._robot.grid
        planner = planner_of(self._robot)
        # In the thread of a learned set, the planner would be held for requests, too. The code is
        # compiled by then.
        if grid is None or grid.planner is None or current_thread() is main_thread():
            with nullcontext() if planner is None else planner.held():
                warm_up_refinement(library, self._refiner(read, Gate()))
        learned = {
            str(model.metadata["training"].get("map", "")) for model in read.models.values()
        } - {""}
        for other in sorted(learned):
            if grid is not None and (PATHS_OF in other) != (grid.planner is not None):
                warning = (
                    f"action set {library.action_set}: models were learned on the map {other}, but "
                    f"are used on {grid}: set the parameter planner if, and only if, they were "
                    "learned with it"
                )
                self.get_logger().warning(one_line(warning))

    def _use(self, domain: Domain, robot: Robot) -> None:
        self._domain = domain
        self._robot = robot
        self._libraries = {name: domain.library(robot, name) for name in domain.action_sets}

    def _take_map(self, domain: Domain, robot: Robot) -> None:
        self._use(domain, robot)
        self._sets.load(domain, self._libraries)

    def _gate(self, request: RefineSubgoal.Request, gains: Gains) -> Gate:
        """Return the current gate, which draws some executed chains to measure the gain."""
        if not self._settings["gate"]:
            return NO_GATE
        measurable = bool(self._settings["learned"]) and request.measure
        share = gains.comparison_share(self._settings["comparison_share"])
        return Gate(measured=gains.measured, drawn=measurable and random.random() < share)

    def _refiner(self, read: ModelSet, gate: Gate) -> Refiner:
        cost = self._settings["failure_cost"]
        cost = cost if cost >= 0.0 else self._domain.time_limit
        return Refiner(self._robot, read.models, gate, ranges=self._ranges, failure_cost=cost)

    @property
    def _withheld(self) -> int:
        """The number of paths that the planner was not asked for, as Nav2 used it."""
        planner = planner_of(self._robot)
        return 0 if planner is None else planner.withheld

    def _routes_remark(self, withheld: int) -> str:
        """Return where routes come from, if more than so many paths were withheld; else empty."""
        planner = planner_of(self._robot)
        if planner is None or planner.withheld == withheld:
            return ""
        return f"routes by our search on the map, as {planner.busy} executes a goal"

    async def _serve(self, answer: Callable[[Any], Any], request: Any, response: Any) -> Any:
        started = time.monotonic()
        try:
            found = answer(request)
            response = await found if inspect.isawaitable(found) else found
        except Exception as error:  # a defect must not end the node
            if isinstance(error, MessageError | RefinementError | PlanningError):
                reason = one_line(error)
                self.get_logger().warning(
                    f"refused: {reason}", throttle_duration_sec=WARNING_PERIOD
                )
            else:
                reason = f"internal error: {one_line(repr(error), 200)}"
                self.get_logger().error(
                    traceback.format_exc(), throttle_duration_sec=WARNING_PERIOD
                )
            self._last_error = response.reason = reason
            if isinstance(request, RefineSubgoal.Request):
                response = messages.refused(reason, request.chain)
        response.computation_time = time.monotonic() - started
        return response

    def _refine(self, request: RefineSubgoal.Request) -> RefineSubgoal.Response:
        # CPU time, so that an answer does not depend on other programs; but a planner is another
        # program, for whose paths the search waits.
        planned = self._robot.grid is not None and self._robot.grid.planner is not None
        clock = time.monotonic if planned else time.thread_time
        deadline = self._settings["deadline"]
        frame = self._frame
        end = clock() + deadline
        withheld = self._withheld
        action_set = messages.action_set_from(request.chain, allowed=self._libraries)
        present = self._sets.present[action_set]
        library = self._libraries[action_set]
        self._map.expect_usable()
        sent = request.chain, *request.alternatives
        messages.into_frame(frame, self._tf.base, sent, [request.situation])
        gains = self._sets.gains.of(action_set)
        refiner = self._refiner(present, self._gate(request, gains))
        choice = refine_request(
            request,
            refiner,
            library,
            frame=frame,
            fence=self._fence,
            deadline=lambda: clock() > end,
        )
        self._answered += 1
        self._cut_short += not choice.complete
        start = pose_from(request.situation.robot, "situation.robot")
        found = choice.refinement

        def markers() -> MarkerArray:
            shapes = refinement_shapes(start, found.original, found.chain, found.curves)
            return marker_array(shapes, "refinement", frame, station_labels(found.chain))

        self._markers.publish(markers)
        gain = messages.gain_of(found, gains.measured, gains.models)
        reason = found.reason
        if not choice.complete:  # first, since the end of a long reason is cut
            reason = f"{needed_deadline(choice, deadline)}; {reason}"
        if remark := self._routes_remark(withheld):
            reason = f"{remark}; {reason}"
        if self._robot.grid is not None:
            reason = f"{reason}; map {self._robot.grid}"
        return messages.answer_of(
            choice, request, gain, reason=reason, action_set=action_set, frame=frame
        )

    def _plan(self, request: PlanChains.Request) -> PlanChains.Response:
        self._map.expect_usable()
        name = messages.action_set_from(request, allowed=self._libraries, where="request")
        goal = messages.statements_from(request.goal, self._goals, self._variables)
        messages.into_frame(self._frame, self._tf.base, (), [request.situation])
        world = world_from(request.situation, frame=self._frame)
        chains = chains_for(goal, world, self._libraries[name], self._domain.objects, self._fence)
        return PlanChains.Response(
            accepted=True,
            holds=not chains,
            reason=f"{len(chains)} chain{'s' * (len(chains) > 1)}"
            if chains
            else "the goal holds already",
            chains=[
                messages.chain_of(chain, action_set=name, frame=self._frame) for chain in chains
            ],
        )

    async def _predict(self, request: PredictDurations.Request) -> PredictDurations.Response:
        """Predict durations in blocks, between which requests to other services are answered.

        All blocks use the map and the models of the first one.
        """
        for field in ("situations", "calls"):
            count(getattr(request, field), field, least=1, most=_MOST_PREDICTED)
        self._map.expect_usable()
        name = messages.action_set_from(request, allowed=self._libraries, where="request")
        messages.into_frame(self._frame, self._tf.base, [request], request.situations)
        worlds = [
            world_from(situation, frame=self._frame, where=f"situations[{number}]")
            for number, situation in enumerate(request.situations)
        ]
        library = self._libraries[name]
        calls = messages.calls_from(request.calls, library, frame=self._frame)
        models = self._sets.present[name].models
        withheld = self._withheld
        actions = dict.fromkeys(call.top.action for call in calls)
        remarks = [path_times_remark(each for each in actions if not models[each].is_learned)]
        if self._robot.grid is not None:
            remarks.append(f"map {self._robot.grid}")
        if request.pairs:
            table = DurationTable.of_pairs(
                worlds, calls, models, robot=library.robot, ranges=library.ranges
            )
        else:
            table = DurationTable(worlds, calls, models)
        found = await self._predict_in_blocks(table)
        reason = one_line("; ".join(filter(None, (self._routes_remark(withheld), *remarks))))
        durations, spreads, success = (values.ravel().tolist() for values in found)
        return PredictDurations.Response(
            accepted=True, reason=reason, durations=durations, spreads=spreads, success=success
        )

    async def _predict_in_blocks(self, table: DurationTable) -> Durations:
        """Predict steps from situations, in blocks that take about `_BLOCK_TIME`."""
        rows, columns = table.shape
        found = Durations(*np.full((3, rows, columns), np.nan))
        size = _FIRST_BLOCK
        for column in range(columns):
            first = 0
            while first < rows:
                started = time.monotonic()
                last = min(first + size, rows)
                block = table.part(column, first, last)
                for values, part in zip(found, block, strict=True):
                    values[first:last, column] = part
                pace = _BLOCK_TIME / max(time.monotonic() - started, 1e-3)
                first = last
                size = min(max(1, round(size * pace)), _MOST_PREDICTED)
                await pause(self)
        return found

    def _health(self) -> Health:
        reasons = (
            self._map.problem,
            self._sets.problem,
        )
        counts = {
            "requests answered": self._answered,
            "requests cut short by their deadline": self._cut_short,
            "last error": self._last_error,
        }
        values = self._sets.diagnostics() | counts
        return Health("; ".join(filter(None, reasons)), self._map.is_missing, values)


def refine_request(
    request: RefineSubgoal.Request,
    refiner: Refiner,
    library: TopLibrary,
    *,
    frame: str,
    fence: Fence | None = None,
    deadline: Deadline = no_deadline,
) -> Selection:
    """Refine the chain of a request and its alternatives, and choose the best.

    A chain without a route on the map is skipped, as one that is no valid plan. Raises MessageError
    or RefinementError if the request cannot be read, its chain leads out of the fence, or none of
    its chains can be used from its situation.
    """
    world = world_from(request.situation, frame=frame)
    chain = messages.chain_from(request.chain, library, frame=frame, fence=fence)
    others: list[TopChain | str] = []
    for number, sent in enumerate(request.alternatives):
        try:
            others.append(
                messages.alternative_from(sent, number, library, frame=frame, fence=fence)
            )
        except MessageError as error:
            others.append(str(error))
    chains = [_with_route(each, world, refiner.robot, fence) for each in (chain, *others)]
    objective = messages.objective_from(request.objective, refiner.failure_cost)
    placeholders = not request.as_given
    return choose(refiner, world, chains, objective, placeholders=placeholders, deadline=deadline)


def _with_route(
    chain: TopChain | str, world: World, robot: Robot, fence: Fence | None
) -> TopChain | str:
    """Return a chain, or why no route of the map or of its planner leads along it."""
    if fence is None or isinstance(chain, str):
        return chain
    return fence.unreachable(chain, robot, start=world.robot.pose[:2], planned=True) or chain


def needed_deadline(choice: Selection, deadline: float) -> str:
    """Return in words which deadline the search needs that ended after `deadline` s."""
    share = choice.share_done
    if not share:
        return f"no search began within its deadline of {deadline:g} s: raise it"
    needed = _ROOM * deadline / share
    about = f"about {needed:.2g} s" if needed <= _LONGEST_DEADLINE else "more than 60 s"
    return f"the whole search needs a deadline of {about}, it had {deadline:g} s"


main = partial(run_node, RefinementNode, PARAMETERS)
