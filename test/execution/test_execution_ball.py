"""The executor node's core where the ball is silent or lost, without ROS."""

from __future__ import annotations

import dataclasses

from executions import FORWARD, ROBOT, chain, execution, world

from ator_ros.domains.soccer.field import BALL
from ator_ros.execution.chain_executor import Ending
from ator_ros.execution.supervisor import Phase, Supervisor
from ator_ros.geometry import Pose
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import STOP, ObjectState, World


def test_a_step_that_needs_the_ball_pauses_where_it_is_overdue() -> None:
    ball = ObjectState(0.5, 0.0)
    run = execution(chain(("goToBall", Pose(0.5, 0.0, 0.0))))
    run.tick(world(ball=ball), 100.0)
    assert run.tick(world(1.05, ball=ball), 100.05) != STOP
    assert run.tick(world(1.1, ball=ball), 100.1, overdue=frozenset({BALL})) == STOP
    assert run.ending is None
    assert run.tick(world(1.15, ball=ball), 100.15) != STOP
    alone = execution(FORWARD)
    alone.tick(world(), 100.0)
    assert alone.tick(world(1.05), 100.05, overdue=frozenset({BALL})).v > 0.0


def test_a_goal_that_comes_before_the_ball_waits_for_it_standing() -> None:
    run = execution(chain(("goToPose", Pose(-1.0, 0.0, 0.0)), ("goToBall", Pose(1.0, 0.0, 0.0))))
    for tick in range(10):
        assert run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick) == STOP
    assert (run.phase, run.reason) == (Phase.WAITING, "waiting for the ball")
    run.tick(world(1.5, ball=ObjectState(1.0, 0.0)), 100.5)
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
    run.tick(world(ball=ObjectState(1.0, 0.0)), 100.0)
    assert run.tick(world(1.05, ball=ObjectState(1.0, 0.0)), 100.05) != STOP
    for time in (1.1, 1.15):
        assert run.ending is None
        assert run.tick(world(time), 99.0 + time) == STOP
    assert run.ending is Ending.INPUT_LOST
    assert "ball is missing: goToBall needs it, and no recent one is known" in run.reason


def test_one_state_without_the_ball_is_a_pause() -> None:
    run, ball = execution(chain(("goToBall", Pose(1.0, 0.0, 0.0)))), ObjectState(1.0, 0.0)
    run.tick(world(ball=ball), 100.0)
    for tick in range(1, 9, 2):
        assert run.tick(world(1.0 + 0.05 * tick), 100.0) == STOP
        assert run.tick(world(1.05 + 0.05 * tick, ball=ball), 100.0) != STOP
    assert run.ending is None


def test_a_ball_that_is_silent_when_its_step_comes_ends_the_goal() -> None:
    run = execution(chain(("goToPose", Pose(0.0, 0.0, 0.0)), ("goToBall", Pose(1.0, 0.0, 0.0))))
    run.tick(world(ball=ObjectState(1.0, 0.0)), 100.0)
    for tick in range(1, 5):
        run.tick(world(1.0 + 0.05 * tick), 100.0 + 0.05 * tick)
    assert (run.ending, len(run.executor.records)) == (
        Ending.INPUT_LOST,
        1,
    )  # of goToPose: goToBall has not begun


CARRY = chain(("goToBall", Pose(1.0, 0.0, 0.0)), ("dribbleBall", Pose(2.5, 0.0, 0.0)))


def carrying(*, fetches: int = 0) -> tuple[Supervisor, World]:
    """Return an execution of CARRY that dribbles, and the state that it is in."""
    run = execution(CARRY, fetches=fetches)
    with Simulation(ROBOT) as simulation:
        simulation.place_object(BALL, 1.0, 0.0)
        while run.executor.call.top.name != "dribbleBall":
            simulation.command(run.tick(simulation.world(), 100.0))
            simulation.tick()
            assert run.ending is None
        return run, simulation.world()


def test_a_ball_that_is_lost_ends_the_goal_under_that_name() -> None:
    run, state = carrying()
    assert run.tick(state.with_object(BALL, ObjectState(1.0, 0.5)), 100.0) == STOP
    assert run.ending is Ending.OBJECT_LOST
    assert run.reason.startswith("ball lost in dribbleBall: lost the ball, it is")
    assert run.executor.records[-1].lost


def test_a_ball_that_is_lost_is_fetched_where_it_is() -> None:
    run, state = carrying(fetches=1)
    lost = state.with_object(BALL, ObjectState(1.0, 0.9))
    run.tick(lost, 100.0)
    assert (run.ending, run.executor.fetched, run.executor.call.top.name) == (None, 1, "goToBall")
    run.tick(dataclasses.replace(lost, time=state.time + 0.05), 100.05)  # one action is planned a tick
    assert run.executor.chain.calls[0].goal.pose == Pose(1.0, 0.9, 0.0)
    for wait in (0.1, 0.15):
        assert run.tick(world(state.time + wait), 100.1) == STOP
    assert run.ending is Ending.INPUT_LOST
    assert "ball is missing: goToBall needs it" in run.reason
