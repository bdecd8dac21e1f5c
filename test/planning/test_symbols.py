"""Facts and symbolic problems of planning, on a small domain with a cup and a tray."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.actions.base import Goal, Point
from ator_ros.actions.goal_variables import goal_values
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.planning import facts, problem
from ator_ros.planning.facts import Fact, Value
from ator_ros.planning.goals import (
    MOST_STATEMENTS,
    PlanningError,
    Unspecified,
    check_goal,
    statement_from,
)
from ator_ros.planning.problem import Operator, PlannedStep, PlanningProblem
from ator_ros.tops.chain import Top, TopCall, projected
from ator_ros.tops.conditions import Condition, Distance, Region, Statement, Term, state_of
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
AT_GOAL = (
    Term("robot.x", "goal.x", 0.1),
    Term("robot.y", "goal.y", 0.1),
    Term("robot.yaw", "goal.yaw", 0.2),
)
CUP_AT_GOAL = (Term("cup.x", "goal.x", 0.3), Term("cup.y", "goal.y", 0.3))
HELD = (Term("hold.x", "cup.x", 0.1), Term("hold.y", "cup.y", 0.1))
DRIVE = Top("drive", "go", Condition(), Condition(AT_GOAL))
FETCH = Top("fetch", "go", Condition(CUP_AT_GOAL), Condition(HELD), Point.HOLD)
CUP_HELD = (Term("cup.x", "hold.x", 0.1), Term("cup.y", "hold.y", 0.1))
CARRY_POST = (Term("hold.x", "goal.x", 0.05), Term("hold.y", "goal.y", 0.05), *CUP_HELD)
CARRY = Top("carry", "push", Condition(HELD), Condition(CARRY_POST), Point.HOLD)
NEAR = Condition(HELD, (Distance("cup", "goal", 0.5, 2.0),))
THROW = Top("throw", "push", NEAR, Condition(CUP_AT_GOAL), Point.HOLD)
OPEN = Top("open", "lift", Condition(), Condition((Term("tray.x", 1.0, 0.1),)))
TOPS = (DRIVE, FETCH, CARRY, THROW)
WORLD = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {"cup": ObjectState(3.0, 1.0)})
STATE = state_of(WORLD, ROBOT)
coordinates = st.floats(-5.0, 5.0)


# ---- values after a TOP --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "nominal"),
    [(-1.0, 2.0, 0.0), (0.5, 2.0, 0.5), (-2.0, -0.5, -0.5), (0.0, math.inf, 0.0)],
)
def test_projections_are_as_near_to_the_symbol_as_the_range_allows(
    low: float, high: float, nominal: float
) -> None:
    assert Value("cup.x", low, high).nominal == nominal


def test_a_drive_changes_the_robot_within_its_tolerances() -> None:
    values = facts.after(DRIVE, {"x": 1.0, "yaw": 0.5})
    assert values["robot.x"] == Value(1.0, -0.1, 0.1)
    assert values["robot.yaw"] == Value(0.5, -0.2, 0.2)
    assert values["robot.vx"] == Value(0.0, -math.inf, math.inf)
    assert values["robot.w"] == Value(0.0, -math.inf, math.inf)
    assert facts.is_chosen(values["robot.y"].symbol)
    assert not facts.is_chosen(values["robot.x"].symbol)
    assert not facts.is_chosen("cup.x")
    assert values["hold.x"].symbol != values["robot.x"].symbol  # it also depends on the heading
    assert "cup.x" not in values
    assert facts.after(DRIVE, {"speed": 0.5})["robot.vx"].symbol == 0.5


def test_what_is_placed_relative_to_what_moved_has_both_tolerances() -> None:
    values = facts.after(CARRY, {"x": 1.0, "y": 2.0})
    assert values["hold.x"] == Value(1.0, -0.05, 0.05)
    behind = Condition((*CARRY_POST[:2], Region("cup.x", "hold.x", 0.5, 1.0)))
    values = facts.after(dataclasses.replace(CARRY, post=behind), {"x": 1.0})
    assert values["cup.x"] == Value(1.0, 0.45, 1.05)
    values = facts.after(OPEN, {})
    assert values == {"tray.x": Value(1.0, -0.1, 0.1)}


@pytest.mark.parametrize(
    ("variable", "value", "target", "expected"),
    [
        ("cup.x", 3.0, 1.0, 2.0),
        ("cup.x", "tray.x", "tray.x", 0.0),
        ("cup.x", "tray.x", 1.0, None),
        ("cup.x", 1.0, "tray.x", None),
        ("robot.yaw", 3.0, -3.0, 6.0 - 2.0 * math.pi),
        ("cup.x", 3.0, -3.0, 6.0),
    ],
)
def test_symbols_differ_by_a_number_or_in_an_unknown_way(
    variable: str, value: float | str, target: float | str, expected: float | None
) -> None:
    found = facts.difference(variable, Value(value), Value(target))
    assert found == (None if expected is None else pytest.approx(expected))


# ---- facts ---------------------------------------------------------------------------------------


@given(
    st.sampled_from([DRIVE, FETCH, CARRY, THROW, OPEN]),
    st.tuples(coordinates, coordinates, st.floats(-3.0, 3.0)),
    st.sampled_from(
        ["robot.x", "robot.y", "robot.yaw", "robot.vx", "hold.x", "cup.x", "cup.y", "tray.x"]
    ),
    st.floats(-5.0, 5.0),
    st.floats(0.0, 3.0),
    st.booleans(),
)
def test_facts_that_hold_after_a_top_hold_in_the_projected_world(
    top: Top,
    place: tuple[float, float, float],
    variable: str,
    target: float,
    tolerance: float,
    surely: bool,
) -> None:
    goal = Goal(Pose(*place), 0.0, top.point)
    fact = Fact(Term(variable, target, tolerance), surely=surely)
    values = facts.after(top, goal_values(goal))
    if fact.holds_after(values):
        objects = {**WORLD.objects, "tray": ObjectState(0.0, 0.0)}
        world = dataclasses.replace(WORLD, objects=objects)
        after = projected(world, TopCall(top, goal), ROBOT)
        assert fact.clause.excess(state_of(after, ROBOT), {}) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("clause", "surely", "holds"),
    [
        (Term("robot.x", 1.0, 0.1), True, True),
        (Term("robot.x", 1.05, 0.1), True, False),
        (Term("robot.x", 1.05, 0.15), True, True),
        (Term("robot.x", 0.95, 0.15), True, True),
        (Term("robot.x", 0.95, 0.1), True, False),
        (Term("robot.x", 1.05, 0.1), False, True),
        (Term("robot.x", 1.2, 0.1), False, False),
        (Term("robot.x", 0.8, 0.1), False, False),
        (Region("robot.x", 0.5, 0.4, 0.6), True, True),
        (Region("robot.x", 0.5, 0.45, 0.6), True, False),
        (Region("robot.x", 0.5, 0.4, 0.55), True, False),
        (Region("robot.x", 0.5, 0.45, 0.55), False, True),
        (Region("robot.x", 1.5, 0.4, 0.6, outward=True), False, False),
        (Term("robot.vx", 0.0, 0.1), True, False),  # no condition bounds it
        (Term("robot.vx", 0.0, 0.1), False, True),
        (Term("robot.x", "cup.x", 9.0), False, False),
        (Term("cup.x", "cup.x", 0.1), True, True),
        (Distance("robot", "goal", 0.0, 1.0), False, True),
        (Distance("robot", "goal", 1.0, 2.0), False, False),
        (Distance("robot", "cup", 0.0, 9.0), False, False),
    ],
)
def test_a_fact_holds_surely_within_all_tolerances_or_as_projected(
    clause: Statement | Distance, surely: bool, holds: bool
) -> None:
    values = facts.after(DRIVE, {"x": 1.0, "y": 0.0, "yaw": 0.0})
    fact = Fact(clause, (("x", 1.2), ("y", 0.3)), surely=surely)
    assert fact.holds_after(values) is holds


def test_a_fact_of_a_region_holds_when_its_thing_is_moved_there() -> None:
    fact = Fact(Distance("cup", "goal", 0.5, 2.0), (("x", "place.x"),), region="here")
    assert fact.holds_after({"cup.x": Value("here.x")})
    assert not fact.holds_after({"cup.x": Value("there.x")})
    assert not fact.holds_after({"robot.x": Value("here.x")})
    assert not dataclasses.replace(fact, region="").holds_after({"cup.x": Value("here.x")})


@pytest.mark.parametrize(
    ("fact", "depends"),
    [
        (Fact(Term("robot.x", 1.0, 0.1)), {"robot.x"}),
        (Fact(Term("hold.x", "cup.x", 0.1)), {"hold.x", "cup.x"}),
        (Fact(Term("cup.x", "goal.x", 0.1), (("x", 2.0),)), {"cup.x"}),
        (Fact(Term("cup.x", "goal.x", 0.1), (("x", "tray.x"),)), {"cup.x", "tray.x"}),
        (Fact(Distance("cup", "goal"), (("x", 2.0),)), {"cup.x", "cup.y"}),
    ],
)
def test_a_fact_depends_on_state_variables(fact: Fact, depends: set[str]) -> None:
    assert fact.depends == depends


def test_facts_are_checked_in_a_state_and_print_their_targets() -> None:
    fact = Fact(Term("cup.x", "goal.x", 0.1), (("x", "tray.x"),))
    assert fact.violation({"cup.x": 1.0, "tray.x": 1.05}) is None
    assert fact.violation({"cup.x": 1.0, "tray.x": 1.5})
    assert fact.violation({"cup.x": 1.0})
    assert str(fact) == "cup.x within 0.1 of tray.x"
    assert str(Fact(fact.clause, (("x", 2.0),))) == "cup.x within 0.1 of 2"
    assert str(Fact(fact.clause, (("x", "chosen x of carry"),))) == "cup.x within 0.1 of goal.x"
    assert str(Fact(fact.clause)) == "cup.x within 0.1 of goal.x"
    assert str(Fact(Term("cup.x", 0.25, 0.1))) == "cup.x within 0.1 of 0.25"
    assert str(Fact(Distance("cup", "goal"))) == str(Distance("cup", "goal"))
    assert facts.resolved({"x": 1.0, "y": "cup.y", "yaw": "chosen yaw"}, {"cup.y": 2.0}) == {
        "x": 1.0,
        "y": 2.0,
    }


def test_preconditions_are_clauses_about_bound_variables_that_may_fail() -> None:
    needs = facts.preconditions(FETCH, {"x": 1.0, "y": 2.0})
    assert [fact.clause for fact in needs] == list(CUP_AT_GOAL)
    assert needs[0].binding == (("x", 1.0),)
    assert needs[0].region == needs[1].region == "place of cup for fetch (x 1.0, y 2.0)"
    assert [fact.clause for fact in facts.preconditions(FETCH, {"x": 1.0})] == [CUP_AT_GOAL[0]]
    assert facts.preconditions(FETCH, {"x": "cup.x", "y": "cup.y"}) == []
    needs = facts.preconditions(THROW, {"x": 1.0, "y": 2.0, "yaw": 0.0})
    assert [fact.clause for fact in needs] == [*HELD, NEAR.relations[0]]
    assert [fact.region for fact in needs] == ["", "", "place of cup for throw (x 1.0, y 2.0)"]
    assert [fact.clause for fact in facts.preconditions(THROW, {"x": 1.0})] == list(HELD)


@pytest.mark.parametrize(
    ("clause", "thing"),
    [
        (Term("cup.x", "goal.x", 0.1), "cup"),
        (Term("cup.y", "goal.y", 0.1), "cup"),
        (Term("robot.yaw", "goal.yaw", 0.1), None),
        (Term("cup.x", "robot.x", 0.1), None),
        (Term("cup.x", 1.0, 0.1), None),
        (Term("robot.yaw", "goal.x", 0.1), None),
        (Distance("cup", "goal"), "cup"),
        (Distance("goal", "cup"), "cup"),
        (Distance("cup", "robot"), None),
    ],
)
def test_clauses_place_things_near_the_goal(
    clause: Statement | Distance, thing: str | None
) -> None:
    assert facts.placed_thing(clause) == thing


# ---- goals ---------------------------------------------------------------------------------------


def test_statements_are_read_with_and_without_tolerance() -> None:
    assert statement_from("cup.x=1.5") == Unspecified("cup.x", 1.5)
    assert statement_from("cup.x=tray.x") == Unspecified("cup.x", "tray.x")
    assert statement_from("cup.x=1:-0.5:2") == Region("cup.x", 1.0, -0.5, 2.0)
    assert statement_from("cup.x=1:0:0") == Region("cup.x", 1.0, 0.0, 0.0)


def test_goals_have_one_to_eight_statements_about_known_variables() -> None:
    known = [f"cup{number}.x" for number in range(9)]
    goal = [Unspecified(name, 1.0) for name in known]
    for count in (1, MOST_STATEMENTS):
        check_goal(goal[:count], known)
    for wrong in ([], goal):
        with pytest.raises(PlanningError, match=r"expected 1 to 8 statements, got [09]"):
            check_goal(wrong, known)
    for statement in (Unspecified("tray.x", 1.0), Unspecified("cup1.x", "tray.x")):
        with pytest.raises(PlanningError, match=r"expected one of cup0\.x, .*got 'tray.x'"):
            check_goal([statement], known)
    check_goal([Unspecified("cup1.x", "cup2.x")], known)


def test_statements_without_tolerance_get_the_smallest_that_a_top_achieves() -> None:
    found = problem.facts_of([Unspecified("cup.x", 2.0), Term("cup.y", 1.0, 0.7)], TOPS)
    assert (found[0].clause.low, found[0].clause.high) == pytest.approx((-0.15, 0.15))
    assert found[0].surely
    assert found[1] == Fact(Term("cup.y", 1.0, 0.7), surely=True)
    (held,) = problem.facts_of([Unspecified("hold.x", "cup.x")], TOPS)
    assert (held.clause.low, held.clause.high) == pytest.approx((-0.1, 0.1))
    (unknown,) = problem.facts_of([Unspecified("tray.x", 2.0)], TOPS)
    assert (unknown.clause.low, unknown.clause.high) == (0.0, 0.0)


# ---- candidate steps -----------------------------------------------------------------------------


def steps_for(*statements: Statement, tops: tuple[Top, ...] = TOPS) -> list[PlannedStep]:
    return problem.steps_for([Fact(statement, surely=True) for statement in statements], tops)


def test_goals_of_candidate_steps_are_objects_goals_and_places_for_later_steps() -> None:
    steps = steps_for(Term("cup.x", 2.0, 0.5), Term("cup.y", -1.0, 0.5))
    at_object = PlannedStep(FETCH, (("x", "cup.x"), ("y", "cup.y")))
    assert at_object in steps
    there = (("x", 2.0), ("y", -1.0))
    assert PlannedStep(CARRY, there) in steps
    assert PlannedStep(THROW, there) in steps
    (placing,) = [step for step in steps if step.region and step.top is CARRY]
    assert [fact.clause for fact in placing.region] == list(NEAR.relations)
    region = "place of cup for throw (x 2.0, y -1.0)"
    assert placing.binding == (("x", f"{region}.x"), ("y", f"{region}.y"))
    assert len(steps) == len(set(steps))


def test_the_robot_drives_to_places_in_the_goal_but_not_to_what_moves_with_it() -> None:
    assert PlannedStep(DRIVE, (("x", 2.0),)) in steps_for(Term("robot.x", 2.0, 0.5))
    assert PlannedStep(DRIVE, (("x", "cup.x"),)) in steps_for(Term("robot.x", "cup.x", 0.5))
    assert not [step for step in steps_for(Term("robot.x", "hold.x", 0.5)) if step.top is DRIVE]
    assert PlannedStep(OPEN) in steps_for(Term("tray.x", 1.0, 0.5), tops=(OPEN,))


# ---- search --------------------------------------------------------------------------------------


def strips(*operators: tuple[str, str, str], initial: str, goal: str) -> PlanningProblem:
    """Return a problem whose facts are letters; operators need, add and delete some."""
    made = tuple(
        Operator(*(frozenset(map(ord, letters)) for letters in parts)) for parts in operators
    )
    start, end = (frozenset(map(ord, letters)) for letters in (initial, goal))
    return PlanningProblem((), (None,) * len(made), made, start, end)


def test_all_shortest_ways_to_a_goal_are_found_shortest_first() -> None:
    found = strips(
        ("a", "b", ""), ("b", "c", ""), ("a", "c", "b"), ("", "z", ""), initial="a", goal="c"
    )
    assert found.plans(9) == [(2,), (0, 1)]
    assert found.plans(1) == [(2,)]
    assert found.useful() == [0, 1, 2]
    assert found.within_reach() == frozenset(map(ord, "abcz"))


def test_a_goal_beyond_reach_has_no_plan() -> None:
    assert strips(("b", "c", ""), initial="a", goal="c").plans(9) == []
    undoes = strips(("a", "b", "a"), ("a", "c", "a"), initial="a", goal="bc")
    assert undoes.goal <= undoes.within_reach()
    assert undoes.plans(9) == []


def test_of_plans_of_one_length_that_which_undoes_less_of_the_goal_is_chosen() -> None:
    found = strips(
        ("", "c", "g"), ("c", "dg", ""), ("", "e", ""), ("e", "d", ""), initial="g", goal="gd"
    )
    assert found.plans(1) == [(2, 3)]


@given(
    st.lists(
        st.tuples(*[st.text("abcd", max_size=2)] * 3),
        min_size=1,
        max_size=5,
    ),
    st.text("abcd", max_size=2),
    st.text("abcd", min_size=1, max_size=2),
)
def test_plans_can_be_executed_and_none_contains_another(
    operators: list[tuple[str, str, str]], initial: str, goal: str
) -> None:
    found = strips(*operators, initial=initial, goal=goal)
    plans = found.plans(20)

    def ends(plan: tuple[int, ...]) -> bool:
        state = found.initial
        for number in plan:
            operator = found.operators[number]
            if not operator.needs <= state:
                return False
            state = (state - operator.deletes) | operator.adds
        return found.goal <= state

    assert all(map(ends, plans))
    assert [len(plan) for plan in plans] == sorted(len(plan) for plan in plans)
    for one, other in itertools.permutations(plans, 2):
        assert not set(one) <= set(other)
    short = [
        plan
        for length in range(4)
        for plan in itertools.product(range(len(operators)), repeat=length)
        if ends(plan)
    ]
    if short:
        assert len(plans[0]) == len(short[0])


def named(found: PlanningProblem, plan: tuple[int, ...]) -> list[str]:
    """Return the names of the TOPs of a plan."""
    return [step.top.name for number in plan if (step := found.steps[number])]


def test_the_problem_of_a_goal_has_what_steps_need_add_and_delete() -> None:
    goal = [Fact(Term("cup.x", 2.0, 0.5), surely=True), Fact(Term("cup.y", -1.0, 0.5), surely=True)]
    found = problem.planning_problem(goal, problem.steps_for(goal, TOPS), STATE)
    assert found.facts[:2] == tuple(goal)
    assert found.goal == {0, 1}
    assert not found.goal & found.initial
    names = {
        step.top.name: operator
        for step, operator in zip(found.steps, found.operators, strict=True)
        if step and not step.region
    }
    held = {number for number, fact in enumerate(found.facts) if fact.clause in HELD}
    assert names["fetch"].adds == held
    assert names["throw"].needs >= held
    assert names["throw"].adds >= found.goal
    assert names["carry"].adds >= found.goal | held
    plans = [named(found, plan) for plan in found.plans(9)]
    assert sorted(plans) == [["fetch", "carry"], ["fetch", "carry", "throw"]]


def test_an_object_in_its_region_may_stay_there() -> None:
    goal = [Fact(Term("cup.x", 2.0, 0.5), surely=True), Fact(Term("cup.y", 1.0, 0.5), surely=True)]
    found = problem.planning_problem(goal, problem.steps_for(goal, TOPS), STATE)
    (stays,) = [number for number, step in enumerate(found.steps) if step is None]
    (region,) = found.operators[stays].needs
    assert region in found.initial
    assert region >= len(found.facts)
    assert {str(found.facts[number].clause) for number in found.operators[stays].adds} == {
        str(NEAR.relations[0])
    }
    plans = [named(found, plan) for plan in found.plans(9)]
    assert sorted(plans) == [["fetch", "carry"], ["fetch", "carry", "throw"], ["fetch", "throw"]]
