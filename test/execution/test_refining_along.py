"""What remains of a goal is refined again along the way, other plans included, while the robot drives on."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest

from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.fence import Fence
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.refining import Question, ReplanTrigger, continuations, with_followed
from ator_ros.execution.supervisor import Deadlines, Supervisor
from ator_ros.geometry import FloatArray, Pose
from ator_ros.refinement.chain_prediction import ChainPrediction
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import CONTROL_PERIOD, STOP, Command, ObjectState, RobotState, World

ROBOT = load_robot()
LIBRARY = SOCCER.library(ROBOT)
GOAL = (4.0, 0.0)


def call(top: str, x: float, y: float, yaw: float = 0.0, *opened: str) -> TopCall:
    return TopCall(LIBRARY[top], Goal(Pose(x, y, yaw), 0.0, LIBRARY[top].point), frozenset(opened))


FETCH = call("goToBall", 2.0, 0.0, 0.0, "yaw", "speed")
SHOOT = call("shoot", *GOAL)
ROUND = call("goToPose", 1.2, 0.6, 0.0, "yaw", "speed")
DRIBBLE = call("dribbleBall", 2.6, 0.5, 0.0, "x", "y", "yaw", "speed")
HERE, ANYWHERE = TopChain((FETCH, SHOOT)), TopChain((FETCH, DRIBBLE, SHOOT))
AROUND = TopChain((ROUND, FETCH, SHOOT))


class CountsSteps(Predictor):
    """Predicts a second for each step."""

    def __init__(self) -> None:
        super().__init__(ROBOT, {})

    def chain(self, world: World, chain: TopChain) -> ChainPrediction:
        return ChainPrediction(tuple({"duration": 1.0} for _ in chain.calls), float(len(chain)))


class Drive:
    """An execution in the simulation, for which the test answers in refinement's place."""

    def __init__(self, simulation: Simulation, *plans: TopChain) -> None:
        self.simulation, self.commands = simulation, list[Command]()
        simulation.place_robot(Pose(-1.5, -1.0, 0.5))
        simulation.place_object(BALL, 2.0, 0.0)
        self.run = Supervisor(
            LIBRARY,
            plans[0],
            refine=True,
            again_after=0.15,
            now=0.0,
            predictor=CountsSteps(),
            deadlines=Deadlines(),
            fence=Fence.around(ROBOT),
            alternatives=plans[1:],
        )
        self.tick()
        self.run.refined_to(plans[0], False, "the first answer")

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            command = self.run.tick(self.simulation.world(), self.simulation.time)
            assert command is not None
            self.commands.append(command)
            self.simulation.command(command)
            self.simulation.tick()

    def asked(self) -> Question:
        """Let the ball be moved on the way, and give the question that this raises."""
        self.tick(30)
        assert self.run.question is None
        self.simulation.place_object(BALL, 2.0, 0.4)
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


def assert_smooth(commands: list[Command]) -> None:
    """Make sure that commands change in a tick by hardly more than the base can.

    A new plan begins with what makes up for the motors' lag: up to half as much again in turning.
    """
    limits = ROBOT.limits
    for one, other in itertools.pairwise(commands):
        change = other.v - one.v
        most = (limits.a if abs(other.v) > abs(one.v) else limits.brake) * CONTROL_PERIOD
        assert abs(change) <= 1.1 * most + 1e-6, f"{one} to {other}"
        assert abs(other.w - one.w) <= 1.5 * limits.aw * CONTROL_PERIOD + 1e-6, f"{one} to {other}"


def test_a_question_on_the_way_offers_the_other_plans_with_their_goals_at_the_ball(
    simulation: Simulation,
) -> None:
    question = Drive(simulation, HERE, ANYWHERE, TopChain((SHOOT,))).asked()
    (other,) = question.others  # the last is no valid plan from here
    assert other.number == 1
    assert other.chain.calls[0].goal.pose == Pose(2.0, 0.4, 0.0)
    assert other.chain.calls[1:] == ANYWHERE.calls[1:]
    assert question.cause == "the ball comes to rest 0.40 m from the forecast"


def test_another_plan_is_taken_up_without_a_stop_and_carried_out(simulation: Simulation) -> None:
    drive = Drive(simulation, ANYWHERE, HERE, AROUND)
    question = drive.asked()
    assert [other.number for other in question.others] == [1, 2]
    drive.run.refined_to(question.others[1].chain, False, "3 s faster", chosen=2)
    drive.tick(20)
    assert [c.top.name for c in drive.run.executor.chain.calls] == ["goToPose", "goToBall", "shoot"]
    assert drive.run.executor.chain.calls[1].goal.pose == Pose(2.0, 0.4, 0.0)
    assert STOP not in drive.commands[3:]
    assert_smooth(drive.commands[3:])
    assert drive.run.predicted_remaining(drive.simulation.time) == pytest.approx(2.0 + 0.0, abs=0.1)
    assert drive.run.refining.again == 1
    told = "as the ball comes to rest 0.40 m from the forecast: alternative 2 is chosen: 3 s faster"
    assert told in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED, drive.run.reason
    assert [r.top for r in drive.run.executor.records if r.ending is Ending.SUCCEEDED] == [
        "goToPose",
        "goToBall",
        "shoot",
    ]


def test_a_plan_with_more_steps_is_predicted_to_its_end(simulation: Simulation) -> None:
    drive = Drive(simulation, HERE, ANYWHERE)
    question = drive.asked()
    drive.run.refined_to(question.others[0].chain, False, "better", chosen=1)
    seen = set()
    while drive.run.ending is None:
        seen.add(
            (drive.run.executor.index, math.isfinite(drive.run.predicted_remaining(drive.simulation.time)))
        )
        drive.tick()
    assert drive.run.ending is Ending.SUCCEEDED, drive.run.reason
    assert seen == {(0, True), (1, True), (2, True)}


def test_a_choice_that_was_not_offered_or_changes_what_it_may_not_is_left_alone(
    simulation: Simulation,
) -> None:
    drive = Drive(simulation, HERE, ANYWHERE)
    drive.asked()
    before = drive.run.executor.chain
    drive.run.refined_to(ANYWHERE, False, "nonsense", chosen=2)
    assert "chosen: expected an index from 0 to 1, got 2" in drive.run.refining.reason
    drive.simulation.place_object(BALL, 2.0, 0.0)
    drive.tick()
    question = drive.run.question
    assert question is not None
    other = question.others[0].chain
    astray = other.with_goal(2, dataclasses.replace(other.calls[2].goal, pose=Pose(4.0, 1.0, 0.0)))
    drive.run.refined_to(astray, True, "nonsense", chosen=1)
    drive.tick()
    assert "y of step 3 (shoot): expected 0 as planned, got 1" in drive.run.refining.reason
    assert drive.run.executor.chain.calls[1:] == before.calls[1:]
    assert drive.run.refining.again == 0


def test_a_robot_that_keeps_to_its_way_raises_no_question(simulation: Simulation) -> None:
    drive = Drive(simulation, ANYWHERE)
    while drive.run.ending is None:
        drive.tick()
        assert drive.run.question is None
    assert drive.run.ending is Ending.SUCCEEDED


def test_a_robot_that_is_pushed_off_its_way_raises_one_question(simulation: Simulation) -> None:
    drive = Drive(simulation, ANYWHERE)
    drive.tick(30)
    there = simulation.world().robot
    simulation.place_robot(there.pose._replace(y=there.pose.y - 0.3), v=there.v, w=there.w)
    drive.tick(2)
    question = drive.run.question
    assert question is not None
    assert question.cause.endswith("m off its way")
    drive.run.refined_to(question.chain, False, "no better")
    drive.tick(20)
    assert drive.run.question is None
    assert "asked again after" in drive.run.refining.reason
    assert drive.to_the_end() is Ending.SUCCEEDED


def test_the_distance_from_a_way_is_that_from_its_nearest_stretch() -> None:
    way: FloatArray = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 1.57]])
    trigger, chain = ReplanTrigger(ROBOT), TopChain((ROUND,))
    trigger.set_reference(World(0.0, RobotState(Pose(0.0, 0.0, 0.0))))
    for pose, off in ((Pose(1.0, 0.2, 0.0), 0.2), (Pose(2.5, 0.5, 0.0), 0.5), (Pose(-0.3, 0.4, 0.0), 0.5)):
        said = trigger.deviation(0.1, World(0.0, RobotState(pose)), chain, 0, lambda: way)
        assert said == f"the robot is {off:.2f} m off its way"
        assert trigger.deviation(off + 0.01, World(0.0, RobotState(pose)), chain, 0, lambda: way) == ""


def test_goals_of_later_steps_follow_the_ball_until_a_step_moves_it() -> None:
    world = World(0.0, RobotState(Pose(-1.5, -1.0, 0.5)), {BALL: ObjectState(1.5, 1.0)})
    moved = with_followed(AROUND, world, ROBOT)
    assert moved.calls[1].goal.pose == Pose(1.5, 1.0, 0.0)
    assert (moved.calls[0], moved.calls[2]) == (ROUND, SHOOT)
    twice = TopChain((FETCH, DRIBBLE, call("goToBall", 2.6, 0.5)))
    assert with_followed(twice, world, ROBOT).calls[2] == twice.calls[2]


def test_what_is_done_in_common_is_not_done_again() -> None:
    hold = ROBOT.pose_holding(Pose(2.0, 0.0, 0.2))
    world = World(0.0, RobotState(hold), {BALL: ObjectState(2.0, 0.0)})
    plans = (ANYWHERE, HERE, AROUND)
    after = continuations(plans, 0, ANYWHERE, 1, world, ROBOT)
    assert [(c.number, [step.top.name for step in c.chain.calls]) for c in after] == [
        (1, ["shoot"]),
        (2, ["goToPose", "goToBall", "shoot"]),  # anew: it began otherwise
    ]
    elsewhere = TopChain((call("goToPose", -1.0, 0.0), FETCH, SHOOT))
    shared = continuations((AROUND, elsewhere), 0, AROUND, 1, world, ROBOT)
    assert [len(c.chain) for c in shared] == [3]
