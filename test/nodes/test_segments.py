"""Shapes of chains, rings and surroundings for the page and RViz."""

import dataclasses
import math

import numpy as np
import pytest
from maps import hall_map
from view.in_process import InProcessBackend
from visualization_msgs.msg import Marker

from ator_ros.actions.base import Goal
from ator_ros.actions.goal_variables import ORDER, STOP, with_values
from ator_ros.domains.drive import DRIVE
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes.drawing import marker_array
from ator_ros.nodes.segments import (
    Label,
    costs_by_heading,
    executed_chain_shapes,
    refinement_shapes,
    ring,
    route_line,
    station_labels,
    surroundings,
    walls,
)
from ator_ros.refinement.refiner import SubgoalCurve
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.view.runs import Answer


@pytest.fixture(scope="module")
def answer() -> Answer:
    answer = InProcessBackend().editor().answer
    assert answer is not None
    return answer


def test_the_ring_is_nearest_at_the_best_heading_and_marks_the_chosen_one(answer: Answer) -> None:
    [curve] = answer.curves
    headings, costs = costs_by_heading(curve)
    segments, chosen = ring(answer.chain, curve)
    center = answer.chain.calls[0].goal.pose
    radii = np.hypot(*(segments.points[:, 0] - (center.x, center.y)).T)
    assert len(headings) >= 24
    assert np.all(np.diff(headings) > 0.0)
    assert np.argmin(radii) == np.argmin(costs)
    assert np.argmax(radii) == np.argmax(costs)
    assert segments.colors[np.argmin(costs)] == pytest.approx((0.0, 0.8, 0.0))
    # The mark is behind the subgoal, on the side of the approach.
    across = chosen.points[0, 1] - (center.x, center.y)
    assert math.atan2(*-across[::-1]) == pytest.approx(center.yaw)
    step = np.diff(headings).max()  # the search also refines between these headings
    assert headings[np.argmin(costs)] == pytest.approx(center.yaw, abs=step)


def test_surroundings_are_area_domain_lines_and_bays() -> None:
    ruled = dataclasses.replace(SOCCER, lines=lambda _: [[(0.0, -3.0), (0.0, 3.0)]])
    assert [drawn.name for drawn in surroundings(ruled, SOCCER.robot())][:2] == ["area", "line0"]


def test_without_searched_headings_there_is_no_ring(answer: Answer) -> None:
    speeds = SubgoalCurve(0, ("speed",), np.array([[0.0], [0.5], [1.0]]), np.array([3.0, 2.0, 4.0]))
    assert ring(answer.chain, speeds) == ()
    endless = SubgoalCurve(0, ("yaw",), np.zeros((4, 1)), np.full(4, np.inf))
    assert ring(answer.chain, endless) == ()


def test_naive_is_gray_and_the_chain_to_execute_is_colored(answer: Answer) -> None:
    start = answer.chain.calls[1].goal.pose
    shapes = {
        each.name: each
        for each in refinement_shapes(start, answer.naive, answer.chain, answer.curves)
    }
    gray, blue = shapes["naive/subgoal0"], shapes["chain/subgoal0"]
    assert np.ptp(gray.colors[0]) < 0.1 < np.ptp(blue.colors[0])
    for arrow, chain in ((gray, answer.naive), (blue, answer.chain)):
        pose = chain.calls[0].goal.pose
        assert arrow.points[0, 0] == pytest.approx(pose[:2])
        assert math.atan2(*np.diff(arrow.points[0], axis=0)[0, ::-1]) == pytest.approx(pose.yaw)
    assert len(shapes["chain/legs"].points) == 2
    _, first, second = executed_chain_shapes(start, answer.chain, 1)
    assert np.array_equal(first.colors, blue.colors)
    assert not np.array_equal(second.colors, blue.colors)


def test_stations_have_their_numbers_as_sent_and_their_places_in_the_order() -> None:
    library = DRIVE.library(DRIVE.robot())
    opened = frozenset({ORDER})
    calls = [TopCall(library["goToPose"], Goal(Pose(x, 0.0, 0.0)), opened) for x in range(23)]
    sent = TopChain(tuple(calls))
    assert [label.text for label in station_labels(sent)] == [str(n) for n in range(1, 24)]
    order = (1, 0, *range(3, 11), 2, *range(12, 23), 11)
    labels = station_labels(sent.reordered(order))
    assert [label.text for label in labels[:4]] == ["2 (1st)", "1 (2nd)", "4 (3rd)", "5 (4th)"]
    assert [label.text for label in (labels[10], labels[-1])] == ["3 (11th)", "12 (23rd)"]
    assert [(label.name, label.x) for label in labels[:2]] == [("station1", 1.0), ("station0", 0.0)]
    given = sent.part(0)
    assert station_labels(given) == []  # its order is not open
    passing = given.with_goal(1, with_values(given.calls[1].goal, {STOP: 0.0}))
    assert [label.text for label in station_labels(passing)][:3] == ["1", "2 passed", "3"]


def test_a_label_is_a_text_above_its_place() -> None:
    cleared, text = marker_array(
        [], "chain", "map", [Label("station3", "4 (2nd)", 1.0, 2.0)]
    ).markers
    assert cleared.action == Marker.DELETEALL
    assert (text.type, text.text) == (Marker.TEXT_VIEW_FACING, "4 (2nd)")
    assert (text.pose.position.x, text.pose.position.y) == (1.0, 2.0)
    assert text.pose.position.z > 0.0
    assert text.scale.z > 0.0


def test_routes_lead_around_the_walls_of_the_map() -> None:
    robot = dataclasses.replace(DRIVE.robot(), grid=hall_map())
    start, goal = Pose(-3.0, 0.0, 0.0), Pose(3.0, 0.0, 0.0)
    assert len(route_line(start, goal, robot)) > 2
    assert route_line(start, goal, DRIVE.robot()).tolist() == [[-3.0, 0.0], [3.0, 0.0]]
    outlines = walls(robot).points
    assert len(outlines) % 4 == 0
    assert np.abs(outlines[..., 0]).max() > 5.0
    assert not len(walls(DRIVE.robot()).points)
