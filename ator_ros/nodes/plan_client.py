"""A goal of execute_chain that says what is wanted: its chains are asked for before it begins."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeGuard

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.srv import PlanChains
from ator_ros.execution.chain_executor import Ending
from ator_ros.nodes import messages
from ator_ros.nodes.plan_messages import is_asked_for
from ator_ros.nodes.qos import SERVICES
from ator_ros.printable import printable
from ator_ros.world.messages import LONGEST_NAME
from ator_ros.world.state import World

_LONGEST_REASON = 500
PREEMPTED = "a newer goal took over"
"""Why a goal ends that a newer one preempts."""

End = Callable[[ServerGoalHandle, Ending, str], None]


class PlannedGoals:
    """The goal whose chains are awaited, one at a time; the robot meanwhile continues what it does.

    Where what is wanted holds already while something moves the robot, it would not hold for long. Then the
    robot is halted, and the chains are asked for once more when it rests.

    Attributes
    ----------
    halting : bool
        Whether the robot is made to stand before the chains are asked for once more.

    Parameters
    ----------
    node : Node
        The node whose client of plan_chains this is.
    settings : mapping
        The executor's parameters.
    objects : sequence of str
        The domain's objects: who asks waits for them as long as a chain does.
    begin : callable
        Called with the goal once its request holds chains, as if they had been sent with it.
    end : callable
        Called with a goal that ends before, how it ends, and why.
    halt : callable
        Ends what is under way.
    rests : callable
        Returns whether the robot stands, by odometry of just now, and nothing moves it.
    """

    def __init__(
        self,
        node: Node,
        settings: Mapping[str, Any],
        objects: Sequence[str],
        *,
        begin: Callable[[ServerGoalHandle], None],
        end: End,
        halt: Callable[[], None],
        rests: Callable[[], bool],
    ) -> None:
        self._settings, self._objects = settings, frozenset(objects)
        self._begin, self._end, self._halt, self._rests = begin, end, halt, rests
        client: Any = node.create_client(PlanChains, "plan_chains", qos_profile=SERVICES)
        self._client = client
        self._handle: ServerGoalHandle | None = None
        self._future: Future | None = None
        self._came = 0.0
        self._canceled = self._rested = self.halting = False

    @property
    def waiting(self) -> bool:
        """Whether a goal waits for its chains."""
        return self._handle is not None

    def take(self, handle: ServerGoalHandle) -> bool:
        """Take over a goal that says what is wanted; return False where it holds chains instead.

        A goal that waits already is preempted by one that is taken over.
        """
        goal = handle.request
        if not is_asked_for(goal.wanted):
            return False
        if goal.chain.calls or goal.alternatives:
            self._end(handle, Ending.REFUSED, "wanted: expected no chain beside it, got one")
            return True
        self.drop(Ending.PREEMPTED, PREEMPTED)
        self._handle, self._came = handle, time.monotonic()
        self._canceled = self.halting = False
        return True

    def cancel(self, handle: ServerGoalHandle) -> bool:
        """Return whether this goal waits; it then ends with the next `watch`."""
        self._canceled = self._canceled or handle is self._handle
        return handle is self._handle

    def watch(self, world: World | None) -> None:
        """Ask once state and service are there, and give up in time; the `world` is None where it is old."""
        if self._handle is None:
            return
        waited = time.monotonic() - self._came
        if self._canceled:
            self.drop(Ending.CANCELED, "canceled by the client")
        elif self.halting and world is None:
            self.drop(Ending.INPUT_LOST, "odom is missing while the robot is made to stand")
        elif waited > self._settings["plan_timeout"]:
            ending = Ending.BASE_FAULT if self.halting and self._future is None else Ending.REFUSED
            self.drop(ending, f"no plan: expected {self._awaited(world)} in time, got none")
        elif self._may_ask(world):
            complete = self._objects <= world.objects.keys()
            if complete or waited > self._settings["start_timeout"]:
                self._ask(self._handle, world)

    def _may_ask(self, world: World | None) -> TypeGuard[World]:
        if world is None or self._future is not None or not self._client.service_is_ready():
            return False
        return not self.halting or self._rests()

    def _awaited(self, world: World | None) -> str:
        if self._future is not None:
            return "an answer of the service plan_chains"
        if world is None:
            return "odometry"
        if self.halting:
            return "the robot to rest"
        missing = sorted(self._objects - world.objects.keys())
        return f"the {missing[0]}" if missing else "the service plan_chains"

    def _ask(self, handle: ServerGoalHandle, world: World) -> None:
        request = PlanChains.Request(
            situation=messages.situation_of(world, frame=self._settings["frame"]),
            goal=handle.request.wanted,
            action_set=handle.request.chain.action_set,
        )
        if len(request.action_set) > LONGEST_NAME:
            self.drop(Ending.REFUSED, "chain.action_set: expected a short name")
            return
        self._rested = self._rests()
        self._future = future = self._client.call_async(request)
        future.add_done_callback(self._take)

    def _take(self, future: Future) -> None:
        answer, handle = future.result(), self._handle
        if handle is None or future is not self._future or answer is None:
            return
        if self._canceled:
            self.drop(Ending.CANCELED, "canceled by the client")
            return
        holds = answer.accepted and (answer.holds or not answer.chains)
        if holds and not (self._rested and self._rests()):
            self._future, self.halting = None, True
            self._halt()
            return
        self._handle, self._future, self.halting = None, None, False
        if not answer.accepted:
            self._end(handle, Ending.REFUSED, f"no plan: {printable(answer.reason, _LONGEST_REASON)}")
        elif holds:
            self._end(handle, Ending.SUCCEEDED, "the goal holds already")
        else:
            handle.request.chain, *handle.request.alternatives = answer.chains
            self._begin(handle)

    def drop(self, ending: Ending, reason: str) -> None:
        """End the goal that waits, if there is one."""
        handle, future = self._handle, self._future
        self._handle, self._future, self.halting = None, None, False
        if future is not None and not future.done():
            self._client.remove_pending_request(future)
        if handle is not None:
            self._end(handle, ending, reason)
