"""One goal of execute_chain as ROS messages: request, refinement, feedback, records and result."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.client import Client
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, ChainPerformance, Outcome, Performance
from ator_interfaces.msg import TopChain as TopChainMessage
from ator_interfaces.srv import RefineSubgoal
from ator_ros.execution.chain_executor import ActionRecord, Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import Answer, Question
from ator_ros.execution.rolling import Rolling
from ator_ros.execution.supervisor import Deadlines, Phase, Supervisor
from ator_ros.nodes import messages
from ator_ros.nodes.messages import gain_of, performance_of, situation_of
from ator_ros.nodes.models import ModelSet
from ator_ros.nodes.result_line import changes_of, result_line
from ator_ros.printable import one_line
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.delay import Delay
from ator_ros.world.readers import MessageError
from ator_ros.world.state import World

_FEEDBACK_PERIOD = 0.1  # s on odometry's clock, if neither step nor phase changes
# real s in which DDS connects to a refinement node that is there
_DISCOVERY = 0.5
_INTERRUPTED = (Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN, Ending.REFUSED)


class GoalRun:
    """An accepted goal while it is executed.

    `finished` is the future of its result, which the executor sets. Raises MessageError if the
    goal's objective cannot be used.
    """

    def __init__(
        self,
        handle: ServerGoalHandle,
        library: TopLibrary,
        chains: Sequence[TopChain],
        models: ModelSet,
        refinement: Client,
        settings: Mapping[str, Any],
        fence: Fence,
        rolling: Rolling,
        delay: Delay | None,
    ) -> None:
        goal = handle.request
        chain, *others = chains
        if goal.refine:
            # only checked here; refinement uses it
            messages.objective_from(goal.objective, failure_cost=1.0)
        timeouts = [field.name for field in dataclasses.fields(Deadlines)]
        self.handle = handle
        self._predictor = Predictor(library.robot, models.models)
        self.supervisor = Supervisor(
            library,
            chain,
            now=time.monotonic(),
            predictor=self._predictor,
            deadlines=Deadlines(**{name: settings[f"{name}_timeout"] for name in timeouts}),
            fence=fence,
            refine=goal.refine,
            again_after=settings["refine_again_after"],
            fetches=goal.fetches,
            alternatives=others,
            rolling=rolling,
            delay=delay,
        )
        self._library = library
        self._refinement = refinement
        self._frame = settings["frame"]
        self._fence = fence
        self._id = _id_of(handle)
        self._records: list[ActionPerformance] = []
        self._gain = gain_of()  # as predicted when the chain was refined
        self._changes: list[str] = []  # what refinement changed in it, in words
        self._request: Future | None = None
        self._asked: Question | None = None
        self._feedback = ("", 0.0)  # step and phase of the last feedback, and its time in s
        self.finished = Future()

    @property
    def ended(self) -> bool:
        """Whether the goal has ended and the robot stands."""
        return self.supervisor.phase is Phase.ENDED

    @property
    def summary(self) -> str:
        """Ending, duration and reason in one line."""
        supervisor = self.supervisor
        name = supervisor.ending.name.lower() if supervisor.ending else "running"
        refinement = ""
        if supervisor.refining.wanted:
            refinement = (
                f" ({'refined' if supervisor.refining.refined else supervisor.refining.reason})"
            )
        return f"{name} after {supervisor.executor.elapsed:.2f} s: {supervisor.reason}{refinement}"

    def publish_feedback(self) -> None:
        """Publish feedback when the step or the phase changes, otherwise every 0.1 s."""
        supervisor = self.supervisor
        now = supervisor.executor.elapsed + (supervisor.start.time if supervisor.start else 0.0)
        phase = supervisor.phase.value
        step_and_phase = f"{supervisor.executor.index} {phase}"
        last, last_time = self._feedback
        is_due = step_and_phase != last or abs(now - last_time) >= _FEEDBACK_PERIOD
        if not self.handle.is_active or not is_due:
            return
        self._feedback = step_and_phase, now
        chain = supervisor.executor.chain
        status = phase if supervisor.reason == phase else f"{phase}: {supervisor.reason}"
        feedback = ExecuteChain.Feedback(
            chain_id=self._id,
            step=chain.order[supervisor.executor.index],
            order=chain.order,
            steps=len(chain),
            top=supervisor.executor.call.top.name,
            status=f"{status} ({supervisor.refining.reason})"
            if supervisor.refining.wanted
            else status,
            elapsed=supervisor.executor.elapsed,
            predicted_remaining=supervisor.predicted_remaining(now),
        )
        self.handle.publish_feedback(feedback)

    def request_refinement(self) -> None:
        """Send an open question to the service, and withdraw one that has become obsolete."""
        question = self.supervisor.question
        if question is not self._asked and self._request is not None:
            if not self._request.done():
                self._refinement.remove_pending_request(self._request)
            self._request = self._asked = None
        if question is None or self._request is not None:
            return
        if not self._refinement.service_is_ready():
            if time.monotonic() - question.asked > _DISCOVERY:
                self.supervisor.answer(
                    Answer(
                        None,
                        False,
                        f"expected the service refine_subgoal within {_DISCOVERY:g} s, got none; "
                        "start a refinement node",
                    )
                )
            return
        goal = self.handle.request
        request = RefineSubgoal.Request(
            chain=goal.chain, objective=goal.objective, alternatives=goal.alternatives
        )
        if self.supervisor.phase is Phase.REFINING:
            request.measure = True
        else:
            # the chain has changed since it was sent; the answer must be better than its goals now
            frame = self._frame
            request.chain = messages.chain_of(
                question.chain, action_set=self._library.action_set, frame=frame
            )
            others = (chain for _, chain in question.others)
            request.alternatives = [messages.alternative_of(each, frame=frame) for each in others]
            request.as_given = True
        request.situation = situation_of(question.world, frame=self._frame)
        self._asked = question
        self._request = self._refinement.call_async(request)
        self._request.add_done_callback(partial(self._take_answer, question))

    def _take_answer(self, question: Question, future: Future) -> None:
        answer = future.result()
        supervisor = self.supervisor
        if answer is None or question is not supervisor.question:  # withdrawn, or late
            return
        reason = one_line(answer.reason)
        if not answer.accepted:
            supervisor.answer(Answer(None, False, reason))
            return
        if supervisor.phase is Phase.REFINING:
            self._gain = answer.gain
            self._changes = changes_of(answer)
        frame = self._frame
        where = "refined chain"
        try:
            chain = messages.chain_from(
                answer.chain, self._library, frame=frame, where=where, fence=self._fence
            )
        except MessageError as error:
            supervisor.answer(Answer(None, False, str(error)))
        else:
            chain = dataclasses.replace(chain, sent_as=messages.order_from(answer.order))
            supervisor.answer(Answer(chain, answer.refined, reason, chosen=answer.chosen))

    def new_records(self) -> list[ActionPerformance]:
        """Return the records of the actions that have ended since the last call."""
        new = [
            self._action_record(each)
            for each in self.supervisor.executor.records[len(self._records) :]
        ]
        self._records += new
        return new

    def _action_record(self, record: ActionRecord) -> ActionPerformance:
        call = record.chain.calls[record.index]
        frame = self._frame
        end = situation_of(record.end, frame=frame)
        return ActionPerformance(
            header=end.header,
            chain_id=self._id,
            step=record.chain.order[record.index],
            steps=len(record.chain),
            action=call.top.action,
            action_set=self._library.action_set,
            call=messages.call_of(call, frame=frame),
            start=situation_of(record.start, frame=frame),
            end=end,
            predicted=performance_of(
                self._predictor.action(record.start, record.chain, record.index)
            ),
            actual=_actual(record.duration, record.ending, record.position_error),
            stopped=record.stopped,
            **record.parts._asdict(),
            heading_error=float(record.heading_error),
            outcome=Outcome(code=record.ending.value, reason=record.reason),
        )

    @property
    def published_state(self) -> tuple[object, ...]:
        """The values whose changes are published immediately."""
        supervisor = self.supervisor
        refining = self.supervisor.refining
        changes = refining.refined, refining.refined_again
        return self._id, supervisor.phase, supervisor.executor.index, len(self._records), *changes

    def record(self, world: World) -> ChainPerformance:
        """Return the record up to now, with predictions at the end.

        `world` is the last known state.
        """
        supervisor = self.supervisor
        frame = self._frame
        code = supervisor.ending.value if supervisor.ending else 0
        if self.ended:
            predicted = messages.chain_performance_of(supervisor.forecast.whole)
            actual = _actual(supervisor.executor.elapsed, supervisor.ending or Ending.FAILED)
        else:
            waits = supervisor.phase in (Phase.WAITING, Phase.REFINING)
            predicted = performance_of()
            elapsed = supervisor.executor.elapsed
            actual = performance_of({} if waits else {"duration": elapsed, "bound": elapsed})
        chain = supervisor.executor.chain
        return ChainPerformance(
            header=situation_of(world, frame=frame).header,
            chain_id=self._id,
            chain=messages.chain_of(chain, action_set=self._library.action_set, frame=frame),
            order=chain.order,
            start=situation_of(supervisor.start or world, frame=frame),
            refined=supervisor.refining.refined,
            refinement=one_line(supervisor.refining.reason),
            fetched=supervisor.executor.fetch_count,
            refined_again=supervisor.refining.refined_again,
            actions=self._records,
            gain=self._gain,
            predicted=predicted,
            actual=actual,
            outcome=Outcome(code=code, reason=one_line(supervisor.reason)),
        )

    def result(self, world: World | None) -> Any:
        """Return the result of the goal; `world` is the last known state."""
        if world is None:
            ending = self.supervisor.ending or Ending.FAILED
            return unstarted(self.handle, ending, self.supervisor.reason, frame=self._frame)
        record = self.record(world)
        wanted = self.supervisor.refining.wanted
        line = result_line(record, wanted=wanted, changes=self._changes)
        outcome = Outcome(code=record.outcome.code, reason=line)
        return ExecuteChain.Result(outcome=outcome, record=record)


def _id_of(handle: ServerGoalHandle) -> str:
    return bytes(handle.goal_id.uuid).hex()


def unstarted(handle: ServerGoalHandle, ending: Ending, reason: str, *, frame: str) -> Any:
    """Return the result of a goal that cannot be used, or that ended before it started."""
    outcome = Outcome(code=ending.value, reason=reason)
    record = ChainPerformance(
        chain_id=_id_of(handle),
        chain=messages.chain_to_return(handle.request.chain),
        refinement="not requested",
        gain=gain_of(),
        predicted=performance_of(),
        actual=_actual(0.0, ending),
        outcome=outcome,
    )
    record.header.frame_id = frame
    return ExecuteChain.Result(outcome=outcome, record=record)


def concluded(result: Any, handle: ServerGoalHandle) -> Any:
    """Put a goal into its final state and return its result.

    The request is emptied: rclpy keeps it as long as the result, and searches it for garbage.
    """
    handle.request.chain = TopChainMessage()
    handle.request.alternatives = []
    if result.outcome.code == Outcome.SUCCEEDED:
        handle.succeed()
    elif result.outcome.code == Outcome.CANCELED and handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
    return result


def _actual(duration: float, ending: Ending, accuracy: float = math.nan) -> Performance:
    """Write an actual performance; success is NaN after an interruption."""
    success = math.nan if ending in _INTERRUPTED else float(ending is Ending.SUCCEEDED)
    return performance_of(
        {
            "duration": duration,
            "spread": 0.0,
            "bound": duration,
            "success": success,
            "accuracy": accuracy,
        }
    )
