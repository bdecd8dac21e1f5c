"""The service plan_chains: chains for a goal, planned in a process of its own."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rclpy.node import Node

from ator_interfaces.srv import PlanChains
from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.nodes import messages
from ator_ros.nodes.plan_messages import answered, refused, wishes_from
from ator_ros.nodes.qos import SERVICES
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.process import PlanProcess
from ator_ros.planning.wanted import known_variables
from ator_ros.printable import printable
from ator_ros.tops.library import TopLibrary
from ator_ros.world import messages as checks
from ator_ros.world.messages import MessageError

_LONGEST_REASON = 500
_WARNING_PERIOD = 2.0


class PlanService:
    """Serves plan_chains, one request at a time.

    Parameters
    ----------
    node : Node
        The node that offers it.
    domain, libraries
        Its domain, and its TOPs by action set.
    process : PlanProcess
        What plans.
    frame : str
        The frame of all poses.

    Attributes
    ----------
    answered, refused : int
        Numbers of requests.
    """

    def __init__(
        self,
        node: Node,
        domain: Domain,
        libraries: Mapping[str, TopLibrary],
        process: PlanProcess,
        *,
        frame: str,
    ) -> None:
        self.answered, self.refused = 0, 0
        self._node, self._domain, self._libraries, self._frame = node, domain, libraries, frame
        self._process = process
        robot = next(iter(libraries.values())).robot
        self._goals = domain.goals(robot)
        self._variables = known_variables(domain.objects, holder=robot.holder is not None)
        node.create_service(PlanChains, "plan_chains", self._serve, qos_profile=SERVICES)

    def _serve(self, request: PlanChains.Request, _: PlanChains.Response) -> PlanChains.Response:
        started = time.perf_counter()
        try:
            response = self._plan(request)
        except (MessageError, PlanningError) as error:
            response = refused(printable(str(error), _LONGEST_REASON))
        except Exception as error:  # a defect must not end the node
            response = refused(f"internal error: {printable(repr(error), _LONGEST_REASON)}")
        if response.accepted:
            self.answered += 1
        else:
            self.refused += 1
            self._node.get_logger().warning(
                f"no plan: {response.reason}", throttle_duration_sec=_WARNING_PERIOD
            )
        response.computation_time = time.perf_counter() - started
        return response

    def _plan(self, request: PlanChains.Request) -> PlanChains.Response:
        name = checks.name(request.action_set or DEFAULT_SET, "action_set", allowed=self._libraries)
        wishes = wishes_from(request.goal, self._goals, self._variables)
        world = messages.world_from(request.situation, frame=self._frame)
        found = self._process.chains(wishes, world, self._libraries[name])
        return answered(found, action_set=name, frame=self._frame)

    def close(self) -> None:
        """End the process that plans."""
        self._process.close()
