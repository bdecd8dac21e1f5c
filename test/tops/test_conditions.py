"""Conditions: statements on variables and relations between places."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.actions.base import Goal, Point
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.schema import SchemaError
from ator_ros.tops.conditions import (
    Bearing,
    Clause,
    Condition,
    Distance,
    Region,
    Term,
    arrived,
    state_of,
    state_variables,
)
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
PLAIN = dataclasses.replace(ROBOT, holder=None)
CUP = {"cup": ObjectState(3.0, 4.0, 0.5, -0.5)}
WORLD = World(0.0, RobotState(Pose(1.0, 2.0, math.pi / 2.0), 0.3, -0.2), CUP)
coordinates = st.floats(-20.0, 20.0)
angles = st.floats(-math.pi, math.pi)


# ---- state variables -----------------------------------------------------------------------------


def test_the_state_of_a_world_has_the_named_variables() -> None:
    state = state_of(WORLD, ROBOT)
    assert tuple(state) == state_variables(["cup"])
    assert tuple(state_of(WORLD, PLAIN)) == state_variables(["cup"], holder=False)
    robot = {
        "robot.x": 1.0,
        "robot.y": 2.0,
        "robot.yaw": math.pi / 2.0,
        "robot.vx": 0.3,
        "robot.vy": 0.0,
    }
    cup = {"cup.x": 3.0, "cup.y": 4.0, "cup.vx": 0.5, "cup.vy": -0.5}
    hold = {"hold.x": 1.0, "hold.y": 2.0 + ROBOT.hold}
    assert state == pytest.approx({**robot, "robot.w": -0.2, **hold, **cup})


@given(coordinates, coordinates, angles, st.floats(0.0, 1.0), st.sampled_from(Point))
def test_a_robot_that_has_arrived_is_at_its_goal(
    x: float, y: float, yaw: float, speed: float, point: Point
) -> None:
    there = arrived(WORLD, Goal(Pose(x, y, yaw), speed, point), ROBOT)
    state = state_of(there, ROBOT)
    at = "hold" if point is Point.HOLD else "robot"
    assert (state[f"{at}.x"], state[f"{at}.y"]) == pytest.approx((x, y))
    assert (state["robot.yaw"], state["robot.vx"], state["robot.w"]) == (yaw, speed, 0.0)
    assert there.objects == WORLD.objects


# ---- statements ----------------------------------------------------------------------------------


@given(coordinates, coordinates, st.floats(0.0, 3.0))
def test_a_term_holds_up_to_its_tolerance(value: float, target: float, tolerance: float) -> None:
    term = Term("cup.x", "goal.x", tolerance)
    state, goal = {"cup.x": value}, {"x": target}
    clearance = term.clearance(state, goal)
    assert clearance == pytest.approx(tolerance - abs(value - target))
    assert term.excess(state, goal) == max(0.0, -clearance)
    assert (term.violation(state, goal) is None) == (clearance >= 0.0)
    assert term.is_at_target
    assert term.offset == 0.0


@given(angles, angles)
def test_headings_are_compared_the_shorter_way_round(yaw: float, target: float) -> None:
    term = Term("robot.yaw", target, 0.0)
    apart = math.acos(max(-1.0, min(1.0, math.cos(yaw - target))))
    assert -term.clearance({"robot.yaw": yaw}, {}) == pytest.approx(apart, abs=1e-6)


@pytest.mark.parametrize(
    ("region", "reach", "is_at_target", "offset"),
    [
        (Region("cup.x", 1.0, -0.5, 2.0), (-0.5, 2.0), True, 0.0),
        (Region("cup.x", 1.0, 0.0, 2.0), (0.0, 2.0), True, 0.0),
        (Region("cup.x", 1.0, -2.0, 0.0), (-2.0, 0.0), True, 0.0),
        (Region("cup.x", 1.0, 0.5, 2.0), (0.5, 2.0), False, 0.5),
        (Region("cup.x", 1.0, -2.0, -0.5), (-2.0, -0.5), False, -0.5),
        (Region("cup.x", 1.0, 0.5), (0.5, math.inf), False, 0.5),
        (Region("cup.x", 1.0), (-math.inf, math.inf), False, 0.0),
        (Region("cup.x", 1.0, -1.0), (-1.0, math.inf), False, 0.0),
        (Region("cup.x", 1.0, high=1.0), (-math.inf, 1.0), False, 0.0),
    ],
)
def test_a_region_reaches_from_its_least_to_its_greatest_difference(
    region: Region, reach: tuple[float, float], is_at_target: bool, offset: float
) -> None:
    assert region.reach(1.0) == reach
    assert region.is_at_target is is_at_target
    assert region.offset == offset
    assert region.bounds
    assert not dataclasses.replace(region, target="goal.x").bounds


@given(st.floats(0.1, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 2.0), st.floats(-5.0, 5.0))
def test_outward_regions_are_mirrored_at_their_center(
    away: float, low: float, width: float, center: float
) -> None:
    region = Region("cup.x", "goal.x", low, low + width, outward=True, center=center)
    for value in np.linspace(-2.0, 8.0, 7):
        one = region.clearance({"cup.x": center + value}, {"x": center + away})
        other = region.clearance({"cup.x": center - value}, {"x": center - away})
        assert one == pytest.approx(other, abs=1e-9)
        assert one == pytest.approx(min(value - away - low, low + width - value + away), abs=1e-9)


@pytest.mark.parametrize(
    ("clause", "text"),
    [
        (Term("cup.x", "goal.x", 0.25), "cup.x within 0.25 of goal.x"),
        (Region("cup.x", 1.5, 0.0, 2.0), "cup.x 0 to 2 of 1.5"),
        (Region("cup.x", "goal.x", 0.0, 2.0, outward=True), "cup.x 0 to 2 outward of goal.x"),
        (Distance("cup", "goal", 0.5, 2.0), "distance from cup to goal 0.5 to 2 m"),
        (Bearing("cup", "goal", math.pi / 4), "bearing of cup from goal within 45 degrees"),
    ],
)
def test_violations_quote_the_clause(clause: Clause, text: str) -> None:
    assert str(clause) == text
    unknown = clause.violation({}, {"x": 0.0, "y": 0.0})
    assert unknown == f"expected {text}, but one of them is unknown"
    assert clause.excess({}, {"x": 0.0, "y": 0.0}) == math.inf
    state = {"cup.x": -9.0, "cup.y": 0.0}
    violation = clause.violation(state, {"x": 0.0, "y": 0.0})
    assert str(violation).startswith(
        f"expected {text}, it is {clause.excess(state, {'x': 0.0, 'y': 0.0}):.3g} "
    )


@pytest.mark.parametrize(
    ("target", "value"),
    [(2.5, 2.5), ("goal.x", 1.0), ("cup.y", 4.0), ("goal.lift", None), ("cup.z", None)],
)
def test_targets_are_numbers_goal_variables_or_state_variables(
    target: float | str, value: float | None
) -> None:
    state = {"cup.x": 3.0, "cup.y": 4.0}
    assert Term("cup.x", target, 0.1).target_in(state, {"x": 1.0}) == value


# ---- relations -----------------------------------------------------------------------------------


@given(coordinates, coordinates, st.floats(0.0, 2.0), st.floats(0.0, 3.0))
def test_the_clearance_of_a_distance_is_the_way_to_its_edge(
    x: float, y: float, low: float, width: float
) -> None:
    relation = Distance("cup", "goal", low, low + width)
    apart = math.hypot(x - 1.0, y + 2.0)
    inner = apart - low if low > 0.0 else math.inf
    clearance = relation.clearance({"cup.x": x, "cup.y": y}, {"x": 1.0, "y": -2.0})
    assert clearance == pytest.approx(min(inner, low + width - apart), abs=1e-9)
    assert relation.places == ("cup", "goal")


def test_a_distance_without_a_least_one_has_no_inner_edge() -> None:
    near = {"cup.x": 0.1, "cup.y": 0.0}
    origin = {"x": 0.0, "y": 0.0}
    assert Distance("cup", "goal", 0.0, 2.0).clearance(near, origin) == pytest.approx(1.9)
    assert Distance("cup", "goal", 0.05, 2.0).clearance(near, origin) == pytest.approx(0.05)


@pytest.mark.parametrize("missing", ["cup.x", "cup.y", "x", "y"])
def test_relations_of_unknown_places_have_no_clearance(missing: str) -> None:
    state, goal = {"cup.x": 0.0, "cup.y": 0.0}, {"x": 1.0, "y": 0.0}
    state.pop(missing, None)
    goal.pop(missing, None)
    assert Distance("cup", "goal").clearance(state, goal) is None
    assert Bearing("cup", "goal", 1.0).clearance(state, goal) is None


@given(st.floats(0.1, 5.0), angles, st.floats(0.1, math.pi / 2.0), angles)
def test_the_clearance_of_a_bearing_is_the_way_to_the_edge_of_its_sector(
    distance: float, direction: float, most: float, axis: float
) -> None:
    relation = Bearing("cup", "robot", most, axis)
    state = {
        "cup.x": distance * math.cos(direction),
        "cup.y": distance * math.sin(direction),
        "robot.x": 0.0,
        "robot.y": 0.0,
    }
    off = math.acos(max(-1.0, min(1.0, math.cos(direction - axis))))
    left = most - off
    expected = distance * math.sin(max(-math.pi / 2.0, min(math.pi / 2.0, left)))
    assert relation.clearance(state, {}) == pytest.approx(expected, abs=1e-5)


@given(coordinates, coordinates, st.floats(0.1, 4.0))
def test_mirrored_bearings_are_mirrored_at_their_center(dx: float, dy: float, away: float) -> None:
    relation = Bearing("cup", "goal", 1.0, math.pi, mirrored=True, center=2.0)

    def clearance(side: float) -> float:
        origin = 2.0 + side * away
        return float(
            relation.clearance({"cup.x": origin + side * dx, "cup.y": dy}, {"x": origin, "y": 0.0})
        )

    assert clearance(1.0) == pytest.approx(clearance(-1.0), abs=1e-9)
    fixed = dataclasses.replace(relation, mirrored=False)
    there = {"cup.x": 2.0 - away - 1.0, "cup.y": 0.0}
    assert fixed.clearance(there, {"x": 2.0 - away, "y": 0.0}) > 0.0
    assert relation.clearance(there, {"x": 2.0 - away, "y": 0.0}) < 0.0


def test_at_the_center_the_axis_is_not_mirrored() -> None:
    relation = Bearing("cup", "goal", 1.0, 0.0, mirrored=True, center=2.0)
    assert relation.clearance({"cup.x": 3.0, "cup.y": 0.0}, {"x": 2.0, "y": 0.0}) > 0.0


def test_relations_take_arrays_of_places() -> None:
    x = np.array([0.0, 1.0, 2.0])
    goal = {"x": 0.0, "y": 0.0}
    state = {"cup.x": x, "cup.y": 0.0 * x}
    assert Distance("cup", "goal", 0.5, 1.5).clearance(state, goal) == pytest.approx(
        [-0.5, 0.5, -0.5]
    )
    assert Term("cup.x", 1.0, 0.5).clearance(state, goal) == pytest.approx([-0.5, 0.5, -0.5])
    assert Bearing("cup", "goal", 1.0).clearance(state, goal)[1:].min() > 0.0


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: Distance("cup", "goal", -0.1, 1.0), "expected 0 <= low <= high"),
        (lambda: Distance("cup", "goal", 2.0, 1.0), "expected 0 <= low <= high"),
        (lambda: Bearing("cup", "goal", 0.0), "expected an angle above 0"),
        (lambda: Bearing("cup", "goal", 1.6), "at most pi / 2"),
        (lambda: Region("cup.x", 0.0, 1.0, 0.5), "expected low <= high"),
    ],
)
def test_empty_ranges_are_rejected(make: object, expected: str) -> None:
    with pytest.raises(SchemaError, match=expected):
        make()  # type: ignore[operator]


def test_ranges_of_one_value_are_ranges() -> None:
    assert Distance("cup", "goal", 1.0, 1.0).high == 1.0
    assert Distance("cup", "goal", 0.0, 0.0).high == 0.0
    assert Bearing("cup", "goal", math.pi / 2.0).most == math.pi / 2.0
    assert Region("cup.x", 0.0, 1.0, 1.0).low == 1.0


# ---- conditions ----------------------------------------------------------------------------------

BOTH = Condition(
    (Term("cup.x", "goal.x", 0.1), Region("tray.y", "hold.y", 1.0, 2.0)),
    (Distance("cup", "robot", 0.0, 5.0),),
)


def test_a_condition_names_what_it_is_about() -> None:
    assert BOTH.goal_names() == {"x"}
    assert BOTH.things() == {"cup", "goal", "tray", "hold", "robot"}
    assert BOTH.objects() == {"cup", "tray"}
    assert Condition((Term("robot.x", 2.0, 0.1),)).things() == {"robot"}
    assert Condition().objects() == frozenset()


def test_each_violated_clause_is_reported_and_the_worst_counts() -> None:
    state = {
        "cup.x": 1.0,
        "cup.y": 0.0,
        "tray.y": 1.5,
        "hold.y": 0.0,
        "robot.x": 0.0,
        "robot.y": 0.0,
    }
    assert BOTH.violations(state, {"x": 1.0}) == []
    assert BOTH.shortfall(state, {"x": 1.0}) == 0.0
    wrong = {**state, "tray.y": 2.5, "cup.x": 7.0}
    assert len(BOTH.violations(wrong, {"x": 6.5})) == 3
    assert BOTH.shortfall(wrong, {"x": 6.5}) == pytest.approx(2.0)
    assert BOTH.shortfall({}, {}) == math.inf
    assert Condition().shortfall({}, {}) == 0.0


def test_applied_conditions_hold_with_each_variable_as_near_its_target_as_may_be() -> None:
    state = {"hold.y": -1.0, "tray.y": 9.0, "cup.y": 3.0}
    after = BOTH.apply(state, {"x": 2.0})
    assert after == {"hold.y": -1.0, "tray.y": 0.0, "cup.y": 3.0, "cup.x": 2.0}
    assert state["tray.y"] == 9.0
    assert BOTH.apply({}, {}) == {}


@given(st.floats(-5.0, 5.0), st.floats(-3.0, 3.0), st.floats(0.0, 2.0), st.booleans())
def test_a_region_holds_after_it_is_applied(
    target: float, low: float, width: float, outward: bool
) -> None:
    region = Condition((Region("cup.x", "goal.x", low, low + width, outward=outward, center=1.0),))
    after = region.apply({}, {"x": target})
    assert region.shortfall(after, {"x": target}) == pytest.approx(0.0, abs=1e-9)
    nearest = min(max(0.0, low), low + width)
    assert abs(after["cup.x"] - target) == pytest.approx(abs(nearest))
