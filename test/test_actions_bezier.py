"""The paper's action set, in scenarios over random starts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from action_runs import Task, execute, execute_situation, tasks
from scenarios import (
    Run,
    always_holds_the_ball,
    always_within_limits,
    ball_in_the_goal,
    ball_stays_until_the_end,
    eventually_at_the_pose,
    run_many,
)

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.domains.soccer.bezier import curve as curve_module
from ator_ros.domains.soccer.bezier.curve import Curve, CurveShape, curve_to, shortest_way
from ator_ros.domains.soccer.bezier.dribble_ball import dribbling
from ator_ros.domains.soccer.bezier.driver import Driver, Style
from ator_ros.domains.soccer.bezier.go_to_pose import TO_BALL, TO_POSE
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, ball_of, field_of
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.resources import resource_path
from ator_ros.robot.description import Robot, load_robot
from ator_ros.world.state import CONTROL_PERIOD, Command, ObjectState, RobotState, World

COUNT = 14
AXLE_GOAL = Goal(Pose(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def runs(robot: Robot) -> dict[str, list[Run]]:
    actions = SOCCER.actions("bezier")
    return {
        name: run_many(robot, spec.factory(robot), seed=11, count=COUNT) for name, spec in actions.items()
    }


def test_set_offers_the_same_actions_as_the_default_set() -> None:
    assert set(SOCCER.actions("bezier")) == set(SOCCER.actions())


def test_commands_and_velocities_stay_within_limits(runs: dict[str, list[Run]]) -> None:
    assert all(always_within_limits(run) for of_action in runs.values() for run in of_action)


@pytest.mark.parametrize("style", [TO_POSE, TO_BALL])
def test_a_robot_that_turns_slowly_is_commanded_within_its_limits(robot: Robot, style: Style) -> None:
    limits = dataclasses.replace(robot.limits, w=1.0)
    driver, state = Driver(limits, style), RobotState(Pose(0.0, 0.0, 0.0))
    commands = [driver.follow(state, Pose(-1.0, 1.0, math.pi), 0.0) for _ in range(40)]
    assert max(abs(command.w) for command in commands) == limits.w


def test_go_to_pose_arrives(runs: dict[str, list[Run]]) -> None:
    assert sum(eventually_at_the_pose(run) for run in runs["goToPose"]) >= COUNT - 1


def test_approach_leaves_the_ball_in_its_place(runs: dict[str, list[Run]]) -> None:
    approaches = [run for run in runs["goToPose"] if ball_of(run.situation) is not None]
    assert len(approaches) >= COUNT / 2
    assert sum(ball_stays_until_the_end(run) for run in approaches) >= len(approaches) - 1


def test_dribble_arrives_with_the_ball(runs: dict[str, list[Run]]) -> None:
    arrived = [eventually_at_the_pose(run) and always_holds_the_ball(run) for run in runs["dribbleBall"]]
    assert sum(arrived) >= COUNT - 2


def test_shoot_scores(runs: dict[str, list[Run]]) -> None:
    assert sum(ball_in_the_goal(run) for run in runs["shoot"]) >= COUNT - 2


def test_the_way_is_the_curve_from_the_robot_to_the_goal(robot: Robot) -> None:
    action = SOCCER.actions("bezier")["goToPose"].factory(robot)
    start, goal = Pose(-1.0, 0.5, 0.3), Pose(1.0, -0.5, 1.2)
    world = World(0.0, RobotState(start))
    action.start(world, Goal(goal))
    assert action.way() is None
    action.step(world)
    way = action.way()
    assert way is not None
    assert way[0] == pytest.approx(start, abs=0.1)
    assert way[-1] == pytest.approx(goal)
    # Where the curve ends, a straight run-in begins.
    assert abs(Pose(*way[-2]).relative(goal).y) < 0.01
    assert way[-2] == pytest.approx(goal, abs=0.4)


def test_same_start_gives_the_same_steps(robot: Robot, runs: dict[str, list[Run]]) -> None:
    again = run_many(robot, SOCCER.actions("bezier")["goToPose"].factory(robot), seed=11, count=2)
    assert [run.steps for run in again] == [run.steps for run in runs["goToPose"][:2]]


@pytest.mark.parametrize("name", ["dribbleBall", "shoot"])
def test_ball_must_be_held_at_the_start(robot: Robot, name: str) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(1.0, 0.0)})
    goal = Goal(Pose(*field_of(robot).goal_centre(), 0.0), point=Point.HOLD)
    with pytest.raises(ActionError, match="expected the ball within"):
        SOCCER.actions("bezier")[name].factory(robot).start(world, goal)


@pytest.mark.parametrize("goal", [Goal(Pose(math.nan, 0.0, 0.0)), Goal(Pose(0.0, 0.0, 0.0), speed=9.0)])
def test_impossible_goal_is_refused(robot: Robot, goal: Goal) -> None:
    with pytest.raises(ActionError, match="expected a"):
        SOCCER.actions("bezier")["goToPose"].factory(robot).start(
            World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), goal
        )


def test_shot_at_a_place_without_a_goal_is_refused(robot: Robot) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(robot.hold, 0.0)})
    with pytest.raises(ActionError, match="goal's mouth"):
        SOCCER.actions("bezier")["shoot"].factory(robot).start(world, AXLE_GOAL)


@pytest.mark.parametrize(
    ("start", "ball"),
    [
        ((0.03, 1.51, 1.4), (-2.93, -1.062, 0.4189)),  # round the ball by the side away from the post
        ((-2.529, 0.99, -3.0556), (-3.0732, -0.7337, 0.1571)),  # both sides hit the post
    ],
)
def test_approach_keeps_clear_of_the_posts(
    start: tuple[float, float, float], ball: tuple[float, float, float]
) -> None:
    situation = Situation(
        "goToPose",
        RobotState(Pose(*start)),
        {BALL: ObjectState(*ball[:2])},
        Goal(Pose(*ball), point=Point.HOLD),
    )
    outcome = execute_situation(situation, Task("approach", "bezier", 0, 0))
    assert outcome.success
    assert outcome.duration < 15.0


def test_approach_from_the_front_passes_the_ball_at_a_distance(robot: Robot) -> None:
    start, ball = Pose(2.5636, -0.7146, -1.3929), Pose(2.934, -1.3802, 2.6704)
    objects = {BALL: ObjectState(ball.x, ball.y)}
    situation = Situation("goToPose", RobotState(start), objects, Goal(ball, point=Point.HOLD))
    outcome = execute_situation(situation, Task("approach", "bezier", 0, 0))
    assert outcome.success
    assert not outcome.early


def test_a_ball_that_lies_loosely_between_the_fins_is_not_lost_in_the_first_turn(robot: Robot) -> None:
    loose, goal = Pose(0.0, 0.0, 0.0).ahead(robot.hold + 0.07), Goal(Pose(-1.0, 0.5, 3.0), point=Point.HOLD)
    ball = {BALL: ObjectState(loose.x, loose.y)}
    situation = Situation("dribbleBall", RobotState(Pose(0.0, 0.0, 0.0)), ball, goal)
    assert execute_situation(situation, Task("dribble", "bezier", 0, 0)).success


def test_a_robot_in_the_goals_place_does_not_wait_for_another_heading(robot: Robot) -> None:
    driver = Driver(robot.holder_for("a test").limits, dribbling())
    assert driver.follow(RobotState(Pose(0.0, 0.0, 0.15)), Pose(0.0, 0.0, 0.0), 0.0).v > 0.0


@pytest.mark.parametrize("at", [Pose(0.0, 0.03, -0.2), Pose(0.05, 0.0, 0.25)])
def test_a_dribble_that_ends_askew_turns_in_its_place(robot: Robot, at: Pose) -> None:
    hold = robot.hold_point(at)
    goal = Goal(robot.hold_point(Pose(0.0, 0.0, 0.0)), point=Point.HOLD)
    ball = {BALL: ObjectState(hold.x, hold.y)}
    outcome = execute_situation(
        Situation("dribbleBall", RobotState(at), ball, goal), Task("dribble", "bezier", 0, 0)
    )
    assert outcome.success
    assert outcome.duration < 3.0


SHAPE = CurveShape(radius=0.5, run_in=0.2, ahead=0.15, per_speed=0.2)
STARTS = [Pose(-2.0, 0.7, 0.4), Pose(1.5, 1.0, -2.0), Pose(0.3, -1.2, 1.0), Pose(-0.9, -0.1, 3.0)]


def beginning(curve: Curve) -> tuple[float, float]:
    """Return heading (rad) and curvature (1/m) at the start of the Bezier curve, from its polynomial."""
    p = np.array(curve.points)
    first, second = 4.0 * (p[1] - p[0]), 12.0 * (p[2] - 2.0 * p[1] + p[0])
    bend = (first[0] * second[1] - first[1] * second[0]) / np.hypot(*first) ** 3
    return math.atan2(first[1], first[0]), float(bend)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("start", STARTS)
def test_curve_leaves_and_arrives_in_the_headings_of_the_poses(start: Pose, side: float) -> None:
    curve = curve_to(start, 0.3, SHAPE, side)
    heading, bend = beginning(curve)
    assert curve.points[0] == (start.x, start.y)
    assert wrap_angle(heading - start.yaw) == pytest.approx(0.0, abs=1e-9)
    assert bend == pytest.approx(curve.bend)
    (x, y), end = curve.points[-2:]
    assert end == (-SHAPE.run_in, 0.0)
    assert x < end[0]
    assert y == 0.0


@pytest.mark.parametrize("start", STARTS)
def test_mirrored_start_gives_the_mirrored_curve(start: Pose) -> None:
    curve = curve_to(start, 0.3, SHAPE, 1.0)
    mirrored = curve_to(Pose(start.x, -start.y, -start.yaw), 0.3, SHAPE, -1.0)
    assert mirrored.bend == pytest.approx(-curve.bend)
    assert mirrored.left == pytest.approx(curve.left)


def test_robot_on_the_circle_beside_the_goal_stays_on_it() -> None:
    angle = 1.0
    at = Pose(-SHAPE.run_in - 0.5 * math.sin(angle), 0.5 * (1.0 - math.cos(angle)), -angle)
    assert curve_to(at, 0.0, SHAPE, 1.0).bend == pytest.approx(1.0 / SHAPE.radius, rel=0.01)


def test_curve_is_continuous_in_the_heading_of_the_start() -> None:
    headings = np.arange(-math.pi, math.pi, math.radians(1.0))
    for style in (TO_POSE, TO_BALL, dribbling()):
        curves = [curve_to(Pose(-2.0, 0.7, yaw), 0.3, style.shape, 1.0) for yaw in headings]
        bends = np.clip([curve.bend for curve in curves], -style.sharpest, style.sharpest)
        quiet = np.abs([curve.bearing for curve in curves]) < 2.0
        assert np.abs(np.diff(bends))[quiet[1:] & quiet[:-1]].max() < 0.05 * style.sharpest
        assert np.ptp([curve.left for curve in curves]) == 0.0


def test_way_round_the_goal_is_the_quicker_one_and_kept(robot: Robot) -> None:
    driver = Driver(robot.holder_for("a test").limits, dribbling())
    goal = Pose(0.0, 0.0, 0.0)
    left = driver.curve(Pose(0.5, 0.05, math.pi), goal, 0.0)
    assert left.turn > math.pi / 2
    assert _side(left) > 0.0
    assert _side(driver.curve(Pose(0.5, -0.02, math.pi), goal, 0.0)) > 0.0
    driver.reset(Command())
    assert _side(driver.curve(Pose(0.5, -0.02, math.pi), goal, 0.0)) < 0.0


def _side(curve: Curve) -> float:
    """Return on which side of the line from the robot to the goal its middle control point lies, in m."""
    (x, y), middle, end = curve.points[0], curve.points[2], curve.points[-1]
    return (middle[1] - y) * (x - end[0]) - (middle[0] - x) * (y - end[1])


def test_turning_the_start_by_a_degree_hardly_changes_the_duration(robot: Robot) -> None:
    for kind in ("approach", "dribble"):
        runs = [[execute(task) for task in tasks(kind, "bezier", 31, 3, turn)] for turn in (0, 1)]
        changes = [abs(one.duration - other.duration) for one, other in zip(*runs, strict=True)]
        assert max(changes) <= 0.151


def test_duration_of_a_dribble_hardly_depends_on_the_signs_of_its_angles(robot: Robot) -> None:
    """The paper's features don't tell left from right."""
    durations = []
    for sign in (1.0, -1.0):
        start, goal = Pose(-1.2, 0.0, -math.pi / 2), Pose(0.8, 0.0, sign * math.pi / 2)
        ball = robot.hold_point(start)
        to = Goal(robot.hold_point(goal), point=Point.HOLD)
        situation = Situation("dribbleBall", RobotState(start), {BALL: ObjectState(ball.x, ball.y)}, to)
        outcome = execute_situation(situation, Task("dribble", "bezier", 0, 0))
        assert outcome.success
        durations.append(outcome.duration)
    assert abs(durations[0] - durations[1]) < 0.6


@pytest.mark.parametrize("kind", ["pose", "approach", "dribble"])
def test_a_base_with_weak_accelerations_does_not_circle_round_its_goal(kind: str) -> None:
    robot = str(resource_path("config", "pioneer_lx.yaml"))
    assert all(execute(task).success for task in tasks(kind, "bezier", 77, 4, robot=robot))


def test_a_long_way_is_sampled_in_one_go_where_it_is_straight(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, ahead = [], curve_module._ahead
    curve = curve_to(Pose(-1000.0, 0.7, 0.4), 0.3, SHAPE, 1.0)
    monkeypatch.setattr(curve_module, "_ahead", lambda *way: calls.append(way) or ahead(*way))
    places = shortest_way(curve, SHAPE, Pose(0.0, 0.0, 0.0))
    assert len(places) > 19_000
    assert len(calls) < 50
    assert np.ptp(np.hypot(*np.diff(places, axis=0).T)) < 1e-3


def test_ramp_changes_no_faster_than_the_limits(robot: Robot) -> None:
    driver = Driver(robot.limits, TO_POSE)
    driver.reset(Command(0.5, 0.0))
    command = driver.command(5.0, -9.0)
    assert command.v == pytest.approx(0.5 + robot.limits.a * CONTROL_PERIOD)
    assert command.w == pytest.approx(-robot.limits.aw * CONTROL_PERIOD)


def test_without_goals_nothing_can_be_shot() -> None:
    robot = load_robot()
    robot = dataclasses.replace(robot, scene=dataclasses.replace(robot.scene, bays=()))
    held = robot.hold_point(Pose(0.0, 0.0, 0.0))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(held.x, held.y)})
    for actions in ("default", "bezier"):
        with pytest.raises(ActionError, match="shoot: expected"):
            SOCCER.actions(actions)["shoot"].factory(robot).start(world, Goal(Pose(0.0, 0.0, 0.0)))
