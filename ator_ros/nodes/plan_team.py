"""The node `plan_team`: divides the steps of a round among robots, and lets them drive."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace

from ator_interfaces.action import ExecuteChain, PlanTeam
from ator_interfaces.msg import Outcome, TeamChain, TopCall, TopChain
from ator_interfaces.srv import PredictDurations, RefineSubgoal
from ator_ros.actions.goal_variables import ORDER
from ator_ros.geometry import FloatArray
from ator_ros.nodes.chain_client import ChainClient
from ator_ros.nodes.main_loop import run_node, spin_out
from ator_ros.nodes.messages import performance_of
from ator_ros.nodes.parameters import Parameter, declare_parameters
from ator_ros.nodes.qos import ACTION_QUEUES, SERVICES
from ator_ros.nodes.waiting import Waiting
from ator_ros.printable import listed, one_line, printable, quoted
from ator_ros.refinement.refiner import LONGEST_CHAIN
from ator_ros.team.division import Division, DivisionError, Steps, divide
from ator_ros.tops.chain import InvalidChainError
from ator_ros.tops.ordering import Ordering, ordering_of_calls
from ator_ros.world.readers import MessageError, count

_DISCOVERY = 3.0  # real s until a robot's nodes count as missing; DDS may still be connecting them
# real s in which a refused request is repeated: a node receives the frames of tf shortly after it
# first needs them
_RETRY_TIME = 1.5
_RETRY_PAUSE = 0.3  # real s before each repetition
_MOST_ROBOTS = 16
_FEEDBACK_PERIOD = 0.5  # real s
_STOP_TIMEOUT = 10.0  # real s in which a robot stops, and its goal ends
PARAMETERS = (
    Parameter(
        "answer_timeout", 20.0, "real s for an answer of a robot's refinement", low=0.1, high=3600.0
    ),
)


class _TeamError(Exception):
    """Why a round cannot be planned, or ended early; `code` is that of the outcome."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class _Robot:
    """The clients of one robot's nodes."""

    def __init__(self, node: Node, name: str) -> None:
        self.name = name
        self.predict = node.create_client(
            PredictDurations, f"{name}/predict_durations", qos_profile=SERVICES
        )
        self.refine = node.create_client(
            RefineSubgoal, f"{name}/refine_subgoal", qos_profile=SERVICES
        )
        self.chains = ChainClient(node, namespace=name)

    def missing(self, *, execute: bool) -> list[str]:
        """Return the services and actions that are not there."""
        found = [
            each.srv_name for each in (self.predict, self.refine) if not each.service_is_ready()
        ]
        if execute and not self.chains.is_ready():
            found.append(f"{self.name}/execute_chain")
        return found


class _Team:
    """A round in progress.

    Attributes
    ----------
    handle : ServerGoalHandle
        The goal of the action.
    situations : dict of str to Situation
        Where the robots are that can still drive, by name.
    left : list of int
        Indices of the steps that are not done.
    done_by : dict of int to str
        The robot that has done each step.
    chains : list of TeamChain
        The chains of all divisions.
    """

    def __init__(self, handle: ServerGoalHandle) -> None:
        self.handle = handle
        self.situations = {each.name: each.situation for each in handle.request.robots}
        self.left = list(range(len(handle.request.round.calls)))
        self.done_by: dict[int, str] = {}
        self.chains: list[TeamChain] = []
        self._remaining: dict[str, float] = {}

    def take_feedback(self, part: TeamChain, feedback: Any) -> None:
        """Take the feedback of a robot's chain: its steps before the present one are done."""
        self._remaining[part.robot] = feedback.predicted_remaining
        position = list(feedback.order).index(feedback.step) if feedback.order else 0
        done = (part.order[index] for index in feedback.order[:position])
        self.done_by |= dict.fromkeys(done, part.robot)

    def publish_feedback(self, running: Sequence[TeamChain]) -> None:
        """Publish what is done, and the time that the last robot needs."""
        names = [part.robot for part in running]
        is_known = set(names) <= self._remaining.keys()
        self.handle.publish_feedback(
            PlanTeam.Feedback(
                done=sorted(self.done_by),
                remaining=max(map(self._remaining.__getitem__, names)) if is_known else math.nan,
                status=one_line(f"steps done: {len(self.done_by)}; on its way: {listed(names)}"),
            )
        )

    def take_steps(self, part: TeamChain, result: Any) -> None:
        """Take the steps that are done of a robot's chain that has ended."""
        reached = [each for each in result.record.actions if each.outcome.code == Outcome.SUCCEEDED]
        self.done_by |= dict.fromkeys((part.order[each.step] for each in reached), part.robot)
        self.left = [index for index in self.left if index not in self.done_by]

    def take_result(self, part: TeamChain, result: Any, *, failed: bool) -> None:
        """Take the result of a robot's chain; one that `failed` gets no further steps."""
        self.take_steps(part, result)
        part.outcome = result.outcome
        if result.record.chain_id:  # empty if the executor is gone
            part.actual = result.record.actual
        self._remaining.pop(part.robot, None)
        if result.record.actions:
            self.situations[part.robot] = result.record.actions[-1].end
        if failed:
            del self.situations[part.robot]

    def summary(self) -> str:
        """Return in a line how long the robots need, and how many steps each has."""
        steps: Counter[str] = Counter()
        predicted = dict.fromkeys((part.robot for part in self.chains), 0.0)
        driven = dict.fromkeys((part.robot for part in self.chains), 0.0)
        for part in self.chains:
            steps[part.robot] += len(part.order)
            predicted[part.robot] += part.predicted.duration
            if math.isfinite(part.actual.duration):
                driven[part.robot] += part.actual.duration
        divided = listed([f"{robot} {number}" for robot, number in steps.items()])
        last = max(predicted.values())
        text = f"{last:.2f} s predicted until the last robot is done; steps of {divided}"
        if self.handle.request.execute:
            text = f"{max(driven.values()):.2f} s driven by the last robot, {text}"
        return text


class PlanTeamNode(Node):
    """Divides the steps of a round among robots, and lets them drive.

    Each robot's own nodes predict how long it takes from step to step, and refine its chain.

    Action servers
        plan_team (ator_interfaces/PlanTeam): one goal at a time; a newer one preempts it. If a
        robot fails, the others stop, and the steps that are left are divided among them.
    Calls, in the namespace of each robot
        predict_durations (ator_interfaces/PredictDurations), refine_subgoal
        (ator_interfaces/RefineSubgoal), execute_chain (ator_interfaces/ExecuteChain).
    """

    def __init__(self) -> None:
        super().__init__("plan_team", automatically_declare_parameters_from_overrides=True)
        self._settings = declare_parameters(self, PARAMETERS)
        self._robots: dict[str, _Robot] = {}
        self._newest: ServerGoalHandle | None = None
        self._shutting_down = False
        self._waiting = Waiting(self)
        self._server = ActionServer(
            self,
            PlanTeam,
            "plan_team",
            self._execute,
            goal_callback=self._response,
            handle_accepted_callback=self._take_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            **ACTION_QUEUES,
        )
        self.get_logger().info("ready for rounds of several robots")

    def _response(self, _: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._shutting_down else GoalResponse.ACCEPT

    def _take_goal(self, handle: ServerGoalHandle) -> None:
        self._newest = handle
        handle.execute()

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        request = handle.request
        team = _Team(handle)
        try:
            self._check(request)
            planned = await self._plan(team)
            if request.execute:
                await self._drive(team, planned)
            outcome = Outcome(code=Outcome.SUCCEEDED, reason=one_line(team.summary()))
        except _TeamError as error:
            outcome = Outcome(code=error.code, reason=one_line(error))
        except (MessageError, InvalidChainError) as error:
            outcome = Outcome(code=Outcome.REFUSED, reason=one_line(error))
        self.get_logger().info(one_line(f"round ended: {outcome.reason}"))
        if outcome.code == Outcome.SUCCEEDED:
            handle.succeed()
        elif outcome.code == Outcome.CANCELED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return PlanTeam.Result(outcome=outcome, chains=team.chains)

    def _check(self, request: Any) -> None:
        """Raise MessageError or InvalidChainError if the goal cannot be used."""
        count(request.robots, "robots", least=1, most=_MOST_ROBOTS)
        count(request.round.calls, "round.calls", least=1, most=LONGEST_CHAIN)
        names = [robot.name for robot in request.robots]
        for number, name in enumerate(names):
            why = _fault_of_name(name)
            if why or names.index(name) != number:
                raise MessageError(
                    f"robots[{number}].name: expected {why or 'another name than before'}, "
                    f"got {quoted(name)}"
                )
        for number, call in enumerate(request.round.calls):
            if call.passing:  # the last step of a robot stops, and the division decides which it is
                raise MessageError(
                    f"round.calls[{number}].passing: expected false, got true; open stop"
                )
        _ordering(request.round.calls)

    # Planning

    async def _plan(self, team: _Team) -> list[TeamChain]:
        """Divide the steps that are left; return the chains of the robots that get any."""
        for name in team.situations:
            if name not in self._robots:
                self._robots[name] = _Robot(self, name)
        robots = [self._robots[name] for name in team.situations]
        await self._wait_for_nodes(robots, team)
        calls = _restricted(team.handle.request.round.calls, team.left)
        tables, refusals = await self._tables(robots, calls, team)
        for position, index in enumerate(team.left):
            needed = team.handle.request.round.calls[index].after
            carriers = {team.done_by[other] for other in needed if other in team.done_by}
            for robot, table in zip(robots, tables, strict=True):
                if carriers - {robot.name}:  # it continues what another robot has begun
                    table[:, position] = np.nan
        steps = Steps.of(_ordering(calls))
        try:
            division = divide(tables, steps, total=team.handle.request.total)
        except DivisionError as error:
            raise MessageError("; ".join((str(error), *refusals))) from error
        planned = await self._refined(robots, division, team)
        team.chains += planned
        return planned

    async def _wait_for_nodes(self, robots: Sequence[_Robot], team: _Team) -> None:
        """Wait until the nodes of all robots are there."""

        def missing() -> list[str]:
            execute = team.handle.request.execute
            return [name for robot in robots for name in robot.missing(execute=execute)]

        await self._until(lambda: not missing(), _DISCOVERY, team)
        if found := missing():
            raise _TeamError(
                Outcome.INPUT_LOST, f"expected {listed(found)}, got none; start the robot's nodes"
            )

    async def _tables(
        self, robots: Sequence[_Robot], calls: list[TopCall], team: _Team
    ) -> tuple[list[FloatArray], list[str]]:
        """Return each robot's times from call to call, and why robots refuse calls."""
        able = {robot: list(range(len(calls))) for robot in robots}
        answers = await self._predicted(able, calls, team)
        refusals = []
        for robot, answer in list(answers.items()):
            if answer.accepted:
                continue
            refusals.append(f"{robot.name}: {printable(answer.reason)}")
            able[robot] = []
            for top in dict.fromkeys(call.top for call in calls):
                own = [index for index, call in enumerate(calls) if call.top == top]
                if (await self._predicted({robot: own}, calls, team))[robot].accepted:
                    able[robot] += own
            if able[robot]:
                answers |= await self._predicted({robot: able[robot]}, calls, team)
        tables = []
        for robot in robots:
            table = np.full((len(calls) + 1, len(calls)), np.nan)
            if answers[robot].accepted:
                rows = [0, *(each + 1 for each in able[robot])]
                durations = np.reshape(answers[robot].durations, (len(rows), -1))
                table[np.ix_(rows, able[robot])] = durations
            tables.append(table)
        return tables, refusals

    async def _predicted(
        self,
        wanted: Mapping[_Robot, Sequence[int]],
        calls: Sequence[TopCall],
        team: _Team,
    ) -> dict[_Robot, Any]:
        """Return each robot's predicted durations of its calls."""
        requests = {
            robot: PredictDurations.Request(
                situations=[team.situations[robot.name]],
                calls=_restricted(calls, own),
                pairs=True,
                action_set=team.handle.request.round.action_set,
            )
            for robot, own in wanted.items()
        }
        clients = {robot: robot.predict for robot in wanted}
        end = time.monotonic() + _RETRY_TIME
        answers = await self._answers(clients, requests, team)
        while time.monotonic() < end:
            refused = {robot for robot in wanted if not answers[robot].accepted}
            if not refused:
                break
            await self._until(lambda: False, _RETRY_PAUSE, team)
            answers |= await self._answers(
                {robot: clients[robot] for robot in refused}, requests, team
            )
        return answers

    async def _refined(
        self, robots: Sequence[_Robot], division: Division, team: _Team
    ) -> list[TeamChain]:
        """Return the chains of a division with the headings and orders that refinement finds."""
        goal = team.handle.request
        steps = {
            robot: [team.left[place] for place in order]
            for robot, order in zip(robots, division.orders, strict=True)
            if order
        }
        requests = {
            robot: RefineSubgoal.Request(
                situation=team.situations[robot.name],
                chain=TopChain(
                    calls=_restricted(goal.round.calls, own), action_set=goal.round.action_set
                ),
                objective=goal.objective,
            )
            for robot, own in steps.items()
        }
        answers = await self._answers({robot: robot.refine for robot in steps}, requests, team)
        planned = []
        for robot, answer in answers.items():
            if not answer.accepted:
                raise MessageError(f"{robot.name}: {printable(answer.reason)}")
            planned.append(
                TeamChain(
                    robot=robot.name,
                    chain=answer.chain,
                    order=[steps[robot][index] for index in answer.order],
                    predicted=answer.after if answer.refined else answer.before,
                    actual=performance_of(),
                )
            )
        return planned

    async def _answers(
        self, clients: Mapping[_Robot, Any], requests: Mapping[_Robot, Any], team: _Team
    ) -> dict[_Robot, Any]:
        """Return the answers of services of several robots."""
        timeout = self._settings["answer_timeout"]
        futures = {robot: client.call_async(requests[robot]) for robot, client in clients.items()}
        try:
            await self._until(lambda: all(each.done() for each in futures.values()), timeout, team)
        finally:
            for robot, future in futures.items():
                if not future.done():
                    clients[robot].remove_pending_request(future)
        for robot, future in futures.items():
            if not future.done():
                raise _TeamError(
                    Outcome.INPUT_LOST,
                    f"{clients[robot].srv_name}: expected an answer within {timeout:g} s, got none",
                )
        return {robot: future.result() for robot, future in futures.items()}

    async def _until(self, condition: Callable[[], object], timeout: float, team: _Team) -> bool:
        """Wait for a condition; raise _TeamError if the goal ends meanwhile."""
        found = await self._waiting.until(
            lambda: bool(condition()) or self._interruption(team) is not None, timeout
        )
        if (why := self._interruption(team)) is not None:
            raise why
        return found

    def _interruption(self, team: _Team) -> _TeamError | None:
        """Return why a goal ends before its steps are done."""
        if self._shutting_down:
            return _TeamError(Outcome.SHUTDOWN, "the node plan_team was ended")
        if team.handle.is_cancel_requested:
            return _TeamError(Outcome.CANCELED, "canceled by the client")
        if team.handle is not self._newest:
            return _TeamError(Outcome.PREEMPTED, "a newer goal took over")
        return None

    # Driving

    async def _drive(self, team: _Team, planned: Sequence[TeamChain]) -> None:
        """Execute chains; what robots that fail have left is divided again among the others."""
        while team.left:
            await self._execute_chains(team, planned)
            if team.left and not team.situations:
                last = planned[-1]
                raise _TeamError(last.outcome.code, f"{last.robot}: {last.outcome.reason}")
            if team.left:
                planned = await self._plan(team)

    async def _execute_chains(self, team: _Team, planned: Sequence[TeamChain]) -> None:
        """Execute the chains of all robots, until they are done or one of them fails."""
        sent = {}
        for part in planned:
            report = partial(team.take_feedback, part)
            goal = ExecuteChain.Goal(chain=part.chain)
            sent[part.robot] = self._robots[part.robot].chains.send(goal, report)
        results = {name: chain.result for name, chain in sent.items()}

        def failed() -> set[str]:
            ended = {name: each.result().outcome for name, each in results.items() if each.done()}
            return {name for name, each in ended.items() if each.code != Outcome.SUCCEEDED}

        def all_ended() -> bool:
            return all(each.done() for each in results.values())

        interruption = None
        try:
            while not await self._until(lambda: failed() or all_ended(), _FEEDBACK_PERIOD, team):
                for part in planned:
                    if results[part.robot].done():
                        team.take_steps(part, results[part.robot].result())
                team.publish_feedback([part for part in planned if not results[part.robot].done()])
        except _TeamError as error:
            interruption = error
        faulty = failed()
        for chain in sent.values():
            chain.cancel()
        await self._waiting.until(all_ended, _STOP_TIMEOUT)
        for part in planned:
            sent[part.robot].abandon(Outcome.INPUT_LOST, "expected the end of its chain, got none")
            code = results[part.robot].result().outcome.code
            has_failed = part.robot in faulty or code not in (Outcome.SUCCEEDED, Outcome.CANCELED)
            team.take_result(part, results[part.robot].result(), failed=has_failed)
        if interruption is not None:
            raise interruption

    def stop(self) -> None:
        """Cancel all chains, before the node ends."""
        self._shutting_down = True
        for robot in self._robots.values():
            robot.chains.abandon(Outcome.SHUTDOWN, "the node plan_team was ended")
        spin_out(self)


def _fault_of_name(name: str) -> str:
    """Return what was expected of a robot's name; empty if it is a namespace."""
    try:
        validate_namespace(f"/{name}")
    except InvalidNamespaceException:
        return "a namespace, such as robot_1"
    return ""


def _ordering(calls: Sequence[TopCall]) -> Ordering:
    """Return what calls say about their order; raises InvalidChainError."""
    return ordering_of_calls(
        [call.top for call in calls],
        [ORDER in call.open for call in calls],
        [call.after for call in calls],
    )


def _restricted(calls: Sequence[TopCall], kept: Sequence[int]) -> list[TopCall]:
    """Return some calls of a chain, whose precedences name their places among these."""
    places = {index: place for place, index in enumerate(kept)}
    found = []
    for index in kept:
        call = copy(calls[index])
        call.after = [places[other] for other in calls[index].after if other in places]
        found.append(call)
    return found


main = partial(run_node, PlanTeamNode, PARAMETERS)
