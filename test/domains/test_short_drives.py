"""Turns on the spot, short drives and goals at the start: sampling and execution.

Leaving a ball.
"""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from ator_ros.actions.base import Goal, Status
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL, objects_of
from ator_ros.experience.simulated import run_episode
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import CONTROL_PERIOD, ObjectState, RobotState, World

SOCCER = find_domain("soccer")

ROBOT = load_robot()
SETS = tuple(SOCCER.action_sets)
START = Pose(-1.0, 0.4, 0.7)


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    with Simulation(ROBOT) as made:
        yield made


def kind_of(start: Pose, goal: Pose) -> str:
    """Return the kind of a drive by the displacement from start to goal."""
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
        ("pursuit", "pursue", {"turn", "short", "at the goal", "long"}),
        ("drive", "goToPose", {"turn", "short", "at the goal", "long"}),
    ],
)
def test_every_domain_draws_turns_and_short_drives(
    domain: str, action: str, kinds: set[str]
) -> None:
    found, rng = find_domain(domain), np.random.default_rng(5)
    robot, sample = found.robot(None), found.actions()[action].sample
    drawn = [sample(robot, rng) for _ in range(400)]
    found = [kind_of(each.robot.pose, each.goal.robot_pose(robot)) for each in drawn]
    assert set(found) == kinds
    assert 0.6 < found.count("long") / len(found) < 0.95


@pytest.mark.parametrize("action_set", SETS)
@pytest.mark.parametrize(("ahead", "turn"), [(0.0, 0.0), (0.01, 0.05)])
def test_a_goal_at_the_start_ends_within_a_tick(
    simulation: Simulation, action_set: str, ahead: float, turn: float
) -> None:
    goal = Goal(START.compose(Pose(ahead, 0.0, turn)))
    action = SOCCER.actions(action_set)["goToPose"].factory(ROBOT)
    top = SOCCER.library(ROBOT, action_set)["goToPose"]
    situation = Situation("goToPose", RobotState(START), {}, goal)
    episode = run_episode(simulation, action, situation, top=top)
    assert episode.success
    assert episode.duration <= CONTROL_PERIOD + 1e-9


@pytest.mark.parametrize(
    ("ahead", "left"), [(ROBOT.hold, 0.0), (ROBOT.tip + 0.06, 0.02), (0.0, ROBOT.half_width + 0.06)]
)
@pytest.mark.parametrize("goal", [Pose(2.0, 1.0, 0.0), Pose(-2.5, -0.5, 2.0)])
def test_a_robot_leaves_a_ball_that_it_touches(
    simulation: Simulation, ahead: float, left: float, goal: Pose
) -> None:
    there = START.compose(Pose(ahead, left, 0.0))
    place(simulation, World(0.0, RobotState(START), objects_of(ObjectState(there.x, there.y))))
    done = run_action(simulation, SOCCER.actions()["goToPose"].factory(ROBOT), Goal(goal))
    assert done.status is Status.SUCCEEDED, done.message
    ball = simulation.world().objects[BALL]
    assert math.hypot(ball.x - there.x, ball.y - there.y) < 0.03
