"""The rest of a goal, including alternative plans, is refined again while the robot drives."""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any

import pytest
from executions import LIBRARY, ROBOT, execution

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import with_values
from ator_ros.domains.soccer.field import BALL
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import (
    Answer,
    Question,
    continuations,
    refined_chain,
    with_followed,
)
from ator_ros.execution.supervisor import Deadlines
from ator_ros.geometry import Pose
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, RobotState, World

GOAL = (4.0, 0.0)


def call(top: str, x: float, y: float, yaw: float = 0.0, *opened: str) -> TopCall:
    return TopCall(LIBRARY[top], Goal(Pose(x, y, yaw), 0.0, LIBRARY[top].point), frozenset(opened))


FETCH = call("goToBall", 2.0, 0.0, 0.0, "yaw", "speed")
SHOOT = call("shoot", *GOAL)
ROUND = call("goToPose", 1.2, 0.6, 0.0, "yaw", "speed")
DRIBBLE = call("dribbleBall", 2.6, 0.5, 0.0, "x", "y", "yaw", "speed")
HERE, ANYWHERE = TopChain((FETCH, SHOOT)), TopChain((FETCH, DRIBBLE, SHOOT))
AROUND = TopChain((ROUND, FETCH, SHOOT))
CHAIN = TopChain(
    (call("goToBall", 0.0, 0.0, 0.0, "yaw"), call("dribbleBall", 2.0, 0.5, 0.0, "yaw"))
)
NEW_YAW = -0.6
START = Pose(-1.5, -1.0, 0.5)


class CountsSteps(Predictor):
    """Predicts a second for each step."""

    def __init__(self) -> None:
        super().__init__(ROBOT, {})

    def chain(self, world: World, chain: TopChain) -> ChainPrediction:
        return ChainPrediction(tuple({"duration": 1.0} for _ in chain.calls), float(len(chain)))


class Drive:
    """An execution in the simulation, with the test in place of the refinement server."""

    def __init__(
        self,
        simulation: Simulation,
        *plans: TopChain,
        refine: bool = True,
        again_after: float = 0.15,
        start: Pose = START,
        ball: tuple[float, float] = (2.0, 0.0),
        answer: TopChain | None = None,
    ) -> None:
        self.simulation, self.commands = simulation, list[Command]()
        simulation.place_robot(start)
        simulation.place_object(BALL, *ball)
        self.run = execution(
            *plans,
            refine=refine,
            again_after=again_after,
            now=0.0,
            predictor=CountsSteps(),
            deadlines=Deadlines(refinement=0.5),
        )
        self.tick()
        if refine:
            self.run.answer(Answer(answer or plans[0], answer is not None, "the first answer"))

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            command = self.run.tick(self.simulation.world(), self.simulation.time)
            self.run.watch(self.simulation.time)
            assert command is not None
            self.commands.append(command)
            self.simulation.command(command)
            self.simulation.tick()

    def moved_ball_question(
        self, ticks: int = 30, ball: tuple[float, float] = (2.0, 0.4)
    ) -> Question:
        """Move the ball during the drive, and return the resulting refinement request."""
        self.tick(ticks)
        assert self.run.question is None
        self.simulation.place_object(BALL, *ball)
        self.tick()
        assert self.run.question is not None
        return self.run.question

    def to_the_end(self) -> Ending | None:
        while self.run.ending is None:
            self.tick()
        return self.run.ending


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation(ROBOT) as simulation:
        yield simulation


def on_chain(simulation: Simulation, **options: Any) -> Drive:
    return Drive(simulation, CHAIN, start=Pose(-2.0, 0.0, 0.0), ball=(0.0, 0.0), **options)


@pytest.fixture
def drive(simulation: Simulation) -> Drive:
    return on_chain(simulation)


def with_yaw(chain: TopChain, yaw: float) -> TopChain:
    goal = chain.calls[0].goal
    return chain.with_goal(0, dataclasses.replace(goal, pose=goal.pose._replace(yaw=yaw)))


def moved_ball_question(drive: Drive) -> Question:
    return drive.moved_ball_question(20, (0.3, 0.4))


def assert_smooth(commands: list[Command]) -> None:
    """Assert that commands change per tick by little more than the base can follow.

    A new plan starts by compensating the motor lag: up to 50 % more in turning.
    """
    limits = ROBOT.limits
    for one, other in itertools.pairwise(commands):
        change = other.vx - one.vx
        most = (limits.a if abs(other.vx) > abs(one.vx) else limits.brake) * CONTROL_PERIOD
        assert abs(change) <= 1.1 * most + 1e-6, f"{one} to {other}"
        assert abs(other.w - one.w) <= 1.5 * limits.aw * CONTROL_PERIOD + 1e-6, f"{one} to {other}"


def test_a_question_offers_the_other_plans_with_their_goals_at_the_ball(
    simulation: Simulation,
) -> None:
    question = Drive(simulation, HERE, ANYWHERE, TopChain((SHOOT,))).moved_ball_question()
    ((number, other),) = question.others  # the last plan is invalid from here
    assert number == 1
    assert other.calls[0].goal.pose == Pose(2.0, 0.4, 0.0)
    assert other.calls[1:] == ANYWHERE.calls[1:]
    assert question.cause == "the ball comes to rest 0.40 m from the forecast"


def test_another_plan_is_executed_without_a_stop(simulation: Simulation) -> None:
    drive = Drive(simulation, ANYWHERE, HERE, AROUND)
    question = drive.moved_ball_question()
    assert [number for number, _ in question.others] == [1, 2]
    drive.run.answer(Answer(question.others[1][1], False, "3 s faster", chosen=2))
    drive.tick(20)
    assert [c.top.name for c in drive.run.executor.chain.calls] == ["goToPose", "goToBall", "shoot"]
    assert drive.run.executor.chain.calls[1].goal.pose == Pose(2.0, 0.4, 0.0)
    assert STOP not in drive.commands[3:]
    assert_smooth(drive.commands[3:])
    assert drive.run.predicted_remaining(drive.simulation.time) == pytest.approx(2.0 + 0.0, abs=0.1)
    assert drive.run.refining.refined_again == 1
    reason = (
        "as the ball comes to rest 0.40 m from the forecast: alternative 2 is chosen: 3 s faster"
    )
    assert reason in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED, drive.run.reason
    assert [r.top for r in drive.run.executor.records if r.ending is Ending.SUCCEEDED] == [
        "goToPose",
        "goToBall",
        "shoot",
    ]


def test_an_invalid_choice_is_ignored(simulation: Simulation) -> None:
    drive = Drive(simulation, HERE, ANYWHERE)
    drive.moved_ball_question()
    before = drive.run.executor.chain
    drive.run.answer(Answer(ANYWHERE, False, "invalid", chosen=2))
    assert "chosen: expected an index from 0 to 1, got 2" in drive.run.refining.reason
    drive.simulation.place_object(BALL, 2.0, 0.0)
    drive.tick()
    question = drive.run.question
    _, other = question.others[0]
    changed = other.with_goal(2, dataclasses.replace(other.calls[2].goal, pose=Pose(4.0, 1.0, 0.0)))
    drive.run.answer(Answer(changed, True, "invalid", chosen=1))
    drive.tick()
    assert "y of step 3 (shoot): expected 0 as planned, got 1" in drive.run.refining.reason
    assert drive.run.executor.chain.calls[1:] == before.calls[1:]
    assert drive.run.refining.refined_again == 0


def test_a_robot_pushed_off_its_path_causes_one_question(simulation: Simulation) -> None:
    drive = Drive(simulation, ANYWHERE)
    drive.tick(30)
    there = simulation.world().robot
    simulation.place_robot(there.pose._replace(y=there.pose.y - 0.3), velocity=there.velocity)
    drive.tick(2)
    question = drive.run.question
    assert question.cause.endswith("m off its path")
    drive.run.answer(Answer(question.chain, False, "no better"))
    drive.tick(20)
    assert drive.run.question is None
    assert "asked again after" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED


def test_goals_of_later_steps_follow_the_ball_until_a_step_moves_it() -> None:
    world = World(0.0, RobotState(Pose(-1.5, -1.0, 0.5)), {BALL: ObjectState(1.5, 1.0)})
    moved = with_followed(AROUND, world, ROBOT)
    assert moved.calls[1].goal.pose == Pose(1.5, 1.0, 0.0)
    assert (moved.calls[0], moved.calls[2]) == (ROUND, SHOOT)
    twice = TopChain((FETCH, DRIBBLE, call("goToBall", 2.6, 0.5)))
    assert with_followed(twice, world, ROBOT).calls[2] == twice.calls[2]


def test_completed_steps_that_plans_share_are_not_repeated() -> None:
    hold = ROBOT.pose_holding(Pose(2.0, 0.0, 0.2))
    world = World(0.0, RobotState(hold), {BALL: ObjectState(2.0, 0.0)})
    plans = (ANYWHERE, HERE, AROUND)
    after = continuations(plans, 0, ANYWHERE, 1, world, ROBOT)
    assert [(number, [step.top.name for step in rest.calls]) for number, rest in after] == [
        (1, ["shoot"]),
        (2, ["goToPose", "goToBall", "shoot"]),  # from the start: the first step differs
    ]
    elsewhere = TopChain((call("goToPose", -1.0, 0.0), FETCH, SHOOT))
    shared = continuations((AROUND, elsewhere), 0, AROUND, 1, world, ROBOT)
    assert [len(rest) for _, rest in shared] == [3]


def test_the_question_has_the_moving_robot_and_the_current_ball(drive: Drive) -> None:
    question = moved_ball_question(drive)
    assert question.world.robot.vx > 0.3
    assert question.step == 0
    assert question.chain.calls[0].goal.pose == Pose(0.3, 0.4, 0.0)
    assert question.chain.calls[1] == CHAIN.calls[1]


def test_the_answer_changes_the_goal_without_a_stop(drive: Drive) -> None:
    question = moved_ball_question(drive)
    drive.tick(4)
    drive.run.answer(Answer(with_yaw(question.chain, NEW_YAW), True, "0.5 s faster"))
    drive.tick(10)
    assert STOP not in drive.commands[5:]
    assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.4, NEW_YAW)
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert (drive.run.refining.refined, drive.run.refining.refined_again) == (True, 1)
    assert drive.run.refining.reason == (
        "the first answer; refined again after 1.20 s, as the ball comes to rest 0.50 m from the "
        "forecast: "
        "0.5 s faster"
    )
    outcomes = [(record.index, record.ending) for record in drive.run.executor.records]
    moved, answered = (0, Ending.PREEMPTED), (0, Ending.PREEMPTED)
    assert outcomes == [moved, answered, (0, Ending.SUCCEEDED), (1, Ending.SUCCEEDED)]


def test_the_answer_applies_to_the_ball_that_moved_since(drive: Drive) -> None:
    question = moved_ball_question(drive)
    drive.simulation.place_object(BALL, 0.3, 0.6)
    drive.tick()
    drive.run.answer(Answer(with_yaw(question.chain, NEW_YAW), True, "0.5 s faster"))
    drive.tick()
    assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.6, NEW_YAW)


def test_the_goal_continues_without_an_answer(drive: Drive) -> None:
    moved_ball_question(drive)
    drive.tick(12)
    assert drive.run.question is None
    assert "asked again after" in drive.run.refining.reason
    assert "m from the forecast: no answer within 0.5 s" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert drive.run.refining.refined_again == 0


def test_an_answer_that_changes_bound_variables_is_ignored(drive: Drive) -> None:
    question = moved_ball_question(drive)
    goal = with_values(question.chain.calls[0].goal, {"x": -2.0})
    drive.run.answer(Answer(with_yaw(question.chain, NEW_YAW).with_goal(0, goal), True, "invalid"))
    drive.tick()
    assert drive.run.executor.chain == question.chain
    reason = "x of step 1 (goToBall): expected 0.3 as planned, got -2"
    assert f"m from the forecast: the answer cannot be used: {reason}" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert drive.run.refining.refined_again == 0


@pytest.mark.parametrize("options", [{"refine": False}, {"again_after": 0.0}])
def test_no_question_where_it_is_disabled(simulation: Simulation, options: dict[str, Any]) -> None:
    drive = on_chain(simulation, **options)
    drive.tick(20)
    drive.simulation.place_object(BALL, 0.3, 0.4)
    drive.tick()
    assert drive.run.question is None
    assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.4, 0.0)
    if "refine" in options:
        assert drive.run.refining.reason == "executed as sent; the goal has refine: false"


def test_a_refined_chain_must_be_valid() -> None:
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {BALL: ObjectState(0.0, 0.0)})
    question = Question(world, CHAIN, 0, 0.0)
    assert refined_chain(CHAIN, question, with_yaw(CHAIN, 1.0), world, LIBRARY) == with_yaw(
        CHAIN, 1.0
    )
    elsewhere = World(0.0, world.robot, {BALL: ObjectState(1.0, 1.0)})
    with pytest.raises(InvalidChainError, match="pre-condition of step 1"):
        refined_chain(CHAIN, question, with_yaw(CHAIN, 1.0), elsewhere, LIBRARY)


OPEN_STOPS = TopChain(
    (
        call("goToPose", -0.5, -1.0, 0.0, "yaw", "order"),
        call("goToPose", -1.0, -1.0, 0.0, "yaw", "order"),
        call("goToPose", 0.0, -1.0, 0.0, "yaw"),
    )
)


def test_the_order_of_the_first_answer_is_executed(simulation: Simulation) -> None:
    drive = Drive(simulation, OPEN_STOPS, answer=OPEN_STOPS.reordered((1, 0, 2)))
    assert drive.to_the_end() is Ending.SUCCEEDED, drive.run.reason
    assert drive.run.refining.refined
    records = drive.run.executor.records
    assert [each.chain.order[each.index] for each in records] == [1, 0, 2]
    driven = [each.end.robot.pose.x for each in records]
    assert driven == pytest.approx([-1.0, -0.5, 0.0], abs=0.1)


def test_the_order_of_a_chosen_alternative_is_that_of_its_own_calls() -> None:
    run = execution(HERE, OPEN_STOPS, refine=True, now=0.0)
    world = World(0.0, RobotState(START), {BALL: ObjectState(2.0, 0.0)})
    run.tick(world, 0.0)
    run.answer(Answer(OPEN_STOPS.reordered((1, 0, 2)), False, "3 s faster", chosen=1))
    assert run.refining.reason == "alternative 1 is chosen: 3 s faster"
    assert run.executor.chain.order == (1, 0, 2)
    assert [each.goal.pose.x for each in run.executor.chain.calls] == [-1.0, -0.5, 0.0]


def test_an_order_that_the_plan_does_not_open_is_refused() -> None:
    world = World(0.0, RobotState(START))
    question = Question(world, OPEN_STOPS, 0, 0.0)
    with pytest.raises(InvalidChainError, match=r"order: expected calls \[0, 1\] at places 1 to 2"):
        refined_chain(OPEN_STOPS, question, OPEN_STOPS.reordered((0, 2, 1)), world, LIBRARY)
    first, second, last = OPEN_STOPS.calls
    bound = TopChain((first, dataclasses.replace(second, after=(0,)), last))
    question = Question(world, bound, 0, 0.0)
    with pytest.raises(InvalidChainError, match="order: expected call 1 after call 0"):
        refined_chain(bound, question, bound.reordered((1, 0, 2)), world, LIBRARY)


def test_the_order_is_not_asked_about_again(simulation: Simulation) -> None:
    drive = Drive(simulation, OPEN_STOPS, answer=OPEN_STOPS.reordered((1, 0, 2)))
    drive.tick(10)
    drive.simulation.place_robot(Pose(-1.5, -0.5, 0.5))
    drive.tick(2)
    question = drive.run.question
    assert question is not None
    assert not any("order" in each.open or each.after for each in question.chain.calls)
