"""Orders of a round by straight lines, and by routes around the walls of a map."""

import dataclasses

import pytest
from maps import hall_map
from refinement_fakes import LIBRARY, ROBOT

from ator_ros.actions.base import Goal
from ator_ros.domains.trials import Trial
from ator_ros.evaluation.orders import (
    Lengths,
    OrderChoice,
    along_routes,
    ordered,
    shortest,
    straight,
)
from ator_ros.geometry import Pose
from ator_ros.refinement.order_search import nearest_next
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import RobotState, World

WALLED = dataclasses.replace(ROBOT, grid=hall_map())
"""A robot in a hall with a wall at x = 0, whose door is from y = 2 to 3.2 m."""
BEHIND_THE_WALL = Pose(1.0, -3.0, 0.0)
IN_THE_SAME_ROOM = Pose(-4.0, 0.0, 0.0)
ROUND = Trial(
    World(0.0, RobotState(Pose(-1.0, -3.0, 0.0))),
    TopChain(
        tuple(
            TopCall(LIBRARY["goToPose"], Goal(place), frozenset({"yaw", "order"}))
            for place in (IN_THE_SAME_ROOM, BEHIND_THE_WALL)
        )
    ),
)


@pytest.mark.parametrize("choose", [shortest, nearest_next])
@pytest.mark.parametrize(
    ("lengths", "first"), [(straight, BEHIND_THE_WALL), (along_routes, IN_THE_SAME_ROOM)]
)
def test_only_routes_lead_around_the_wall(
    choose: OrderChoice, lengths: Lengths, first: Pose
) -> None:
    """By hand: the place behind the wall is 2 m away in a straight line, more than 10 by route."""
    chain = ordered(WALLED, ROUND, choose, lengths)
    assert chain.calls[0].goal.pose == first


def test_without_a_map_routes_are_straight_lines() -> None:
    chain = ordered(ROBOT, ROUND, shortest, along_routes)
    assert chain.calls[0].goal.pose == BEHIND_THE_WALL
