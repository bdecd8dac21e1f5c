"""The executor's core without ROS: phases, deadlines, reasons, and missing or lost balls."""

import dataclasses
import math

import pytest
from executions import FORWARD, FORWARD_LEFT, ROBOT, chain, execution, world

from ator_ros.actions.base import Goal
from ator_ros.domains.soccer.field import BALL
from ator_ros.execution import refining
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.refining import Answer
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.chain import AllowedRange, TopChain
from ator_ros.world.state import STOP, ObjectState, World


def test_an_execution_accepts_once_then_drives_and_stops_before_it_ends() -> None:
    run = execution(FORWARD)
    assert run.tick(world(), 100.0) == STOP
    assert run.tick(world(1.05), 100.05).vx > 0.0
    assert run.start.time == 1.05
    assert run.phase is Phase.EXECUTING
    run.end(Ending.CANCELED, "canceled by the client")
    assert run.tick(world(1.1, v=0.5), 100.1) == STOP
    assert run.phase is Phase.STOPPING
    run.tick(world(1.15), 100.2)
    assert run.phase is Phase.ENDED
    assert run.ending is Ending.CANCELED


def test_a_new_goal_does_not_stop_a_moving_robot() -> None:
    assert execution(FORWARD).tick(world(v=0.5), 100.0).vx > 0.0


def test_odometry_is_late_after_half_of_the_timeout() -> None:
    run = execution(FORWARD)
    assert not run.odometry_is_late(200.0)  # none has arrived, so no command was sent
    run.tick(world(), 100.0)
    assert not run.odometry_is_late(100.14)
    assert run.odometry_is_late(100.16)
    run.tick(world(1.05), 100.2)
    assert not run.odometry_is_late(100.2)


def test_missing_odometry_ends_the_goal_with_a_reason() -> None:
    run = execution(FORWARD)
    run.tick(world(), 100.0)
    run.watch(100.25)
    assert run.ending is None
    run.watch(100.35)
    assert run.phase is Phase.ENDED
    assert run.ending is Ending.INPUT_LOST
    assert "odom is missing" in run.reason


def test_a_simulation_faster_than_real_time_may_stall() -> None:
    run = execution(FORWARD)
    run.may_stall = True
    for tick in range(2):
        run.tick(world(1.0 + 0.05 * tick), 100.0)
    run.watch(101.9)
    assert run.odometry_is_late(101.9)  # it is commanded to stand
    assert run.ending is None
    run.watch(102.1)
    assert run.ending is Ending.INPUT_LOST


def test_a_goal_before_the_first_odometry_waits_for_it() -> None:
    run = execution(FORWARD)
    run.watch(101.9)
    assert run.phase is Phase.WAITING
    run.tick(world(), 101.95)
    assert run.tick(world(1.05), 102.0).vx > 0.0
    run.watch(102.1)
    assert run.phase is Phase.EXECUTING


def test_the_goal_waits_for_refinement_until_its_deadline() -> None:
    run = execution(FORWARD, refine=True)
    assert run.tick(world(), 100.0) == STOP
    assert run.phase is Phase.REFINING
    run.tick(world(1.2), 104.9)
    run.watch(104.95)
    assert run.phase is Phase.REFINING
    run.tick(world(1.4), 105.05)
    run.watch(105.05)
    assert run.tick(world(1.5), 105.1).vx > 0.0
    assert run.refining.reason.startswith(
        "executed as sent, refinement failed: no answer within 5 s"
    )
    run.answer(Answer(FORWARD_LEFT, True, "too late"))
    assert run.executor.chain is FORWARD


def test_without_an_answer_open_values_are_naive() -> None:
    sent = chain(("goToPose", Pose(1.0, 1.0, 3.0)), opened=frozenset({"yaw"}))
    run = execution(sent, refine=True)
    run.tick(world(), 100.0)
    run.answer(Answer(None, False, "no models"))
    assert run.executor.chain.calls[0].goal.pose.yaw == pytest.approx(math.pi / 4)
    assert run.refining.reason == "executed with naive values, refinement failed: no models"
    assert not run.refining.refined


def test_without_an_answer_a_heading_is_the_nearest_allowed_one() -> None:
    sent = chain(("goToPose", Pose(1.0, 1.0, 3.0)), opened=frozenset({"yaw"}))
    limited = dataclasses.replace(sent.calls[0], allowed=(AllowedRange("yaw", 1.0, 2.0),))
    run = execution(TopChain((limited,)), refine=True)
    run.tick(world(), 100.0)
    run.answer(Answer(None, False, "no models"))
    assert run.executor.chain.calls[0].goal.pose.yaw == pytest.approx(1.0)
    outside = dataclasses.replace(limited, goal=Goal(Pose(1.0, 1.0, 0.9)))
    other = execution(TopChain((limited,)), refine=True)
    other.tick(world(), 100.0)
    other.answer(Answer(TopChain((outside,)), True, "invalid"))
    assert "expected a number in 1 to 2, got 0.9" in other.refining.reason


def test_a_plan_whose_object_is_missing_is_skipped_and_waits_if_there_is_no_other() -> None:
    fetch = chain(("goToBall", Pose(1.0, 0.0, 0.0)))
    run = execution(fetch, FORWARD)
    run.tick(world(), 100.0)
    assert (run.phase, run.executor.chain) == (Phase.EXECUTING, FORWARD)
    # the ball cannot be held: the second plan is invalid
    run = execution(chain(("dribbleBall", Pose(1.0, 0.0, 0.0))), fetch)
    run.tick(world(), 100.0)
    assert (run.phase, run.reason) == (Phase.WAITING, "waiting for the ball")
    run.tick(world(1.05, ball=ObjectState(1.0, 0.0)), 100.05)
    assert run.phase is Phase.EXECUTING
    assert run.executor.chain is fetch


def test_a_goal_without_a_startable_plan_names_the_missing_object() -> None:
    run = execution(
        chain(("shoot", Pose(-1.0, 0.0, 0.0))), chain(("goToBall", Pose(1.0, 0.0, 0.0)))
    )
    run.tick(world(), 100.0)
    run.watch(102.1)
    assert run.ending is Ending.INPUT_LOST
    assert run.reason.startswith("ball is missing: ")


def test_a_refined_chain_is_executed_if_it_is_valid() -> None:
    forward, forward_left = (
        chain(("goToPose", Pose(1.0, y, 0.0)), opened=frozenset({"y"})) for y in (0.0, 1.0)
    )
    run = execution(forward, refine=True)
    run.tick(world(), 100.0)
    assert run.reason == "waiting for refinement"
    run.answer(Answer(forward_left, True, "0.5 s faster"))
    assert run.reason == "executing"
    run.tick(world(1.05), 100.1)
    assert (run.executor.chain, run.refining.refined, run.refining.reason) == (
        forward_left,
        True,
        "0.5 s faster",
    )
    other = execution(FORWARD, refine=True)
    other.tick(world(), 100.0)
    other.answer(Answer(chain(("shoot", Pose(4.0, 0.0, 0.0))), True, "invalid"))
    assert other.executor.chain is FORWARD
    assert "expected the steps of the question" in other.refining.reason
    assert not other.refining.refined


def test_open_variables_are_filled_in_without_refinement() -> None:
    steps = ("goToBall", Pose(1.0, 0.0, 0.0)), ("dribbleBall", Pose(2.5, 0.0, 0.0))
    sent = chain(*steps, opened=frozenset({"yaw"}))
    filled = sent.with_goal(0, dataclasses.replace(sent.calls[0].goal, pose=Pose(1.0, 0.0, 0.7)))
    state = world(ball=ObjectState(1.0, 0.0))
    run = execution(sent, refine=True)
    run.tick(state, 100.0)
    run.answer(Answer(filled, False, "the gate is closed"))
    run.tick(dataclasses.replace(state, time=1.05), 100.1)
    assert run.executor.chain == filled
    assert (run.refining.refined, run.refining.reason) == (False, "the gate is closed")


@pytest.mark.parametrize(
    "ending", [Ending.CANCELED, Ending.PREEMPTED, Ending.SHUTDOWN, Ending.INPUT_LOST]
)
def test_an_aborted_action_is_recorded(ending: Ending) -> None:
    run = execution(FORWARD)
    run.tick(world(), 100.0)
    run.tick(world(1.05), 100.05)
    run.tick(world(1.1, v=0.05), 100.1)
    assert run.executor.records == []
    run.end(ending, "for some reason")
    run.end(Ending.CANCELED, "too late")
    [record] = run.executor.records
    recorded = record.top, record.reason, record.ending, record.end.time
    assert recorded == ("goToPose", "for some reason", ending, 1.1)
    assert record.duration == pytest.approx(0.05)
    assert run.predicted_remaining(1.1) == 0.0


DRIBBLE = chain(("dribbleBall", Pose(1.0, 0.0, 0.0)))
AWAY = world(ball=ObjectState(2.0, 2.0))


def test_without_refinement_the_first_valid_plan_is_executed() -> None:
    run = execution(DRIBBLE, FORWARD, FORWARD_LEFT)
    run.tick(AWAY, 100.0)
    assert run.executor.chain == FORWARD
    assert run.ending is None


def test_without_a_valid_plan_all_reasons_are_reported() -> None:
    run = execution(DRIBBLE, DRIBBLE)
    run.tick(AWAY, 100.0)
    assert run.ending is Ending.REFUSED
    assert run.reason.count(" | ") == 1


OPEN_ORDER = chain(
    ("dribbleBall", Pose(2.0, 1.0, 0.0)),
    ("goToBall", Pose(1.0, 0.0, 0.0)),
    opened=frozenset({"order", "yaw"}),
)
BALL_AHEAD = world(ball=ObjectState(1.0, 0.0))


def test_refinement_is_asked_for_a_chain_that_is_valid_in_another_order_only() -> None:
    run = execution(OPEN_ORDER, refine=True)
    run.tick(BALL_AHEAD, 100.0)
    assert run.phase is Phase.REFINING
    run.answer(Answer(OPEN_ORDER.reordered((1, 0)), True, "in a valid order"))
    assert run.executor.chain.order == (1, 0)
    assert run.phase is Phase.EXECUTING


def test_without_an_answer_it_is_executed_in_the_valid_order() -> None:
    run = execution(OPEN_ORDER, refine=True)
    run.tick(BALL_AHEAD, 100.0)
    run.answer(Answer(None, False, "no models"))
    assert run.executor.chain.order == (1, 0)
    assert run.executor.chain.calls[0].goal.pose.yaw == pytest.approx(0.0)
    assert run.refining.reason == (
        "executed with naive values, in a valid order, refinement failed: no models"
    )
    run.tick(dataclasses.replace(BALL_AHEAD, time=1.05), 100.1)
    assert run.ending is None


def test_it_is_refused_without_refinement_and_if_no_order_is_valid() -> None:
    run = execution(OPEN_ORDER)
    run.tick(BALL_AHEAD, 100.0)
    assert run.ending is Ending.REFUSED
    assert "pre-condition of step 1 (dribbleBall) now" in run.reason
    run = execution(OPEN_ORDER, refine=True)
    run.tick(AWAY, 100.0)
    assert run.ending is Ending.REFUSED
    assert "no valid plan: in no order: pre-condition of step" in run.reason


def test_refinement_chooses_a_plan_and_changes_only_its_open_variables() -> None:
    opened = chain(("goToPose", Pose(1.0, 1.0, 0.0)), opened=frozenset({"yaw"}))
    turned = chain(("goToPose", Pose(1.0, 1.0, 0.5)), opened=frozenset({"yaw"}))
    run = execution(FORWARD, opened, refine=True)
    run.tick(world(), 100.0)
    run.answer(Answer(turned, True, "better", chosen=1))
    assert run.executor.chain == turned
    assert run.refining.reason == "alternative 1 is chosen: better"
    other = execution(FORWARD, opened, refine=True)
    other.tick(world(), 100.0)
    other.answer(Answer(FORWARD_LEFT, True, "invalid", chosen=0))
    assert other.executor.chain == FORWARD
    assert "x of step 1" in other.refining.reason or "y of step 1" in other.refining.reason


def test_a_goal_before_the_first_ball_message_waits_at_rest() -> None:
    run = execution(chain(("goToPose", Pose(-1.0, 0.0, 0.0)), ("goToBall", Pose(1.0, 0.0, 0.0))))
    for tick in range(10):
        assert run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick) == STOP
    assert (run.phase, run.reason) == (Phase.WAITING, "waiting for the ball")
    run.tick(world(1.5, ball=ObjectState(1.0, 0.0)), 100.5)
    assert run.phase is Phase.EXECUTING
    assert run.start.time == 1.5


CARRY = chain(("goToBall", Pose(1.0, 0.0, 0.0)), ("dribbleBall", Pose(2.5, 0.0, 0.0)))


def carrying() -> tuple[Supervisor, World]:
    """Return an execution of CARRY that dribbles, and its current state."""
    run = execution(CARRY)
    with Simulation(ROBOT) as simulation:
        simulation.place_object(BALL, 1.0, 0.0)
        while run.executor.call.top.name != "dribbleBall":
            simulation.command(run.tick(simulation.world(), 100.0))
            simulation.tick()
            assert run.ending is None
        return run, simulation.world()


def test_a_lost_ball_ends_the_goal_with_ball_lost() -> None:
    run, state = carrying()
    assert run.tick(state.with_object(BALL, ObjectState(1.0, 0.5)), 100.0) == STOP
    assert run.ending is Ending.OBJECT_LOST
    assert run.reason.startswith("ball lost in dribbleBall: lost the ball: it is")
    assert run.executor.records[-1].lost


def test_the_original_chain_is_executed_if_the_refined_one_has_no_path() -> None:
    sent = chain(("goToPose", Pose(3.0, 1.0, 0.0)), opened=frozenset({"x"}))
    in_a_post = chain(("goToPose", Pose(4.0, 1.0, 0.0)), opened=frozenset({"x"}))
    run = execution(sent, refine=True)
    run.tick(world(), 100.0)
    run.answer(Answer(in_a_post, True, "0.5 s faster"))
    assert run.refining.refined
    for tick in range(1, 60):
        command = run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick)
        if not run.refining.refined and command != STOP:
            break
    assert (run.ending, run.executor.chain, run.refining.refined) == (None, sent, False)
    assert command.vx > 0.0
    assert run.refining.reason.startswith(
        "executed as sent, as the refined chain failed at its start: "
    )
    assert "found none" in run.refining.reason
    assert [record.ending for record in run.executor.records] == [Ending.FAILED]


def test_a_chain_that_was_not_refined_ends_without_a_search_for_naive_values(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searched: list[object] = []
    monkeypatch.setattr(refining, "naive_on_paths", lambda *given: searched.append(given))
    run = execution(chain(("goToPose", Pose(4.0, 1.0, 0.0)), opened=frozenset({"yaw"})))
    for tick in range(3):
        run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick)
    assert run.ending is Ending.FAILED, run.reason
    assert searched == []


def test_gaps_in_odometry_are_named_when_the_robot_stood_in_several() -> None:
    run = execution(FORWARD)
    run.tick(world(), 100.0)
    for gap in range(1, 4):
        assert run.gap_problem == ""
        run.tick(world(1.0 + 0.2 * gap), 100.0 + 0.2 * gap)
    assert "at most 0.15 s apart, got 3 longer gaps, up to 0.20 s" in run.gap_problem
    assert len(run.gap_problem) <= 300
