"""The service plan_chains: chains for a goal, planned in a process of its own."""

from __future__ import annotations

import functools
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rclpy.node import Node

from ator_interfaces.srv import PlanChains
from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain
from ator_ros.nodes import conversions
from ator_ros.nodes.deferred_service import Answer, DeferredService
from ator_ros.nodes.plan_messages import answered, refused, wishes_from
from ator_ros.planning.errors import PlanningError
from ator_ros.planning.process import PlanProcess
from ator_ros.planning.wanted import Wish, known_variables
from ator_ros.printable import printable
from ator_ros.tops.library import TopLibrary
from ator_ros.world import messages
from ator_ros.world.messages import MessageError
from ator_ros.world.state import World

_MOST_WAITING = 8
_LONGEST_REASON = 500
_ENDING = 1.0
"""Real time in s to wait for the thread; a process that still starts ends when its input does."""
_WARNING_PERIOD = 2.0


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request that waits for its plan."""

    wishes: Sequence[Wish]
    world: World
    library: TopLibrary
    answer: Answer
    began: float


class PlanService:
    """Serves plan_chains; a thread waits for the process that plans.

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
        self._waiting: queue.Queue[_Asked | None] = queue.Queue()
        self._done: deque[Callable[[], None]] = deque()
        self._ready = node.create_guard_condition(self._send)
        self._thread: threading.Thread | None = None
        self._closed = False
        self._service = DeferredService(node, PlanChains, "plan_chains", self._begin, work=lambda: None)

    def _begin(self, request: PlanChains.Request, answer: Answer) -> None:
        began = time.perf_counter()
        if self._waiting.qsize() >= _MOST_WAITING:
            answer(
                refused(f"busy: expected at most {_MOST_WAITING} goals at once, got more; ask again later")
            )
            return
        try:
            asked = self._read(request, answer, began)
        except MessageError as error:
            self._answer(answer, refused(str(error)), began)
            return
        self._waiting.put(asked)
        if self._thread is None:
            self._thread = threading.Thread(target=self._plan, daemon=True)
            self._thread.start()

    def _read(self, request: PlanChains.Request, answer: Answer, began: float) -> _Asked:
        name = messages.name(request.action_set or DEFAULT_SET, "action_set", allowed=self._libraries)
        library = self._libraries[name]
        wishes = wishes_from(request.goal, self._goals, self._variables)
        world = conversions.world_from(request.situation, frame=self._frame)
        return _Asked(wishes, world, library, answer, began)

    def _plan(self) -> None:
        """Work off what waits, beside the node's own thread, which answers."""
        while (asked := self._waiting.get()) is not None:
            try:
                found = self._process.chains(asked.wishes, asked.world, asked.library)
                response = answered(found, action_set=asked.library.action_set, frame=self._frame)
            except PlanningError as error:
                response = refused(printable(str(error), _LONGEST_REASON))
            except Exception as error:  # a defect of ours must not end the thread
                response = refused(f"internal error: {printable(repr(error), _LONGEST_REASON)}")
            if self._closed:  # the node may be gone, and nobody sends any more
                return
            self._done.append(functools.partial(self._answer, asked.answer, response, asked.began))
            self._ready.trigger()

    def _send(self) -> None:
        while self._done:
            self._done.popleft()()

    def _answer(self, answer: Answer, response: PlanChains.Response, began: float) -> None:
        if response.accepted:
            self.answered += 1
        else:
            self.refused += 1
            self._node.get_logger().warning(
                f"no plan: {response.reason}", throttle_duration_sec=_WARNING_PERIOD
            )
        response.computation_time = time.perf_counter() - began
        answer(response)

    def close(self) -> None:
        """End the process and the thread; requests that wait are not answered."""
        self._closed = True
        self._process.close()
        self._waiting.put(None)
        if self._thread is not None:
            self._thread.join(_ENDING)
