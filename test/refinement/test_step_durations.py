"""Predicted durations of steps: from situations, and between all pairs of steps."""

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np
import pytest
from maps import hall_map
from refinement_fakes import ANGLE, NOTHING, ROBOT, USED, FakeModel, call, models, turning_time

from ator_ros.bases.routes import routes_of
from ator_ros.geometry import FloatArray, Pose
from ator_ros.refinement.step_durations import HEADINGS, DurationTable, predict_durations
from ator_ros.tops.chain import AllowedRange, TopCall
from ator_ros.tops.ranges import USUAL_RANGES
from ator_ros.world.state import RobotState, World

AT_REST = 0.4**2 + 0.5**2  # s that `turning_time` adds to drives from rest to rest
START = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))


def pairs(*calls: TopCall) -> FloatArray:
    table = DurationTable.of_pairs([START], calls, models(), robot=ROBOT, ranges=USUAL_RANGES)
    return table.whole().durations


def test_by_hand_open_headings_cost_no_turn_between_stations() -> None:
    """Along a line in a direction of the grid the robot turns at the start only."""
    stops = [call("goToPose", 0.0, y, 0.0, ANGLE) for y in (1.0, 3.0)]
    quarter = 1.3 * math.pi / 2.0
    expected = [[1.0 + quarter, 3.0 + quarter], [0.0, 2.0], [2.0, 0.0]]
    at_rest = AT_REST * np.array([[1, 1], [0, 1], [1, 0]])
    assert pairs(*stops) == pytest.approx(np.array(expected) + at_rest)


def test_by_hand_given_headings_are_kept() -> None:
    stops = [call("goToPose", 0.0, y, 0.0) for y in (1.0, 3.0)]
    between = 2.0 + 2.3 * math.pi / 2.0 + AT_REST
    assert pairs(*stops)[1:] == pytest.approx(np.array([[0.0, between], [between, 0.0]]))


def test_each_entry_is_the_least_over_the_headings_at_both_ends() -> None:
    rng = np.random.default_rng(1)
    stops = [call("goToPose", *map(float, rng.uniform(-4, 4, 2)), 0.3, ANGLE) for _ in range(3)]
    stops[1] = dataclasses.replace(stops[1], open=NOTHING)
    limited = (AllowedRange("yaw", 1.0, 1.5), AllowedRange("yaw", 3.0, 3.0))
    stops[2] = dataclasses.replace(stops[2], allowed=limited)
    options = []
    for stop in stops:
        domain = stop.range_of("yaw", ROBOT, USUAL_RANGES)
        assert domain is not None
        options.append(domain.grid(HEADINGS)[0].tolist() if stop.opens("yaw") else [0.3])
    turned = [
        [call("goToPose", *stop.goal.pose[:2], yaw) for yaw in yaws]
        for stop, yaws in zip(stops, options, strict=True)
    ]
    found = pairs(*stops)
    for row, column in itertools.product(range(3), repeat=2):
        if row == column:
            assert found[1 + row, column] == 0.0
            continue
        worlds = [World(0.0, RobotState(each.goal.pose)) for each in turned[row]]
        all_headings = predict_durations(worlds, turned[column], models()).durations
        assert found[1 + row, column] == pytest.approx(all_headings.min())
    from_start = predict_durations([START], turned[0], models()).durations
    assert found[0, 0] == pytest.approx(from_start.min())


def test_parts_are_those_of_the_whole_table() -> None:
    known = {"goToPose": FakeModel(turning_time, USED, spread=0.2)}
    calls = [
        call("goToPose", 1.0, 1.0, 0.0, ANGLE),
        call("goToPose", 2.0, 0.0, 0.0),
        call("goToPose", -1.0, 2.0, 1.0),
    ]
    table = DurationTable.of_pairs([START] * 2, calls, known, robot=ROBOT, ranges=USUAL_RANGES)
    whole = table.whole()
    assert table.shape == whole.durations.shape == (5, 3)
    assert whole.spreads[0, 0] == 0.2
    assert (whole.spreads[2, 0], whole.success[2, 0]) == (0.0, 1.0)
    for first, last in itertools.combinations(range(6), 2):
        for part, values in zip(table.part(2, first, last), whole, strict=True):
            assert part == pytest.approx(values[first:last, 2])


def test_the_table_asks_a_planner_once_for_each_pair_of_places() -> None:
    asked = []

    def planner(start: tuple[float, float], goal: tuple[float, float]) -> FloatArray:
        asked.append((start, goal))
        return np.array([start, goal])

    robot = dataclasses.replace(ROBOT, grid=dataclasses.replace(hall_map(), planner=planner))
    routes = routes_of(robot)
    assert routes is not None

    def route_length(direct: Mapping[str, FloatArray]) -> FloatArray:
        return routes.between(*(direct[name] for name in ("x", "y", "xg", "yg"))).length

    known = {"goToPose": FakeModel(route_length, USED)}
    places = [(float(x), float(y)) for x in (-3.0, 1.0, 3.0) for y in (-2.0, 2.0)]
    stops = [call("goToPose", x, y, 0.0, ANGLE) for x, y in places]
    start = World(0.0, RobotState(Pose(-1.0, 1.0, 0.0)))

    def table() -> FloatArray:
        made = DurationTable.of_pairs([start], stops, known, robot=robot, ranges=USUAL_RANGES)
        return made.whole().durations

    found = table()
    lines = [[math.dist(one, other) for other in places] for one in [(-1.0, 1.0), *places]]
    assert found == pytest.approx(np.array(lines))
    expected = {(one, other) for one in [(-1.0, 1.0), *places] for other in places if one != other}
    assert set(asked) == expected
    assert len(asked) == len(expected)
    table()
    assert len(asked) == len(expected)
