"""Rolling balls: estimation of the deceleration."""

import dataclasses

import numpy as np
import pytest

from ator_ros.actions.base import ActionError
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.holding import DribbleBall
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.execution.rolling import Rolling
from ator_ros.geometry import Pose
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import ObjectState, RobotState, World


def test_a_ball_that_is_lost_in_every_turn_cannot_be_dribbled() -> None:
    robot = load_robot()
    ball = dataclasses.replace(robot.scene.objects["ball"], rolling_deceleration=0.03)
    scene = dataclasses.replace(robot.scene, objects={"ball": ball})
    with pytest.raises(ActionError, match="ball stays in front"):
        DribbleBall(dataclasses.replace(robot, scene=scene)).setup()


ROBOT = load_robot()
DESCRIBED = ROBOT.scene.objects["ball"].rolling_deceleration
PERIOD = 0.05


@pytest.fixture(scope="module")
def library() -> TopLibrary:
    return SOCCER.library(ROBOT)


def roll(
    rolling: Rolling,
    deceleration: float,
    *,
    seconds: float = 1.0,
    away: float = 1.0,
    noise: float = 0.0,
) -> None:
    """Roll a ball away from the robot, at 1 m/s from `away` m ahead of it."""
    rng = np.random.default_rng(3)
    for tick in range(round(seconds / PERIOD) + 1):
        time = tick * PERIOD
        speed = 1.0 - deceleration * time + noise * rng.standard_normal()
        ball = ObjectState(away + time - deceleration * time**2 / 2.0, 0.0, speed, 0.0)
        rolling.observe(World(time, RobotState(Pose(0.0, 0.0, 0.0)), {"ball": ball}))


def deceleration(rolling: Rolling) -> float:
    return rolling.robot().scene.objects["ball"].rolling_deceleration


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_a_changed_deceleration_is_estimated_until_it_is_as_described(noise: float) -> None:
    rolling = Rolling(ROBOT)
    roll(rolling, DESCRIBED / 2.0, noise=noise)
    assert deceleration(rolling) == pytest.approx(DESCRIBED / 2.0, abs=0.051)
    assert "ball rolls" in rolling.diagnostics()
    assert dataclasses.replace(rolling.robot(), scene=ROBOT.scene) == ROBOT  # nothing else differs
    for _ in range(7):
        roll(rolling, DESCRIBED)
    assert rolling.robot() is ROBOT


@pytest.mark.parametrize("share", [0.8, 1.0, 1.2])
def test_a_ball_that_rolls_about_as_described_changes_nothing(
    share: float, library: TopLibrary
) -> None:
    rolling = Rolling(ROBOT)
    roll(rolling, share * DESCRIBED, noise=0.01)
    assert rolling.library(library) is library
    assert rolling.diagnostics() == {}


def test_pushed_braked_or_briefly_rolling_balls_are_ignored() -> None:
    rolling = Rolling(ROBOT)
    roll(rolling, 0.0, away=-0.5, seconds=0.9)  # past the robot, beside its front
    for _ in range(2):
        roll(rolling, DESCRIBED / 2.0, seconds=0.3)
    assert rolling.robot() is ROBOT
    for pushed in (0.0, DESCRIBED / 10.0, 2.0 * DESCRIBED):  # by another robot
        rolling = Rolling(ROBOT)
        for _ in range(9):
            roll(rolling, pushed, seconds=0.6)
        assert rolling.robot() is ROBOT


@pytest.mark.parametrize("noise", [0.07, 0.2])
def test_velocity_noise_of_a_resting_ball_is_ignored(noise: float) -> None:
    rolling, rng = Rolling(ROBOT), np.random.default_rng(4)
    for tick in range(2000):
        ball = ObjectState(2.0, 0.0, *(noise * rng.standard_normal(2)))
        rolling.observe(World(tick * PERIOD, RobotState(Pose(0.0, 0.0, 0.0)), {"ball": ball}))
        assert rolling.robot() is ROBOT or tick % 20


def test_with_the_estimated_deceleration_the_robot_keeps_the_ball(library: TopLibrary) -> None:
    item = dataclasses.replace(ROBOT.scene.objects[BALL], rolling_deceleration=DESCRIBED / 2.0)
    actual = dataclasses.replace(
        ROBOT, scene=dataclasses.replace(ROBOT.scene, objects={BALL: item})
    )
    rolling = Rolling(ROBOT)
    roll(rolling, DESCRIBED / 2.0)
    drawn = random_trial(SOCCER, "dribble", library, seed=77, index=2)
    assert not run_chain(actual, library, drawn.world, drawn.chain).success
    executor = ChainExecutor(library, drawn.chain, time_limit=SOCCER.time_limit, rolling=rolling)
    aware = run_chain(actual, library, drawn.world, drawn.chain, executor=executor)
    assert aware.success, aware.reason
