"""The default actions, executed in the simulation."""

import dataclasses
import itertools
import math

import pytest
from action_runs import KINDS, Task, execute, execute_situation

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, Step
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.go_to_ball import GoToPoseOrBall as GoToPose
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.geometry import Pose
from ator_ros.simulation.run import run_action
from ator_ros.simulation.scene_simulation import TICK, Simulation
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import STOP, ObjectState, RobotState, World

ROBOT = load_robot()
AT_ORIGIN = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))


@pytest.mark.parametrize(("action_set", "seed"), [("default", 78), ("bezier", 11)])
@pytest.mark.parametrize("kind", KINDS)
def test_the_actions_reach_their_goals_within_the_limits(
    kind: str, action_set: str, seed: int
) -> None:
    outcomes = [execute(Task(kind, action_set, seed, index)) for index in range(8)]
    # A shot may start with the robot's front against a post, without room to turn, and curves need
    # more room.
    allowed = 0 if action_set == "default" and kind != "shoot" else 1
    assert len([outcome.reason for outcome in outcomes if not outcome.success]) <= allowed
    assert not any(outcome.early for outcome in outcomes)
    assert max(outcome.excess for outcome in outcomes) <= 1.0 + 1e-9


@pytest.mark.parametrize("angle", [30.0, -120.0])
def test_noisy_odometry_at_rest_does_not_prolong_a_turn_on_the_spot(angle: float) -> None:
    goal, times = Goal(Pose(0.0, 0.0, math.radians(angle)), 0.0, Point.AXLE), []
    for start in (RobotState(Pose(0.0, 0.0, 0.0)), RobotState(Pose(0.005, 0.002, 0.0), 2e-3)):
        action = GoToPose(ROBOT)
        with Simulation(ROBOT) as simulation:
            simulation.place_robot(start.pose)
            action.start(World(0.0, start), goal)
            while True:
                world = simulation.world()
                noisy = RobotState(world.robot.pose, world.robot.vx + start.vx, world.robot.w)
                step = action.step(World(world.time, noisy))
                if step.status is not Status.RUNNING:
                    break
                simulation.command(step.command)
                simulation.tick()
            assert step.status is Status.SUCCEEDED
            times.append(simulation.time)
    assert times[1] <= times[0] + TICK


def test_coming_straight_to_a_ball_at_speed_takes_no_longer_than_stopping_there() -> None:
    # After the first turn, the drive has hardly more room than its change of speed needs.
    for offset, speed, distance in itertools.product(
        (0.16, 0.21, -0.6, -0.7, 0.87), (0.05, 0.63, 0.8), (1.15, 1.2)
    ):
        world = World(0.0, RobotState(Pose(0.0, 0.0, offset)), {BALL: ObjectState(distance, 0.0)})
        seconds = []
        for arrival in (0.0, speed):
            action = GoToPose(ROBOT)
            action.start(world, Goal(Pose(distance, 0.0, 0.0), arrival, Point.HOLD))
            seconds.append(float(action.step(world).message.split()[1]))
        assert seconds[1] <= seconds[0], (offset, speed, distance)


@pytest.mark.parametrize("speed", [-0.1, 5.0, math.nan])
def test_an_impossible_arrival_speed_is_rejected(speed: float) -> None:
    with pytest.raises(ActionError, match="arrival speed"):
        GoToPose(ROBOT).start(AT_ORIGIN, Goal(Pose(1.0, 0.0, 0.0), speed))


def test_starts_in_motion_are_driven_as_planned() -> None:
    moving = Situation(
        "goToPose", RobotState(Pose(0.0, 0.0, 0.3), 0.8, 1.2), {}, Goal(Pose(2.0, 1.0, 1.0), 0.0)
    )
    outcome = execute_situation(moving, Task("pose", "default", 0, 0))
    action = GoToPose(ROBOT)
    action.start(World(0.0, moving.robot), moving.goal)
    seconds_to_go = float(action.step(World(0.0, moving.robot)).message.split()[1])
    assert outcome.success
    assert outcome.duration == pytest.approx(seconds_to_go, abs=0.1)


PLACE = (0.0, 0.0)
ALLOWANCE = 2 * TICK


def approach(late: int, unseen: int = 0) -> tuple[float, float]:
    """Drive to a ball; return the duration and the ball's displacement.

    The first `late` commands are lost; then the action misses `unseen` states.
    """
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        simulation.place_object("ball", *PLACE)
        action = GoToPose(ROBOT)
        action.start(simulation.world(), Goal(Pose(*PLACE, 0.0), 0.0, Point.HOLD))
        for tick in range(400):
            world = simulation.world()
            if not 0 < tick - late + 1 <= unseen:
                step = action.step(world)
            if step.status is not Status.RUNNING:
                break
            simulation.command(STOP if tick < late else step.command)
            simulation.tick()
        assert step.status is Status.SUCCEEDED, step.message
        return world.time, abs(ball_of(world).x) + abs(ball_of(world).y)


@pytest.mark.parametrize(("late", "unseen"), [(1, 0), (10, 0), (2, 1)])
def test_a_late_start_costs_only_its_delay_and_the_ball_does_not_move(
    late: int, unseen: int
) -> None:
    punctual, _ = approach(0)
    duration, moved = approach(late, unseen)
    assert duration <= punctual + (late + unseen) * TICK + ALLOWANCE
    assert moved < 0.02


def test_a_plan_does_not_wait_forever_for_a_robot_that_does_not_start() -> None:
    def without_command(action: Action, world: World) -> Step:
        return dataclasses.replace(action.step(world), command=None)

    with Simulation(ROBOT) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        goal = Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.AXLE)
        step = run_action(simulation, GoToPose(ROBOT), goal, step=without_command)
    assert step.status is Status.FAILED
    assert "gave up after 20 new plans" in step.message


def test_at_most_one_action_starts_per_tick() -> None:
    library = SOCCER.library(ROBOT)
    here = Pose(1.0, 0.5, 0.3)
    call = TopCall(library["goToPose"], Goal(here), frozenset({"x", "y", "yaw", "speed"}))
    executor = ChainExecutor(library, TopChain((call,) * 5))
    for tick in range(1, 5):
        step = executor.step(World(0.05 * tick, RobotState(here)))
        assert step.status is Status.RUNNING
        assert len(executor.records) <= tick
    assert math.isclose(executor.elapsed, 0.15)
