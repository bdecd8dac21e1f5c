"""One goal of execute_chain: its execution, its action handle, and its call of refinement."""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping
from typing import Any

from rclpy.action.server import ServerGoalHandle
from rclpy.client import Client
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import ActionPerformance, ChainPerformance
from ator_interfaces.srv import RefineSubgoal
from ator_ros.execution.execution import Execution
from ator_ros.execution.fence import Fence
from ator_ros.execution.phases import Deadlines, Ending, Phase
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import Question, Refining
from ator_ros.execution.rolling import Rolling
from ator_ros.nodes import messages
from ator_ros.nodes.execution_records import (
    action_record_of,
    actual,
    chain_record_of,
    chain_so_far_of,
    outcome_of,
)
from ator_ros.nodes.executor_settings import deadlines_of
from ator_ros.printable import printable
from ator_ros.tops.chain import TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.messages import MessageError
from ator_ros.world.state import World

_FEEDBACK_PERIOD = 0.1
_LONGEST_REASON = 200


class GoalRun:
    """An accepted goal while it is executed.

    Parameters
    ----------
    handle : ServerGoalHandle
        The goal.
    library, predictor
        Of the action set that the goal names.
    refinement : Client
        Of the service refine_subgoal.
    deadlines : Deadlines
        When to give up waiting.
    fence : Fence
        Where the robot may drive.
    rolling : Rolling
        What the executor knows of how objects roll.
    refine_again_after : float
        Distance in m by which an object or the robot must differ from what refinement was told to ask it
        again; 0: never.
    frame : str
        The frame of all poses.

    Raises
    ------
    MessageError
        The goal cannot be used, or leads out of the fence.
    """

    def __init__(
        self,
        handle: ServerGoalHandle,
        library: TopLibrary,
        predictor: Predictor,
        refinement: Client,
        *,
        deadlines: Deadlines,
        fence: Fence,
        rolling: Rolling,
        refine_again_after: float,
        frame: str,
    ) -> None:
        goal = handle.request
        chain = messages.chain_from(goal.chain, library, frame=frame, fence=fence)
        others = _alternatives(goal, library, frame, fence)
        if goal.refine:
            messages.objective_from(goal.objective, failure_cost=1.0)  # what it is, refinement knows
        self.handle = handle
        self.execution = Execution(
            library,
            chain,
            refining=Refining(library.robot, wanted=goal.refine, again_after=refine_again_after),
            now=time.monotonic(),
            predictor=predictor,
            deadlines=deadlines,
            fence=fence,
            fetches=goal.fetches,
            alternatives=others,
            rolling=rolling,
        )
        self._library, self._refinement, self._frame, self._fence = library, refinement, frame, fence
        self._named = {"chain_id": id_of(handle), "action_set": library.action_set, "frame": frame}
        self._records: list[ActionPerformance] = []
        self._request: Future | None = None
        self._asked: Question | None = None
        self._told = ("", 0.0)

    @property
    def ended(self) -> bool:
        """Whether there is nothing more to do."""
        return self.execution.phase is Phase.ENDED

    @property
    def summary(self) -> str:
        """How it ended, in one line."""
        execution = self.execution
        name = execution.ending.name.lower() if execution.ending else "running"
        return (
            f"{name} after {execution.elapsed:.2f} s: {execution.reason}{self._refinement_remark('refined')}"
        )

    def new_records(self) -> list[ActionPerformance]:
        """Return the records of the actions that have ended since the last call."""
        new = [
            action_record_of(record, self.execution, **self._named)
            for record in self.execution.records[len(self._records) :]
        ]
        self._records += new
        return new

    @property
    def stage(self) -> tuple[object, ...]:
        """What others should learn of at once when it changes."""
        run, records = self.execution, len(self._records)
        return self._named["chain_id"], run.phase, run.step, records, run.refined, run.refined_again

    def so_far(self, world: World) -> ChainPerformance:
        """Return how it goes; `world` is the last state known."""
        return chain_so_far_of(self.execution, self._records, world=world, **self._named)

    def publish_feedback(self) -> None:
        """Publish feedback when the status changes, otherwise every 0.1 s."""
        execution = self.execution
        now = execution.elapsed + (execution.start.time if execution.start else 0.0)
        told, when = self._told
        status = f"{execution.step} {execution.phase.value}"
        if not self.handle.is_active or (status == told and abs(now - when) < _FEEDBACK_PERIOD):
            return
        self._told = (status, now)
        phase, reason = execution.phase.value, execution.reason
        doing = phase if reason == phase else f"{phase}: {reason}"
        feedback = ExecuteChain.Feedback(
            chain_id=self._named["chain_id"],
            step=execution.step,
            steps=len(execution.chain),
            top=execution.top.name,
            status=f"{doing}{self._refinement_remark()}",
            elapsed=execution.elapsed,
            predicted_remaining=execution.predicted_remaining(now),
        )
        self.handle.publish_feedback(feedback)

    # Refinement

    def _refinement_remark(self, refined: str = "") -> str:
        """Return the result of refinement in parentheses; empty if the goal does not ask for refinement."""
        if not self.handle.request.refine:
            return ""
        short = refined if refined and self.execution.refined else self.execution.refinement
        return f" ({short})"

    def request_refinement(self) -> None:
        """Ask what the execution wants to know, once the service is there; forget a question that is over."""
        question = self.execution.question
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
        if self.execution.phase is not Phase.REFINING:  # the chain has changed since it came
            write = functools.partial(
                messages.chain_of, action_set=self._library.action_set, frame=self._frame
            )
            request.chain = write(question.chain)
            request.alternatives = [write(other.chain) for other in question.others]
            request.as_given = True  # to be better than what is driven
        request.situation = messages.situation_of(question.world, frame=self._frame)
        self._asked, self._request = question, self._refinement.call_async(request)
        self._request.add_done_callback(functools.partial(self._take_answer, question))

    def _take_answer(self, question: Question, future: Future) -> None:
        answer = future.result()
        if answer is None or question is not self.execution.question:  # withdrawn, or late
            return
        reason = printable(answer.reason, _LONGEST_REASON)  # of any server, in feedback, records and the log
        if not answer.accepted:
            self.execution.unrefined(reason)
            return
        try:
            chain = messages.chain_from(
                answer.chain, self._library, frame=self._frame, where="refined chain", fence=self._fence
            )
        except MessageError as error:
            self.execution.unrefined(str(error))
        else:
            self.execution.refined_to(chain, answer.refined, reason, chosen=answer.chosen)

    # The end

    def result(self, world: World | None) -> Any:
        """Return the result of the goal; `world` is the last known state."""
        ending = self.execution.ending or Ending.FAILED
        if world is None:
            return unstarted(self.handle, ending, self.execution.reason, frame=self._frame)
        record = chain_record_of(self.execution, self._records, end=world, **self._named)
        return ExecuteChain.Result(outcome=record.outcome, record=record)


def _alternatives(goal: ExecuteChain.Goal, library: TopLibrary, frame: str, fence: Fence) -> list[TopChain]:
    """Read the alternatives of a goal; raises MessageError where one cannot be read."""
    read = messages.alternatives_from(goal.alternatives, library, frame=frame, fence=fence)
    for each in read:
        if isinstance(each, str):
            raise MessageError(each)
    return [each for each in read if not isinstance(each, str)]


def id_of(handle: ServerGoalHandle) -> str:
    """Return the goal's UUID as 32 hexadecimal digits."""
    return bytes(handle.goal_id.uuid).hex()


def unstarted(handle: ServerGoalHandle, ending: Ending, reason: str, *, frame: str) -> Any:
    """Return the result of a goal that cannot be used, or that ended before it began."""
    outcome = outcome_of(ending, reason)
    record = ChainPerformance(
        chain_id=id_of(handle),
        chain=messages.echo_of(handle.request.chain),
        refinement="not requested",
        predicted=messages.performance_of(),
        actual=actual(0.0, ending),
        outcome=outcome,
    )
    record.header.frame_id = frame
    return ExecuteChain.Result(outcome=outcome, record=record)


def concluded(ending: Ending, result: Any, handle: ServerGoalHandle) -> Any:
    """Put a goal into its final state and return its result: the callback that executes an action."""
    if ending is Ending.SUCCEEDED:
        handle.succeed()
    elif ending is Ending.CANCELED:
        handle.canceled()
    else:
        handle.abort()
    return result


def run_of(
    handle: ServerGoalHandle,
    libraries: Mapping[str, TopLibrary],
    predictors: Mapping[str, Predictor],
    refinement: Client,
    settings: Mapping[str, Any],
    fence: Fence,
    rolling: Rolling,
) -> GoalRun:
    """Return the run of a goal with the executor's parameters; raises MessageError as `GoalRun` does."""
    action_set = messages.action_set_from(handle.request.chain, allowed=libraries)
    return GoalRun(
        handle,
        libraries[action_set],
        predictors[action_set],
        refinement,
        deadlines=deadlines_of(settings),
        refine_again_after=settings["refine_again_after"],
        fence=fence,
        rolling=rolling,
        frame=settings["frame"],
    )
