"""The executor node's core, without ROS: inputs, phases, deadlines, reasons."""

from __future__ import annotations

import dataclasses
import math

import pytest

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.nodes.execution import Execution
from ator_ros.nodes.inputs import Inputs, TimeWentBackError
from ator_ros.nodes.phases import Deadlines, Ending, Phase
from ator_ros.nodes.predictions import Predictor
from ator_ros.nodes.refining import Refining
from ator_ros.robot import load_robot
from ator_ros.simulation.pioneer import PioneerSimulation
from ator_ros.tops.ball import needs_ball
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.tracking import BallTracker
from ator_ros.world import STOP, BallState, RobotState, World

ROBOT = load_robot()
LIBRARY = TopLibrary(ROBOT)
BOUND = frozenset({"x", "y", "yaw", "speed"})


def inputs() -> Inputs:
    return Inputs(0.3, BallTracker(0.0, 0.0))


def chain(*steps: tuple[str, Pose]) -> TopChain:
    return TopChain(
        tuple(TopCall(LIBRARY[top], Goal(pose, 0.0, LIBRARY[top].point), BOUND) for top, pose in steps)
    )


FORWARD = chain(("goToPose", Pose(1.0, 0.0, 0.0)))
FORWARD_LEFT = chain(("goToPose", Pose(1.0, 1.0, 0.0)))


def execution(plan: TopChain, *, refine: bool = False, fetches: int = 0) -> Execution:
    return Execution(
        LIBRARY,
        plan,
        refining=Refining(ROBOT, wanted=refine, again_after=0.15),
        now=100.0,
        predictor=Predictor(ROBOT, {}),
        deadlines=Deadlines(),
        fetches=fetches,
    )


def world(time: float = 1.0, *, v: float = 0.0, ball: BallState | None = None) -> World:
    return World(time, RobotState(Pose(0.0, 0.0, 0.0), v), ball)


def test_the_ball_is_that_of_the_odometrys_time_whatever_comes_first() -> None:
    both = inputs()
    both.ball(1.0, BallState(0.0, 0.0, 1.0, -2.0))
    both.ball(1.1, BallState(5.0, 5.0))
    joined = both.robot(1.05, RobotState(Pose(0.0, 0.0, 0.0)))
    assert joined is not None
    assert joined.ball is not None
    assert (joined.ball.x, joined.ball.y) == pytest.approx((0.05, -0.1))


def test_an_old_ball_is_unknown() -> None:
    both = inputs()
    both.ball(1.0, BallState(0.0, 0.0))
    joined = both.robot(1.31, RobotState(Pose(0.0, 0.0, 0.0)))
    assert joined is not None
    assert joined.ball is None


def test_a_ball_is_overdue_when_nothing_has_come_of_it_for_half_its_timeout() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    both.robot(1.0, robot)
    assert both.ball_overdue  # none has ever come
    both.ball(0.9, BallState(0.0, 0.0))  # late, as from a camera, and heard
    for time in (1.05, 1.1):
        both.robot(time, robot)
        assert not both.ball_overdue
    both.robot(1.15, robot)
    assert both.ball_overdue
    both.ball(1.15, BallState(0.0, 0.0))
    assert not both.ball_overdue


def test_time_that_stands_is_no_news_and_time_that_goes_back_an_error() -> None:
    both, robot = inputs(), RobotState(Pose(0.0, 0.0, 0.0))
    assert both.robot(1.0, robot) is not None
    assert both.robot(1.0, robot) is None
    with pytest.raises(TimeWentBackError, match=r"after 1\.00 s, got 0\.50 s"):
        both.robot(0.5, robot)
    assert both.robot(0.55, robot) is not None


def test_which_tops_need_the_ball_follows_from_their_conditions() -> None:
    assert {name for name in LIBRARY if needs_ball(LIBRARY[name])} == {"goToBall", "dribbleBall", "shoot"}


def test_an_execution_drives_at_once_and_stands_before_it_ends() -> None:
    run = execution(FORWARD)
    command = run.tick(world(), 100.0)
    assert command.v > 0.0
    assert run.phase is Phase.EXECUTING
    run.end(Ending.CANCELED, "canceled by the client")
    assert run.tick(world(1.05, v=0.5), 100.1) == STOP
    assert run.phase is Phase.STOPPING
    run.tick(world(1.1), 100.2)
    assert run.phase is Phase.ENDED
    assert run.ending is Ending.CANCELED


def test_a_robot_that_never_stands_does_not_hold_the_goal_for_ever() -> None:
    run = execution(FORWARD)
    run.end(Ending.CANCELED, "canceled by the client")
    for tick in range(60):
        run.tick(world(1.0 + 0.05 * tick, v=0.5), 100.0)
    assert run.phase is Phase.ENDED


def test_a_goal_that_is_canceled_before_any_odom_ends() -> None:
    run = execution(FORWARD)
    run.end(Ending.CANCELED, "canceled by the client")
    assert run.phase is Phase.STOPPING  # the robot may still move, as after the goal before
    run.watch(100.35)
    assert (run.phase, run.ending, run.reason) == (Phase.ENDED, Ending.CANCELED, "canceled by the client")


def test_a_goal_that_is_canceled_long_before_any_odom_ends_at_once() -> None:
    run = execution(FORWARD)
    run.watch(101.0)
    run.end(Ending.CANCELED, "canceled by the client")
    run.watch(101.0)
    assert run.phase is Phase.ENDED


def test_half_of_the_silence_is_told_so_that_the_robot_may_stand() -> None:
    run = execution(FORWARD)
    assert not run.silent(200.0)  # none has come: it has not been told to move
    run.tick(world(), 100.0)
    assert not run.silent(100.14)
    assert run.silent(100.16)
    run.tick(world(1.05), 100.2)
    assert not run.silent(100.2)


def test_a_step_that_needs_the_ball_pauses_where_it_is_overdue() -> None:
    ball = BallState(0.5, 0.0)
    run = execution(chain(("goToBall", Pose(0.5, 0.0, 0.0))))
    assert run.tick(world(ball=ball), 100.0) != STOP
    assert run.tick(world(1.05, ball=ball), 100.05, ball_overdue=True) == STOP
    assert run.ending is None
    assert run.tick(world(1.1, ball=ball), 100.1) != STOP
    alone = execution(FORWARD)
    assert alone.tick(world(), 100.0, ball_overdue=True).v > 0.0


def test_silence_ends_it_with_a_reason() -> None:
    run = execution(FORWARD)
    run.tick(world(), 100.0)
    run.watch(100.25)
    assert run.ending is None
    run.watch(100.35)
    assert run.phase is Phase.ENDED
    assert run.ending is Ending.INPUT_LOST
    assert "odom is missing" in run.reason


def test_an_invalid_chain_is_refused_without_a_command() -> None:
    run = execution(chain(("dribbleBall", Pose(1.0, 0.0, 0.0))))
    assert run.tick(world(ball=BallState(2.0, 2.0)), 100.0) == STOP
    assert run.ending is Ending.REFUSED
    assert "pre-condition of step 1 (dribbleBall) now" in run.reason


def test_a_goal_that_comes_before_odom_waits_for_it() -> None:
    run = execution(FORWARD)
    run.watch(101.9)
    assert run.phase is Phase.WAITING
    assert run.tick(world(), 101.95).v > 0.0
    run.watch(102.1)
    assert run.phase is Phase.EXECUTING


def test_a_goal_whose_odom_never_comes_ends() -> None:
    run = execution(FORWARD)
    run.watch(102.05)
    assert (run.phase, run.ending) == (Phase.ENDED, Ending.INPUT_LOST)
    assert run.reason == "odom is missing: expected one within 2 s of the goal, got none"


def test_a_goal_that_comes_before_the_ball_waits_for_it_standing() -> None:
    run = execution(chain(("goToPose", Pose(-1.0, 0.0, 0.0)), ("goToBall", Pose(1.0, 0.0, 0.0))))
    for tick in range(10):
        assert run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick) == STOP
    assert (run.phase, run.reason) == (Phase.WAITING, "waiting for a ball")
    run.tick(world(1.5, ball=BallState(1.0, 0.0)), 100.5)
    assert run.phase is Phase.EXECUTING
    assert run.start is not None
    assert run.start.time == 1.5


def test_a_goal_whose_ball_never_comes_ends() -> None:
    run = execution(chain(("goToBall", Pose(1.0, 0.0, 0.0))))
    assert run.tick(world(), 102.0) == STOP
    run.watch(102.05)
    assert run.ending is Ending.INPUT_LOST
    assert "ball is missing: goToBall needs it, expected one within 2 s" in run.reason
    assert run.tick(world(1.05), 102.1) == STOP
    assert run.phase is Phase.ENDED


def test_a_ball_that_is_silent_while_it_is_needed_ends_the_goal() -> None:
    run = execution(chain(("goToBall", Pose(1.0, 0.0, 0.0))))
    assert run.tick(world(ball=BallState(1.0, 0.0)), 100.0) != STOP
    assert run.tick(world(1.05), 100.05) == STOP
    assert run.ending is Ending.INPUT_LOST
    assert "ball is missing: goToBall needs it, and no recent one is known" in run.reason


def test_a_ball_that_is_silent_when_its_step_comes_ends_the_goal() -> None:
    run = execution(chain(("goToPose", Pose(0.0, 0.0, 0.0)), ("goToBall", Pose(1.0, 0.0, 0.0))))
    run.tick(world(ball=BallState(1.0, 0.0)), 100.0)
    for tick in range(1, 5):
        run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick)
    assert (run.ending, len(run.records)) == (Ending.INPUT_LOST, 1 + 1)


CARRY = chain(("goToBall", Pose(1.0, 0.0, 0.0)), ("dribbleBall", Pose(2.5, 0.0, 0.0)))


def carrying(*, fetches: int = 0) -> tuple[Execution, World]:
    """Give an execution of CARRY that dribbles, and the state that it is in."""
    run = execution(CARRY, fetches=fetches)
    with PioneerSimulation(ROBOT) as simulation:
        simulation.place_ball(1.0, 0.0)
        while run.top.name != "dribbleBall":
            simulation.command(run.tick(simulation.world(), 100.0))
            simulation.tick()
            assert run.ending is None
        return run, simulation.world()


def test_a_ball_that_is_lost_ends_the_goal_under_that_name() -> None:
    run, state = carrying()
    assert run.tick(dataclasses.replace(state, ball=BallState(1.0, 0.5)), 100.0) == STOP
    assert run.ending is Ending.BALL_LOST
    assert run.reason.startswith("ball lost in dribbleBall: lost the ball, it is")
    assert run.records[-1][0].lost_ball


def test_a_ball_that_is_lost_is_fetched_where_it_is() -> None:
    run, state = carrying(fetches=1)
    run.tick(dataclasses.replace(state, ball=BallState(1.0, 0.9)), 100.0)
    assert (run.ending, run.fetched, run.top.name) == (None, 1, "goToBall")
    assert run.chain.calls[0].goal.pose == Pose(1.0, 0.9, 0.0)
    assert run.tick(world(state.time + 0.1), 100.1) == STOP
    assert run.ending is Ending.INPUT_LOST
    assert "ball is missing: goToBall needs it" in run.reason


def test_refinement_is_waited_for_until_its_deadline() -> None:
    run = execution(FORWARD, refine=True)
    assert run.tick(world(), 100.0) == STOP
    assert run.phase is Phase.REFINING
    run.tick(world(1.2), 100.4)
    run.watch(100.45)
    assert run.phase is Phase.REFINING
    run.tick(world(1.4), 100.55)
    run.watch(100.55)
    assert run.tick(world(1.5), 100.6).v > 0.0
    assert run.refining.reason == "executed as sent, refinement failed: no answer within 0.5 s"
    run.refined_to(FORWARD_LEFT, True, "too late")
    assert run.chain is FORWARD


def test_a_refined_chain_is_executed_if_it_is_valid() -> None:
    run = execution(FORWARD, refine=True)
    run.tick(world(), 100.0)
    run.refined_to(FORWARD_LEFT, True, "0.5 s faster")
    run.tick(world(1.05), 100.1)
    assert (run.chain, run.refining.refined, run.refining.reason) == (FORWARD_LEFT, True, "0.5 s faster")
    other = execution(FORWARD, refine=True)
    other.tick(world(), 100.0)
    other.refined_to(chain(("shoot", Pose(4.0, 0.0, 0.0))), True, "nonsense")
    assert other.chain is FORWARD
    assert "no valid plan" in other.refining.reason
    assert not other.refining.refined


def test_open_variables_are_filled_in_also_where_nothing_is_refined() -> None:
    sent = chain(("goToBall", Pose(1.0, 0.0, 0.0)), ("dribbleBall", Pose(2.5, 0.0, 0.0)))
    filled = sent.with_goal(0, dataclasses.replace(sent.calls[0].goal, pose=Pose(1.0, 0.0, 0.7)))
    state = world(ball=BallState(1.0, 0.0))
    run = execution(sent, refine=True)
    run.tick(state, 100.0)
    run.refined_to(filled, False, "the gate is closed")
    run.tick(dataclasses.replace(state, time=1.05), 100.1)
    assert run.chain == filled
    assert (run.refining.refined, run.refining.reason) == (False, "the gate is closed")


def test_without_models_nothing_is_predicted() -> None:
    run = execution(FORWARD)
    run.tick(world(), 100.0)
    assert run.predicted is None
    assert math.isnan(run.predicted_remaining(1.0))
