"""Turns on the spot, short drives and goals at the start: drawn, driven and predicted; leaving a ball."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from ator_ros.actions.base import Goal, Point, Status, Step
from ator_ros.actions.situation import Situation
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, objects_of
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.experience.episode import Episode, run_episode
from ator_ros.experience.table import episode_frame, join
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.performance.features import OBSERVED
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_models
from ator_ros.performance.training import train
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import load_robot
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.simulation import Simulation
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import CONTROL_PERIOD, ObjectState, RobotState, World

ROBOT = load_robot()
SETS = tuple(SOCCER.action_sets)
START = Pose(-1.0, 0.4, 0.7)


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    with Simulation(ROBOT) as made:
        yield made


def drive(simulation: Simulation, action_set: str, goal: Pose) -> Episode:
    """Drive from `START` to a pose."""
    situation = Situation("goToPose", RobotState(START), {}, Goal(goal))
    action = SOCCER.actions(action_set)["goToPose"].factory(ROBOT)
    top = SOCCER.library(ROBOT, action_set)["goToPose"]
    return run_episode(simulation, action, situation, top=top)


def moved(ahead: float, left: float, turn: float = 0.0) -> Pose:
    return START.compose(Pose(ahead, left, turn))


def kind_of(start: Pose, goal: Pose) -> str:
    """Name the kind of a drive by what lies between start and goal."""
    distance, turn = start.distance(goal), abs(wrap_angle(goal.yaw - start.yaw))
    if distance < 0.031 and turn < 0.081:
        return "at the goal"
    if distance < 1e-9:
        return "turn"
    return "short" if distance < 0.5 else "long"


@pytest.mark.parametrize(
    ("domain", "action", "kinds"),
    [
        ("soccer", "goToPose", {"turn", "short", "at the goal", "long"}),
        ("soccer", "dribbleBall", {"short", "at the goal", "long"}),
        ("tour", "drive_to", {"turn", "short", "at the goal", "long"}),
        ("drive", "goToPose", {"turn", "short", "at the goal", "long"}),
    ],
)
def test_every_domain_draws_turns_and_short_drives(domain: str, action: str, kinds: set[str]) -> None:
    found, rng = find_domain(domain), np.random.default_rng(5)
    robot, sample = found.robot(None), found.actions()[action].sample
    drawn = [sample(robot, rng) for _ in range(400)]
    seen = [kind_of(each.robot.pose, each.goal.robot_pose(robot)) for each in drawn]
    assert set(seen) == kinds
    assert 0.6 < seen.count("long") / len(seen) < 0.95


@pytest.mark.parametrize("action_set", SETS)
@pytest.mark.parametrize(("ahead", "left"), [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1), (0.3, 0.3)])
def test_short_drives_succeed(simulation: Simulation, action_set: str, ahead: float, left: float) -> None:
    assert drive(simulation, action_set, moved(ahead, left)).success


@pytest.mark.parametrize("action_set", SETS)
@pytest.mark.parametrize(("ahead", "turn"), [(0.0, 0.0), (0.01, 0.05)])
def test_a_goal_at_the_start_ends_within_a_tick(
    simulation: Simulation, action_set: str, ahead: float, turn: float
) -> None:
    episode = drive(simulation, action_set, moved(ahead, 0.0, turn))
    assert episode.success
    assert episode.duration <= CONTROL_PERIOD + 1e-9


# Leaving the ball


def leave(simulation: Simulation, action_set: str, start: World, goal: Pose) -> tuple[Step, World]:
    """Drive to a pose from a state with a ball in it."""
    place(simulation, start)
    done = run_action(simulation, SOCCER.actions(action_set)["goToPose"].factory(ROBOT), Goal(goal))
    return done, simulation.world()


def beside(ahead: float, left: float) -> World:
    """Return a world with the ball at a place relative to the robot at `START`."""
    ball = START.compose(Pose(ahead, left, 0.0))
    return World(0.0, RobotState(START), objects_of(ObjectState(ball.x, ball.y)))


@pytest.mark.parametrize(
    ("ahead", "left"), [(ROBOT.hold, 0.0), (ROBOT.tip + 0.06, 0.02), (0.0, ROBOT.half_width + 0.06)]
)
@pytest.mark.parametrize("goal", [Pose(2.0, 1.0, 0.0), Pose(-2.5, -0.5, 2.0), Pose(0.3, 1.5, -2.0)])
def test_a_robot_leaves_a_ball_that_it_touches(
    simulation: Simulation, ahead: float, left: float, goal: Pose
) -> None:
    world = beside(ahead, left)
    done, after = leave(simulation, "default", world, goal)
    assert done.status is Status.SUCCEEDED, done.message
    before, ball = world.objects[BALL], after.objects[BALL]
    assert math.hypot(ball.x - before.x, ball.y - before.y) < 0.03


def test_the_bezier_set_backs_off_from_the_ball_too(simulation: Simulation) -> None:
    world = beside(ROBOT.hold, 0.0)
    done, after = leave(simulation, "bezier", world, Pose(-2.5, -0.5, 2.0))
    assert done.status is Status.SUCCEEDED, done.message
    before, ball = world.objects[BALL], after.objects[BALL]
    assert math.hypot(ball.x - before.x, ball.y - before.y) < 0.03


# What models predict


def turns(simulation: Simulation, angles: list[float]) -> list[Episode]:
    return [drive(simulation, "default", moved(0.001, 0.0, angle)) for angle in angles]


@pytest.fixture(scope="module", params=["described", "observed"])
def model(request: pytest.FixtureRequest, simulation: Simulation) -> PerformanceModel:
    """Return a model that has seen nothing but turns."""
    angles = np.random.default_rng(8).uniform(-math.pi, math.pi, 40).tolist()
    rows = join(episode_frame(at, each, ()) for at, each in enumerate(turns(simulation, angles)))
    features = OBSERVED if request.param == "observed" else SOCCER.candidates("goToPose")
    return train("goToPose", rows, ROBOT, features=features)


def predicted(model: PerformanceModel, goal: Pose) -> tuple[float, float]:
    x, y, yaw = START
    direct = {"x": x, "y": y, "yaw": yaw, "xg": goal.x, "yg": goal.y, "yawg": goal.yaw}
    found = model.predict(direct | dict.fromkeys(("v", "w", "speedg", "hold"), 0.0))
    assert found.duration is not None
    assert found.spread is not None
    return float(found.duration[0]), float(found.spread[0])


def test_turns_are_predicted_within_the_spread(model: PerformanceModel, simulation: Simulation) -> None:
    for angle in (-2.9, -1.2, -0.4, 0.6, 1.9, 3.1):
        goal = moved(0.0, 0.002, angle)
        duration, spread = predicted(model, goal)
        assert duration == pytest.approx(
            drive(simulation, "default", goal).duration, abs=max(2.0 * spread, CONTROL_PERIOD)
        )


def test_a_chain_that_goes_on_after_a_dribble_is_refined_and_executed() -> None:
    library, opened = SOCCER.library(ROBOT), frozenset({"yaw"})
    fetch, put = Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.HOLD), Goal(Pose(1.5, 1.0, 1.2), 0.0, Point.HOLD)
    chain = TopChain(
        (
            TopCall(library["goToBall"], fetch, opened),
            TopCall(library["dribbleBall"], put, opened),
            TopCall(library["goToPose"], Goal(Pose(-1.0, -1.0, 0.0))),
        )
    )
    start = World(0.0, RobotState(Pose(-2.0, 0.0, 0.0)), objects_of(ObjectState(0.0, 0.0)))
    answer = Refiner(ROBOT, load_models(ROBOT, SOCCER.known_features)).refine(start, chain)
    assert answer.refined, answer.reason
    run = run_chain(ROBOT, library, start, answer.chain)
    assert run.success, run.reason
    for prediction in (answer.before, answer.after):
        steps = [action["duration"] for action in prediction.actions]
        assert prediction.duration == pytest.approx(sum(steps))
