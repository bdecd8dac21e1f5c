"""The service plan_chains: chains for a goal, from the conditions of the TOPs."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping, Sequence

from rclpy.node import Node

from ator_interfaces.msg import GoalTerm, PlanGoal
from ator_interfaces.srv import PlanChains
from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.nodes import messages
from ator_ros.nodes.qos import SERVICES
from ator_ros.planning.goals import (
    MOST_STATEMENTS,
    GoalStatement,
    PlanningError,
    Unspecified,
    known_variables,
)
from ator_ros.planning.planner import chains_for
from ator_ros.printable import printable, quoted
from ator_ros.tops.conditions import Condition, Region
from ator_ros.tops.library import TopLibrary
from ator_ros.world import messages as checks
from ator_ros.world.messages import FARTHEST, MessageError

_LONGEST_REASON = 500
_WARNING_PERIOD = 2.0


class PlanService:
    """Serves plan_chains with the TOPs in `libraries`, by action set.

    The chains stay inside `fence` (None: around the scene's area). `answered` and `refused` count the
    requests.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        libraries: Mapping[str, TopLibrary],
        *,
        fence: Fence | None,
        frame: str,
    ) -> None:
        self.answered, self.refused = 0, 0
        self._node, self._domain, self._libraries = node, domain, libraries
        self._fence, self._frame = fence, frame
        robot = next(iter(libraries.values())).robot
        self._goals = domain.goals(robot)
        self._variables = known_variables(domain.objects, holder=robot.holder is not None)
        node.create_service(PlanChains, "plan_chains", self._serve, qos_profile=SERVICES)

    def _serve(self, request: PlanChains.Request, response: PlanChains.Response) -> PlanChains.Response:
        began = time.perf_counter()
        try:
            name = checks.name(request.action_set or DEFAULT_SET, "action_set", allowed=self._libraries)
            goal = statements_from(request.goal, self._goals, self._variables)
            world = checks.world_from(request.situation, frame=self._frame)
            library, objects = self._libraries[name], self._domain.objects
            chains = chains_for(goal, world, library, objects, self._fence)
        except (MessageError, PlanningError) as error:
            response.reason = printable(str(error), _LONGEST_REASON)
        except Exception as error:
            self._node.get_logger().error(traceback.format_exc(), throttle_duration_sec=_WARNING_PERIOD)
            response.reason = f"internal error: {printable(repr(error), _LONGEST_REASON)}"
        else:
            response.accepted, response.holds = True, not chains
            response.reason = f"{len(chains)} chains" if chains else "the goal holds already"
            response.chains = [
                messages.chain_of(chain, action_set=name, frame=self._frame) for chain in chains
            ]
        if response.accepted:
            self.answered += 1
        else:
            self.refused += 1
            self._node.get_logger().warning(
                f"no plan: {response.reason}", throttle_duration_sec=_WARNING_PERIOD
            )
        response.computation_time = time.perf_counter() - began
        return response


def statements_from(
    goal: PlanGoal, named: Mapping[str, Condition], variables: Sequence[str]
) -> list[GoalStatement]:
    """Read what shall hold at the end of a plan; raises MessageError.

    `named` are the goals that the domain names, `variables` the state variables that there are.
    """
    if goal.name and goal.terms:
        raise MessageError("goal: expected a name or terms, got both")
    if goal.name:
        return list(named[checks.name(goal.name, "goal.name", allowed=named)].terms)
    checks.count(goal.terms, "goal.terms", least=1, most=MOST_STATEMENTS)
    return [_statement(term, variables, f"goal.terms[{i}]") for i, term in enumerate(goal.terms)]


def _statement(term: GoalTerm, variables: Sequence[str], where: str) -> GoalStatement:
    variable = checks.name(term.variable, f"{where}.variable", allowed=variables)
    value, low, high = (
        checks.number(getattr(term, name), f"{where}.{name}", low=-FARTHEST, high=FARTHEST)
        for name in ("value", "low", "high")
    )
    if low > high:
        raise MessageError(f"{where}: expected low <= high, got low {low:g} and high {high:g}")
    unspecified = low == high == 0.0
    if not term.relative_to:
        return Unspecified(variable, value) if unspecified else Region(variable, value, low, high)
    other = checks.name(term.relative_to, f"{where}.relative_to", allowed=variables)
    if other == variable:
        raise MessageError(f"{where}.relative_to: expected another variable, got {quoted(other)}")
    if not unspecified:
        return Region(variable, other, value + low, value + high)
    if value != 0.0:
        raise MessageError(
            f"{where}: expected low and high of a value relative to another variable, got none"
        )
    return Unspecified(variable, other)
