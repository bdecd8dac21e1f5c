"""One goal of execute_chain as ROS messages: request, refinement, feedback, records and result."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Mapping
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.client import Client
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, Performance
from ator_interfaces.srv import RefineSubgoal
from ator_ros.execution.chain_executor import ActionRecord, Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import Question
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.supervisor import Deadlines, Phase, Supervisor
from ator_ros.nodes.messages import (
    action_set_from,
    alternatives_from,
    call_of,
    chain_from,
    chain_of,
    chain_performance_of,
    gain_of,
    objective_from,
    performance_of,
    situation_of,
)
from ator_ros.printable import printable
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.messages import MessageError
from ator_ros.world.state import World

_FEEDBACK_PERIOD = 0.1  # s on odometry's clock
_LONGEST_REASON = 500
_BROKEN_OFF = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN, Ending.REFUSED)


class GoalRun:
    """An accepted goal while it is executed.

    `finished` is the future of the result, which the executor gives after the last tick.

    Raises
    ------
    MessageError
        The goal cannot be used, or leads out of the fence.
    """

    def __init__(
        self,
        handle: ServerGoalHandle,
        libraries: Mapping[str, TopLibrary],
        predictors: Mapping[str, Predictor],
        refinement: Client,
        settings: Mapping[str, Any],
        fence: Fence,
        rolling: Rolling,
    ) -> None:
        goal, frame = handle.request, settings["frame"]
        action_set = action_set_from(goal.chain, allowed=libraries)
        library = libraries[action_set]
        chain = chain_from(goal.chain, library, frame=frame, fence=fence)
        others = alternatives_from(goal.alternatives, library, frame=frame, fence=fence)
        if unreadable := [each for each in others if isinstance(each, str)]:
            raise MessageError(unreadable[0])
        if goal.refine:
            objective_from(goal.objective, failure_cost=1.0)  # refinement uses it; here it is checked
        self.handle, self._predictor = handle, predictors[action_set]
        self.supervisor = Supervisor(
            library,
            chain,
            now=time.monotonic(),
            predictor=self._predictor,
            deadlines=Deadlines(
                **{field.name: settings[f"{field.name}_timeout"] for field in dataclasses.fields(Deadlines)}
            ),
            fence=fence,
            refine=goal.refine,
            again_after=settings["refine_again_after"],
            fetches=goal.fetches,
            alternatives=[each for each in others if isinstance(each, TopChain)],
            rolling=rolling,
        )
        self._library, self._refinement, self._frame, self._fence = library, refinement, frame, fence
        self._id = id_of(handle)
        self._records: list[ActionPerformance] = []
        self._gain = gain_of()  # of the chain as planned
        self._request: Future | None = None
        self._asked: Question | None = None
        self._feedback = ("", 0.0)  # status and time of the last one
        self.finished = Future()

    @property
    def ended(self) -> bool:
        """Whether the goal has ended and the robot stands."""
        return self.supervisor.phase is Phase.ENDED

    @property
    def summary(self) -> str:
        """How it ended, in one line."""
        run = self.supervisor
        name = run.ending.name.lower() if run.ending else "running"
        refinement = ""
        if run.refining.wanted:
            refinement = f" ({'refined' if run.refining.refined else run.refining.reason})"
        return f"{name} after {run.executor.elapsed:.2f} s: {run.reason}{refinement}"

    def publish_feedback(self) -> None:
        """Publish feedback when the status changes, otherwise every 0.1 s."""
        run = self.supervisor
        now = run.executor.elapsed + (run.start.time if run.start else 0.0)
        published, when = self._feedback
        status = f"{run.executor.index} {run.phase.value}"
        if not self.handle.is_active or (status == published and abs(now - when) < _FEEDBACK_PERIOD):
            return
        self._feedback = (status, now)
        phase = run.phase.value
        doing = phase if run.reason == phase else f"{phase}: {run.reason}"
        feedback = ExecuteChain.Feedback(
            chain_id=self._id,
            step=run.executor.index,
            steps=len(run.executor.chain),
            top=run.executor.call.top.name,
            status=f"{doing} ({run.refining.reason})" if run.refining.wanted else doing,
            elapsed=run.executor.elapsed,
            predicted_remaining=run.predicted_remaining(now),
        )
        self.handle.publish_feedback(feedback)

    # Refinement

    def request_refinement(self) -> None:
        """Send an open question, once the service is there; forget a question that is over."""
        question = self.supervisor.question
        if question is not self._asked and self._request is not None:
            if not self._request.done():
                self._refinement.remove_pending_request(self._request)
            self._request = self._asked = None
        if question is None or self._request is not None or not self._refinement.service_is_ready():
            return
        goal = self.handle.request
        request = RefineSubgoal.Request(
            chain=goal.chain, objective=goal.objective, alternatives=goal.alternatives
        )
        if self.supervisor.phase is not Phase.REFINING:  # the chain has changed since it came
            write = functools.partial(chain_of, action_set=self._library.action_set, frame=self._frame)
            request.chain = write(question.chain)
            request.alternatives = [write(chain) for _, chain in question.others]
            request.as_given = True  # to be better than what is driven
        else:
            request.measure = True
        request.situation = situation_of(question.world, frame=self._frame)
        self._asked, self._request = question, self._refinement.call_async(request)
        self._request.add_done_callback(functools.partial(self._take_answer, question))

    def _take_answer(self, question: Question, future: Future) -> None:
        answer, run = future.result(), self.supervisor
        if answer is None or question is not run.question:  # withdrawn, or late
            return
        reason = printable(answer.reason, _LONGEST_REASON)  # of any server, in feedback, records and the log
        if not answer.accepted:
            run.unrefined(reason)
            return
        if run.phase is Phase.REFINING:
            self._gain = answer.gain
        where = "refined chain"
        try:
            chain = chain_from(answer.chain, self._library, frame=self._frame, where=where, fence=self._fence)
        except MessageError as error:
            run.unrefined(str(error))
        else:
            run.refined_to(chain, answer.refined, reason, chosen=answer.chosen)

    # Records

    def new_records(self) -> list[ActionPerformance]:
        """Return the records of the actions that have ended since the last call."""
        new = [self._action_record(each) for each in self.supervisor.executor.records[len(self._records) :]]
        self._records += new
        return new

    def _action_record(self, record: ActionRecord) -> ActionPerformance:
        call, frame = record.chain.calls[record.index], self._frame
        message = ActionPerformance(
            chain_id=self._id,
            step=record.index,
            steps=len(record.chain),
            action=call.top.action,
            action_set=self._library.action_set,
            call=call_of(call, frame=frame),
            start=situation_of(record.start, frame=frame),
            end=situation_of(record.end, frame=frame),
            predicted=performance_of(self._predictor.action(record.start, record.chain, record.index)),
            actual=_actual(record.duration, record.ending, record.position_error),
            heading_error=float(record.heading_error),
            outcome=Outcome(code=record.ending.value, reason=record.reason),
        )
        message.header = message.end.header
        return message

    @property
    def stage(self) -> tuple[object, ...]:
        """Values whose change is published at once."""
        run, refining = self.supervisor, self.supervisor.refining
        changes = refining.refined, refining.refined_again
        return self._id, run.phase, run.executor.index, len(self._records), *changes

    def record(self, world: World) -> ChainPerformance:
        """Return the record up to now, with predictions at the end; `world` is the last known state."""
        run, frame = self.supervisor, self._frame
        if self.ended:
            predicted = chain_performance_of(run.forecast.whole)
            actual = _actual(run.executor.elapsed, run.ending or Ending.FAILED)
        else:
            waits = run.phase in (Phase.WAITING, Phase.REFINING)
            predicted = performance_of()
            actual = performance_of({} if waits else {"duration": run.executor.elapsed})
        message = ChainPerformance(
            chain_id=self._id,
            chain=chain_of(run.executor.chain, action_set=self._library.action_set, frame=frame),
            start=situation_of(run.start or world, frame=frame),
            refined=run.refining.refined,
            refinement=run.refining.reason,
            fetched=run.executor.fetch_count,
            refined_again=run.refining.refined_again,
            actions=self._records,
            gain=self._gain,
            predicted=predicted,
            actual=actual,
            outcome=Outcome(code=run.ending.value if run.ending else 0, reason=run.reason),
        )
        message.header = situation_of(world, frame=frame).header
        return message

    def result(self, world: World | None) -> Any:
        """Return the result of the goal; `world` is the last known state."""
        if world is None:
            ending = self.supervisor.ending or Ending.FAILED
            return unstarted(self.handle, ending, self.supervisor.reason, frame=self._frame)
        record = self.record(world)
        return ExecuteChain.Result(outcome=record.outcome, record=record)


def id_of(handle: ServerGoalHandle) -> str:
    """Return the goal's UUID as 32 hexadecimal digits."""
    return bytes(handle.goal_id.uuid).hex()


def unstarted(handle: ServerGoalHandle, ending: Ending, reason: str, *, frame: str) -> Any:
    """Return the result of a goal that cannot be used, or that ended before it began."""
    outcome = Outcome(code=ending.value, reason=reason)
    record = ChainPerformance(
        chain_id=id_of(handle),
        chain=handle.request.chain,
        refinement="not requested",
        gain=gain_of(),
        predicted=performance_of(),
        actual=_actual(0.0, ending),
        outcome=outcome,
    )
    record.header.frame_id = frame
    return ExecuteChain.Result(outcome=outcome, record=record)


def concluded(result: Any, handle: ServerGoalHandle) -> Any:
    """Put a goal into its final state and return its result."""
    if result.outcome.code == Outcome.SUCCEEDED:
        handle.succeed()
    elif result.outcome.code == Outcome.CANCELED:
        handle.canceled()
    else:
        handle.abort()
    return result


def _actual(duration: float, ending: Ending, accuracy: float = math.nan) -> Performance:
    """Write an actual performance; the success of an action that was broken off is NaN."""
    success = math.nan if ending in _BROKEN_OFF else float(ending is Ending.SUCCEEDED)
    return performance_of({"duration": duration, "spread": 0.0, "success": success, "accuracy": accuracy})
