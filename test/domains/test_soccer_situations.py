"""Situations that the soccer domain draws for experience lie on the field and can be started."""

import numpy as np
import pytest
from robots import OTHERS
from selection import few

from ator_ros.actions.base import Action, ActionError
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import Robot, load_robot
from ator_ros.domains.soccer.field import ball_of, field_of
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.world.state import World

PIONEER = load_robot()
every_robot = pytest.mark.parametrize(
    "robot", few([PIONEER, *OTHERS], PIONEER, OTHERS[-1]), ids=lambda robot: robot.name
)


def draw(action: str, robot: Robot, count: int = 300) -> list[Situation]:
    rng = np.random.default_rng(1)
    count = min(count, 8) if action == "shoot" else count  # drawing a shot includes planning it
    return [SOCCER.actions()[action].sample(robot, rng) for _ in range(count)]


@every_robot
@pytest.mark.parametrize("action", list(SOCCER.actions()))
def test_situations_lie_on_the_field_and_within_the_limits(action: str, robot: Robot) -> None:
    for situation in draw(action, robot):
        for x, y in [situation.goal.pose[:2]] + [(b.x, b.y) for b in [ball_of(situation)] if b]:
            assert abs(x) <= field_of(robot).length / 2
            assert abs(y) <= field_of(robot).width / 2
        assert abs(situation.robot.vx) <= robot.limits.v
        assert abs(situation.robot.w) <= robot.limits.w
        fastest = robot.holder_for("a test").limits.v
        assert 0.0 <= situation.goal.speed <= fastest
        if ball_of(situation) is not None and action != "goToPose":
            assert situation.robot.vx <= fastest


def starts(action: Action, situation: Situation) -> bool:
    try:
        action.start(World(0.0, situation.robot, situation.objects), situation.goal)
    except ActionError:
        return False
    action.end("planned")
    return True


@every_robot
@pytest.mark.parametrize("action", list(SOCCER.actions()))
def test_drawn_starts_are_feasible(action: str, robot: Robot) -> None:
    """A large robot may have no path to an arrival at speed beside the fence."""
    factory = SOCCER.actions()[action].factory
    impossible = [s for s in draw(action, robot, 10) if not starts(factory(robot), s)]
    assert len(impossible) <= (0 if robot is PIONEER else 1)
