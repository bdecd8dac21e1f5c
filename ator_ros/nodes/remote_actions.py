"""Actions that action servers of other programs execute."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.client import Client
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.task import Future

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.actions.remote import RemoteCall, failure_in
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.nodes.qos import ACTION_QUEUES, SERVICES
from ator_ros.nodes.remote_messages import RemoteError, RemoteInterface
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, World

_REQUESTS = 6  # requests to a server within its longest silence
_LEAST_PERIOD = 0.05  # real s between two of them
# real s between cancellations of a goal that a server may yet accept, and the answers after which a
# server that does not know it will not
_CANCEL_PERIOD = 0.5
_MOST_UNKNOWN = 4
# s, by the stamps and in real time, after a result: a state from localization is up to 0.3 s old,
# and the robot may still brake
_NEWER = 0.5


class RemoteServers:
    """The servers of a domain's remote actions.

    Parameters
    ----------
    frame : str
        The frame of states and goals.
    warn : callable
        Called with a warning: about a server that cannot be used or has ignored a cancellation, and
        about goals of other servers that were canceled instead.

    Attributes
    ----------
    problem : str
        The servers that cannot be used as declared, and their actions; empty if there are none.
    """

    def __init__(
        self, node: Node, domain: Domain, frame: str, warn: Callable[[str], object]
    ) -> None:
        self._domain = domain
        callers: dict[RemoteCall, set[str]] = {}
        for spec in chain.from_iterable(domain.action_sets.values()):
            for call in () if spec.remote is None else spec.remote.servers:
                callers.setdefault(call, set()).add(spec.name)
        self._servers = {
            call: RemoteServer(node, call, frame, warn) for call in sorted(callers, key=repr)
        }
        for call, server in self._servers.items():
            server.through = self._servers.get(call.through) if call.through else None
        self.problem = "; ".join(
            f"{server.fault}; without it {', '.join(sorted(callers[call]))} cannot be executed"
            for call, server in self._servers.items()
            if server.fault
        )
        if self.problem:
            warn(self.problem)

    def libraries(self, robot: Robot) -> dict[str, TopLibrary]:
        """Return the libraries of all action sets, in which servers execute the remote actions."""
        libraries = {}
        for name, specs in self._domain.action_sets.items():
            remote = {
                spec.name: partial(RemoteAction, server=self._servers[spec.remote])
                for spec in specs
                if spec.remote is not None
            }
            libraries[name] = self._domain.library(robot, name, remote)
        return libraries

    def ending(self) -> bool:
        """Return whether a server may still move the robot after its goal was canceled."""
        return any(server.ending() for server in self._servers.values())

    def check(self) -> None:
        """Cancel what may still move the robot although its goal was canceled.

        Call this periodically.
        """
        for server in self._servers.values():
            server.check()

    def stop(self) -> None:
        """Cancel what may still move the robot, before the node ends."""
        for server in self._servers.values():
            server.stop()


class RemoteAction(Action):
    """Lets an action server move the robot.

    The goal is sent once the robot was commanded to stop and stands, or at once if it takes over
    from a goal of a server that takes newer goals. From then on no velocity is commanded until the
    server has ended. Servers report success while the robot still turns, so an action whose goal
    has no speed ends once it stands: the turn at its goal decides how long it stops. No method
    waits; the times of `Timeouts` are checked in each tick.

    A run of goals that are passed is sent at once to the server `through` them: the next action
    takes over the sent goal, or sends the rest of the run as a newer one if the server is `early`.
    """

    name = "remote"

    def __init__(self, robot: Robot, server: RemoteServer) -> None:
        super().__init__(robot)
        self._server = server
        self._goals: tuple[Goal, ...] = ()  # that are sent at once
        self._sent: RemoteGoal | None = None
        # the goal that this one takes over from, until it is over
        self._former: RemoteGoal | None = None
        self._stopped = False
        self._since = 0.0  # real time in s at which waiting for the server started
        # real time and stamp in s of the first state that is read after the result
        self._result_at: tuple[float, float] | None = None
        self._accepted_at: float | None = None  # stamp in s of the first state after acceptance

    def start(self, world: World, goal: Goal) -> None:  # noqa: ARG002
        """Commit to `goal`; it is sent in a later tick."""
        if self._server.fault:
            raise ActionError(self._server.fault)
        self._goals = (goal,)
        self._since = time.monotonic()

    def followed_by(self, goals: Sequence[Goal]) -> None:
        """Drive through the goals if there is a server for that."""
        through = self._server.through
        if through is None:
            return
        if through.fault:
            raise ActionError(through.fault)
        self._server = through
        self._goals += tuple(goals)

    @property
    def drives_on(self) -> bool:
        """Whether the server has been sent the goals that follow, too."""
        return len(self._goals) > 1

    def take_over(self, former: Action) -> None:
        """Let the server drive on until it has this goal, if it takes newer goals.

        It may have it already, as one of a run.
        """
        if not isinstance(former, RemoteAction):
            return
        is_sent = former._sent is not None and former._goals[1:] == self._goals
        if is_sent and not former._server.call.early:
            self._server = former._server
            self._sent = former._sent
            self._former = former._former
            former._sent = former._former = None
        elif former.drives_on or self._server.call.early:
            self._server = former._server
            self._former = former.hand_over()

    def hand_over(self) -> RemoteGoal | None:
        """Return the goal that the server executes, and do not cancel it; None if it is over."""
        sent = self._sent if self._sent is not None else self._former
        if sent is None or sent.over:
            return None
        if sent is self._sent and self._former is not None and not sent.accepted:
            self._former.release()
        self._sent = self._former = None
        return sent

    def step(self, world: World) -> Step:
        """Return the next step; its command is None from the tick on in which the goal is sent."""
        return self._prepare(world) if self._sent is None else self._wait(world, self._sent)

    def is_before_result(self, world: World) -> bool:
        """Return whether `world` may be older than the server's result."""
        if self._result_at is None:
            return False
        real, stamp = self._result_at
        return time.monotonic() - real < _NEWER or world.time - stamp < _NEWER

    def end(self, reason: str) -> None:  # noqa: ARG002
        """Cancel the goal unless it is over; `RemoteServer.ending` tracks the rest."""
        for goal in (self._former, self._sent):
            if goal is not None:
                self._server.release(goal)

    def _prepare(self, world: World) -> Step:
        """Stop the robot, wait for the server, then send the goal."""
        server = self._server
        now = time.monotonic()
        was_stopped = self._stopped
        self._stopped = True
        drives_on = self._former is not None and not self._former.over
        if not drives_on and not (was_stopped and world.robot.is_standing):
            self._since = now
            return Step(STOP, Status.RUNNING, f"stopping, before {server.name} takes over")
        if unusable := server.unusable():
            late = now - self._since > server.timeouts.server
            command = None if drives_on else STOP
            return (
                finished(Status.REFUSED, unusable)
                if late
                else Step(command, Status.RUNNING, unusable)
            )
        self._sent = server.send(self._goals, self._former)
        self._since = now
        return Step(None, Status.RUNNING, f"sent to {server.name}")

    def _wait(self, world: World, sent: RemoteGoal) -> Step:
        """Check acceptance, result and timeouts of the goal that was sent."""
        server = self._server
        name = self._server.name
        limits = self._server.timeouts
        if sent.result is not None:
            self._result_at = self._result_at or (time.monotonic(), world.time)
            failure = failure_in(server.call, sent.status, sent.result)
            if failure is not None:
                return finished(Status.FAILED, f"{name} failed: {failure}")
            if self._goals[-1].speed == 0.0 and not world.robot.is_standing:
                return Step(STOP, Status.RUNNING, f"{name} succeeded; stopping")
            return finished(Status.SUCCEEDED, f"{name} succeeded")
        if sent.accepted is False:
            return finished(Status.REFUSED, f"{name} rejected the goal")
        if server.lost():
            missing = f"its action server has been missing for {server.longest_absence:g} s"
            return finished(Status.FAILED, f"{name} is gone: {missing}")
        if sent.accepted is None:
            if time.monotonic() - self._since <= limits.acceptance:
                return Step(None, Status.RUNNING, f"waiting for {name} to accept")
            within = f"expected that within {limits.acceptance:g} s"
            return finished(Status.REFUSED, f"{name} did not answer the goal: {within}")
        if self._accepted_at is None:
            self._accepted_at = world.time
        if self._former is not None and self._former.over:
            self._former = None
        if sent.silence() > limits.silence:
            server.cancel_others()
            within = f"expected a sign of life within {limits.silence:g} s, got none"
            return finished(Status.FAILED, f"{name} is gone or hangs: {within}")
        if world.time - self._accepted_at > limits.result:
            within = f"expected a result within {limits.result:g} s, got none"
            return finished(Status.FAILED, f"{name} took too long: {within}")
        return Step(None, Status.RUNNING, f"executed by {name}")


class RemoteServer:
    """Sends goals to one action server, and tracks canceled goals until they are over.

    `fault` is why the server cannot be used, as without its type; empty if it can. `through` is the
    server that drives through several goals, if there is one.
    """

    def __init__(
        self, node: Node, call: RemoteCall, frame: str, warn: Callable[[str], object]
    ) -> None:
        self.call = call
        self.name = call.server
        self.timeouts = call.timeouts
        self.fault = ""
        self.through: RemoteServer | None = None
        self._node = node
        self._present_at = -math.inf  # real s
        self._released: list[RemoteGoal] = []
        self._unanswered: list[RemoteGoal] = []  # released before the server accepted them
        self._cancel_deadline = 0.0  # real s; for the ends of `_released`
        self._warn = warn
        try:
            self._interface = RemoteInterface(call, frame)
            self._client = ActionClient(node, self._interface.kind, call.server, **ACTION_QUEUES)
            self._cancel, *others = (
                node.create_client(CancelGoal, f"{name}/_action/cancel_goal", qos_profile=SERVICES)
                for name in (call.server, *call.cancel_too)
            )
            self._others = dict(zip(call.cancel_too, others, strict=True))
        except (RemoteError, NameValidationException) as error:
            self.fault = f"action server {call.server}: {error}"

    def present(self) -> bool:
        """Return whether the server is there now."""
        is_present = bool(self._client.server_is_ready())
        self._present_at = time.monotonic() if is_present else self._present_at
        return is_present

    @property
    def longest_absence(self) -> float:
        """The real s after which a missing server counts as lost during the execution of a goal."""
        return min(self.timeouts.server, self.timeouts.silence)

    def lost(self) -> bool:
        """Return whether the server has been missing for longer than `longest_absence`."""
        return not self.present() and time.monotonic() - self._present_at > self.longest_absence

    def unusable(self) -> str:
        """Return why no goal can be sent now.

        Empty if one can. DDS lists killed servers for up to 20 s.
        """
        within = f"expected one action server within {self.timeouts.server:g} s"
        if not self.present():
            return f"{self.name}: {within}, got none"
        servers = self._node.count_services(f"{self.name}/_action/send_goal")
        return (
            f"{self.name}: {within}, got {servers}: each would move the robot"
            if servers > 1
            else ""
        )

    def send(self, goals: Sequence[Goal], former: RemoteGoal | None = None) -> RemoteGoal:
        """Send a goal, or several as one, perhaps while this server executes a `former` one."""
        message = self._interface.written(goals)
        sent = RemoteGoal(self._client, message, self._cancel, self.timeouts.silence)
        if former is not None:
            sent.has_answered = former.has_answered
        return sent

    def release(self, sent: RemoteGoal) -> None:
        """Cancel a goal unless it is over.

        The server is `ending` until then, or until a timeout. If there is no server any more, all
        goals of the servers `cancel_too` are canceled.
        """
        if not sent.release():
            return
        if sent.accepted is None:
            self._unanswered.append(sent)
        if self.present():
            self._released.append(sent)
            self._cancel_deadline = time.monotonic() + self.timeouts.cancel
        else:
            self.cancel_others()

    def cancel_others(self) -> None:
        """Cancel all goals of the servers `cancel_too`, which may still move the robot."""
        for name, client in self._others.items():
            if client.service_is_ready():
                # an empty goal id and a stamp of 0 mean all goals
                answer = client.call_async(CancelGoal.Request())
                answer.add_done_callback(partial(self._take_canceled, name))

    def _take_canceled(self, name: str, answer: Future) -> None:
        canceled = len(answer.result().goals_canceling)
        if canceled:
            self._warn(
                f"{self.name} is gone, hangs or ignored its cancellation; canceled {canceled} "
                f"goals of {name}"
            )

    def ending(self) -> bool:
        """Return whether a canceled goal may still be executed."""
        return self._is_canceling() and self.present() and time.monotonic() <= self._cancel_deadline

    def check(self) -> None:
        """Cancel all goals of the servers `cancel_too` if this server has ignored a cancellation.

        Its goal is not tracked any more then. A goal that it has not answered is canceled until it
        cannot be accepted any more: a server that was frozen may do so later, and its answer may be
        lost.
        """
        self._unanswered = [sent for sent in self._unanswered if sent.is_canceled_again()]
        if self._is_canceling() and time.monotonic() > self._cancel_deadline:
            self.stop()
            self._warn(
                f"{self.name} did not end its goal within {self.timeouts.cancel:g} s of its "
                "cancellation: it may still move the robot"
            )

    def stop(self) -> None:
        """Cancel all goals of the servers `cancel_too` unless this server's goal is over."""
        if self._is_canceling():
            self._released.clear()
            self.cancel_others()

    def _is_canceling(self) -> bool:
        self._released = [goal for goal in self._released if not goal.over]
        return bool(self._released)


class RemoteGoal:
    """One goal of a server.

    `accepted` is None before the answer; `status` and `result` are those of the server.
    `has_answered` is whether the server has answered a request while it drives. DDS lists a
    server that was killed for up to 20 s. Therefore the server is requested periodically, one
    request at a time, to cancel an unknown goal. Each server answers that immediately, except one
    that has no free thread while it drives: missing answers count only after a first one. A
    restarted server does not answer requests to its predecessor, and does not execute the goal
    either.
    """

    def __init__(self, client: ActionClient, message: Any, cancel: Client, silence: float) -> None:
        self.accepted: bool | None = None
        self.status = GoalStatus.STATUS_UNKNOWN
        self.result: Any = None
        self._handle: ClientGoalHandle | None = None
        self._released = False
        self._cancellation = cancel_request_for_unknown_goal()
        self._canceled_at = -math.inf  # real s
        self._unknown = 0  # answers to cancellations of servers that do not know the goal
        self._cancel = cancel
        self._period = max(silence / _REQUESTS, _LEAST_PERIOD)
        self._request: Future | None = None
        self.has_answered = False
        self._silence = 0.0
        self._checked_at = self._requested_at = math.inf
        goal_id = self._cancellation.goal_info.goal_id
        sent = client.send_goal_async(
            message, feedback_callback=lambda _: self._reset_silence(), goal_uuid=goal_id
        )
        sent.add_done_callback(self._take_answer)

    @property
    def over(self) -> bool:
        """Whether the server has rejected the goal or sent its result."""
        return self.accepted is False or self.result is not None

    def release(self) -> bool:
        """Cancel the goal unless it is over, now or once it is accepted.

        Return whether it was not over.
        """
        if self._request is not None and not self._request.done():
            self._cancel.remove_pending_request(self._request)
        self._released = True
        if self._handle is not None and not self.over:
            self._handle.cancel_goal_async()
        return not self.over

    def is_canceled_again(self) -> bool:
        """Cancel the goal again if it may yet be accepted; return whether it may."""
        if self.accepted is not None or self._unknown >= _MOST_UNKNOWN:
            return False
        now = time.monotonic()
        if now - self._canceled_at >= _CANCEL_PERIOD and self._cancel.service_is_ready():
            self._canceled_at = now
            if self._request is not None:
                self._cancel.remove_pending_request(self._request)
            self._request = self._cancel.call_async(self._cancellation)
            self._request.add_done_callback(self._take_canceled)
        return True

    def _take_canceled(self, answer: Future) -> None:
        code = answer.result().return_code
        if code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            self._unknown += 1
        elif code != CancelGoal.Response.ERROR_REJECTED:
            self._unknown = _MOST_UNKNOWN

    def silence(self) -> float:
        """Return the real s without a sign of life; 0 for a server that has never answered."""
        now = time.monotonic()
        # Answers are not read while this node is delayed: a long interval counts as one period.
        self._silence += min(max(now - self._checked_at, 0.0), self._period)
        self._checked_at = now
        if self._request is None and now >= self._requested_at + self._period:
            self._requested_at = now
            self._request = self._cancel.call_async(cancel_request_for_unknown_goal())
            self._request.add_done_callback(self._take_reply)
        return self._silence if self.has_answered else 0.0

    def _take_reply(self, _: Future) -> None:
        self._request = None
        self.has_answered = True
        self._reset_silence()

    def _reset_silence(self) -> None:
        self._silence = 0.0

    def _take_answer(self, future: Future) -> None:
        handle = future.result()
        self.accepted = bool(handle.accepted)
        if not self.accepted:
            return
        self._handle = handle
        self._requested_at = time.monotonic()
        handle.get_result_async().add_done_callback(self._take_result)
        if self._released:
            handle.cancel_goal_async()

    def _take_result(self, future: Future) -> None:
        self.status = future.result().status
        self.result = future.result().result


def cancel_request_for_unknown_goal() -> CancelGoal.Request:
    """Return a request that each action server answers without effect."""
    request = CancelGoal.Request()
    request.goal_info.goal_id.uuid = list(uuid.uuid4().bytes)
    return request
