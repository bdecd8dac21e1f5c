"""What the page and RViz draw of chains, rings and surroundings."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from view.in_process import InProcessBackend

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.view.backend import Answer
from ator_ros.view.shapes import (
    Arrow,
    Segments,
    costs_by_heading,
    executed_chain_shapes,
    refinement_shapes,
    ring,
    surroundings,
)


@pytest.fixture(scope="module")
def answer() -> Answer:
    answer = InProcessBackend().editor().answer
    assert answer is not None
    return answer


def test_the_ring_is_nearest_where_the_chain_is_fastest_and_marks_the_chosen_heading(answer: Answer) -> None:
    [curve] = answer.curves
    headings, costs = costs_by_heading(curve)
    segments, chosen = ring(answer.chain, curve)
    centre = answer.chain.calls[0].goal.pose
    radii = np.hypot(*(segments.points[:, 0] - (centre.x, centre.y)).T)
    assert len(headings) >= 24
    assert np.all(np.diff(headings) > 0.0)
    assert np.argmin(radii) == np.argmin(costs)
    assert np.argmax(radii) == np.argmax(costs)
    assert segments.colours[np.argmin(costs)] == pytest.approx((0.0, 0.8, 0.0))
    # The mark lies behind the subgoal, on the side that the robot comes from.
    across = chosen.points[0, 1] - (centre.x, centre.y)
    assert math.atan2(*-across[::-1]) == pytest.approx(centre.yaw)
    step = np.diff(headings).max()  # the search looks between these headings as well
    assert headings[np.argmin(costs)] == pytest.approx(centre.yaw, abs=step)


def test_area_lines_of_the_domain_and_bays_surround_them() -> None:
    ruled = dataclasses.replace(SOCCER, lines=lambda _: [[(0.0, -3.0), (0.0, 3.0)]])
    assert [drawn.name for drawn in surroundings(ruled, SOCCER.robot())][:2] == ["area", "line0"]


def test_without_searched_headings_there_is_no_ring(answer: Answer) -> None:
    speeds = SubgoalCurve(0, ("speed",), np.array([[0.0], [0.5], [1.0]]), np.array([3.0, 2.0, 4.0]))
    assert ring(answer.chain, speeds) == ()
    endless = SubgoalCurve(0, ("yaw",), np.zeros((4, 1)), np.full(4, np.inf))
    assert ring(answer.chain, endless) == ()


def test_naive_is_grey_and_the_chain_to_execute_is_coloured(answer: Answer) -> None:
    start = answer.chain.calls[1].goal.pose
    shapes = {each.name: each for each in refinement_shapes(start, answer.naive, answer.chain, answer.curves)}
    grey, blue = shapes["naive/subgoal0"], shapes["chain/subgoal0"]
    assert isinstance(grey, Arrow)
    assert isinstance(blue, Arrow)
    assert np.ptp(grey.colour) < 0.1 < np.ptp(blue.colour)
    assert (grey.pose, blue.pose) == tuple(chain.calls[0].goal.pose for chain in (answer.naive, answer.chain))
    legs = shapes["chain/legs"]
    assert isinstance(legs, Segments)
    assert len(legs.points) == 2
    _, first, second = executed_chain_shapes(start, answer.chain, 1)
    assert isinstance(first, Arrow)
    assert isinstance(second, Arrow)
    assert first.colour == blue.colour != second.colour
