"""Refinement is asked again when the ball has moved, while the robot drives on."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import pytest

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import with_values
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import Question, refined_chain
from ator_ros.execution.supervisor import Deadlines, Supervisor
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import InvalidChainError, TopCall, TopChain
from ator_ros.world.state import STOP, Command, ObjectState, RobotState, World

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
NEW_YAW = -0.6


def call(top: str, x: float, y: float) -> TopCall:
    return TopCall(LIBRARY[top], Goal(Pose(x, y, 0.0), 0.0, LIBRARY[top].point), frozenset({"yaw"}))


CHAIN = TopChain((call("goToBall", 0.0, 0.0), call("dribbleBall", 2.0, 0.5)))


class Drive:
    """An execution of CHAIN in the simulation, for which the test answers in refinement's place."""

    def __init__(
        self, simulation: Simulation, *, refine: bool, again_after: float, answer: TopChain = CHAIN
    ) -> None:
        self.simulation = simulation
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        simulation.place_object(BALL, 0.0, 0.0)
        self.run = Supervisor(
            LIBRARY,
            CHAIN,
            refine=refine,
            again_after=again_after,
            now=0.0,
            predictor=Predictor(ROBOT, {}),
            deadlines=Deadlines(),
            fence=Fence.around(ROBOT),
        )
        self.commands: list[Command] = []
        self.tick()
        if refine:
            self.run.refined_to(answer, False, "the first answer")

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            command = self.run.tick(self.simulation.world(), self.simulation.time)
            self.run.watch(self.simulation.time)
            self.commands.append(command)
            self.simulation.command(command)
            self.simulation.tick()

    def to_the_end(self) -> Ending | None:
        while self.run.ending is None:
            self.tick()
        return self.run.ending


def start(**options: object) -> Iterator[Drive]:
    with Simulation(ROBOT) as simulation:
        yield Drive(simulation, **{"refine": True, "again_after": 0.15, **options})  # type: ignore[arg-type]


@pytest.fixture
def drive() -> Iterator[Drive]:
    yield from start()


def with_yaw(chain: TopChain, yaw: float) -> TopChain:
    goal = chain.calls[0].goal
    return chain.with_goal(0, dataclasses.replace(goal, pose=goal.pose._replace(yaw=yaw)))


def asked(drive: Drive) -> Question:
    """Drive, move the ball aside, and give the question that this raises."""
    drive.tick(20)
    assert drive.run.question is None
    drive.simulation.place_object(BALL, 0.3, 0.4)
    drive.tick()
    assert drive.run.question is not None
    return drive.run.question


def test_the_question_is_about_the_robot_in_motion_and_the_ball_where_it_is(drive: Drive) -> None:
    question = asked(drive)
    assert question.world.robot.v > 0.3
    assert question.step == 0
    assert question.chain.calls[0].goal.pose == Pose(0.3, 0.4, 0.0)
    assert question.chain.calls[1] == CHAIN.calls[1]


def test_the_answer_changes_the_goal_without_a_stop(drive: Drive) -> None:
    question = asked(drive)
    drive.tick(4)
    drive.run.refined_to(with_yaw(question.chain, NEW_YAW), True, "0.5 s faster")
    drive.tick(10)
    assert STOP not in drive.commands[5:]
    assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.4, NEW_YAW)
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert (drive.run.refining.refined, drive.run.refining.again) == (True, 1)
    assert drive.run.refining.reason == (
        "the first answer; refined again after 1.20 s, as the ball comes to rest 0.50 m from the forecast: "
        "0.5 s faster"
    )
    outcomes = [(record.index, record.ending) for record in drive.run.executor.records]
    moved, answered = (0, Ending.PREEMPTED), (0, Ending.PREEMPTED)
    assert outcomes == [moved, answered, (0, Ending.SUCCEEDED), (1, Ending.SUCCEEDED)]


def test_a_ball_that_moves_on_after_the_question_keeps_its_place(drive: Drive) -> None:
    question = asked(drive)
    drive.simulation.place_object(BALL, 0.3, 0.6)
    drive.tick()
    drive.run.refined_to(with_yaw(question.chain, NEW_YAW), True, "0.5 s faster")
    drive.tick()
    assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.6, NEW_YAW)


def test_without_an_answer_it_goes_on(drive: Drive) -> None:
    asked(drive)
    drive.tick(12)
    assert drive.run.question is None
    assert "asked again after" in drive.run.refining.reason
    assert "m from the forecast: no answer within 0.5 s" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert drive.run.refining.again == 0


def test_an_answer_with_other_steps_is_left_alone(drive: Drive) -> None:
    asked(drive)
    drive.run.refined_to(TopChain(CHAIN.calls[1:]), True, "nonsense")
    drive.tick()
    assert "expected the steps of the question" in drive.run.refining.reason
    assert drive.run.ending is None


@pytest.mark.parametrize(
    ("step", "change", "told"),
    [
        (0, {"x": -2.0}, "x of step 1 (goToBall): expected 0.3 as planned, got -2"),
        (1, {"yaw": math.nan}, "yaw of step 2 (dribbleBall): expected a number from"),
        (1, {"speed": 0.4}, "speed of step 2 (dribbleBall): expected 0 as planned, got 0.4"),
    ],
)
def test_an_answer_that_changes_what_it_may_not_is_left_alone_on_the_way(
    drive: Drive, step: int, change: dict[str, float], told: str
) -> None:
    question = asked(drive)
    goal = with_values(question.chain.calls[step].goal, change)
    drive.run.refined_to(with_yaw(question.chain, NEW_YAW).with_goal(step, goal), True, "nonsense")
    drive.tick()
    assert drive.run.executor.chain == question.chain
    assert f"m from the forecast: the answer cannot be used: {told}" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED
    assert drive.run.refining.again == 0


def test_a_long_refusal_on_the_way_is_told_in_short(drive: Drive) -> None:
    asked(drive)
    drive.run.unrefined("no valid plan: " + 50 * "it is too far; ")
    assert "m from the forecast: no valid plan: it is too far; " in drive.run.refining.reason
    assert len(drive.run.refining.reason) < 250


def test_of_an_answer_that_is_no_plan_one_reason_is_told(drive: Drive) -> None:
    question = asked(drive)
    plan = TopChain(question.chain.calls[1:])  # dribbles where no ball is
    asked_so = dataclasses.replace(question, chain=plan, step=1)
    with pytest.raises(InvalidChainError, match=r"^no valid plan: pre-condition of step 1 [^;]* more\)$"):
        refined_chain(CHAIN, asked_so, plan, question.world, LIBRARY)


def test_the_first_answer_is_looked_at_too() -> None:
    with Simulation(ROBOT) as simulation:
        drive = Drive(simulation, refine=True, again_after=0.15, answer=TopChain(CHAIN.calls[:1]))
        assert drive.run.executor.chain is CHAIN
        told = "the answer cannot be used: expected the steps of the question"
        assert drive.run.refining.reason == f"executed as sent, refinement failed: {told}"
        assert not drive.run.refining.refined


def test_a_question_on_the_way_is_a_valid_plan_also_while_the_ball_rolls(drive: Drive) -> None:
    drive.tick(20)
    drive.simulation.place_object(BALL, 0.3, 0.4, vx=0.5)
    drive.tick()
    question = drive.run.question
    assert question is not None
    assert ball_of(question.world) is not None
    assert ball_of(question.world).x > 0.4
    assert question.chain.violations(question.world, ROBOT) == []


def test_a_small_move_raises_no_question(drive: Drive) -> None:
    drive.tick(20)
    drive.simulation.place_object(BALL, 0.0, 0.14)
    drive.tick()
    assert drive.run.question is None
    drive.simulation.place_object(BALL, 0.0, 0.16)
    drive.tick()
    assert drive.run.question is not None


@pytest.mark.parametrize("options", [{"refine": False}, {"again_after": 0.0}])
def test_who_does_not_want_it_is_not_asked(options: dict[str, object]) -> None:
    for drive in start(**options):
        drive.tick(20)
        drive.simulation.place_object(BALL, 0.3, 0.4)
        drive.tick()
        assert drive.run.question is None
        assert drive.run.executor.chain.calls[0].goal.pose == Pose(0.3, 0.4, 0.0)


def test_before_an_answer_it_says_whether_one_is_awaited() -> None:
    for drive in start(refine=False):
        assert drive.run.refining.reason == "executed as sent; the goal has refine: false"


def test_a_refined_chain_must_be_valid() -> None:
    world = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), {BALL: ObjectState(0.0, 0.0)})
    question = Question(world, CHAIN, 0, 0.0)
    assert refined_chain(CHAIN, question, with_yaw(CHAIN, 1.0), world, LIBRARY) == with_yaw(CHAIN, 1.0)
    elsewhere = World(0.0, world.robot, {BALL: ObjectState(1.0, 1.0)})
    with pytest.raises(InvalidChainError, match="pre-condition of step 1"):
        refined_chain(CHAIN, question, with_yaw(CHAIN, 1.0), elsewhere, LIBRARY)
