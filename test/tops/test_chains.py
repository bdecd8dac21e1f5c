"""Chains: what holds after each step; ranges of goal variables; libraries."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.actions.base import Action, Goal, Point, Status, Step, finished
from ator_ros.actions.goal_variables import GoalVariable
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import ConfigError, load_robot
from ator_ros.geometry import Pose
from ator_ros.tops.chain import EVERYTHING, Top, TopCall, TopChain, projected
from ator_ros.tops.conditions import Condition, Distance, Region, Term, state_of
from ator_ros.tops.library import LeftOutError, TopLibrary, top_of
from ator_ros.tops.ranges import USUAL_RANGES, Range, arrival_speed, declared_ranges
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
PLAIN = dataclasses.replace(ROBOT, holder=None)
HERE = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {"cup": ObjectState(1.0, 1.0, 0.5, 0.0)})
GOAL = Goal(Pose(2.0, -1.0, 0.5), 0.25)
AT_GOAL = (Term("robot.x", "goal.x", 0.1), Term("robot.y", "goal.y", 0.1))
DRIVE = Top("drive", "go", Condition(), Condition(AT_GOAL))
HELD = (Term("hold.x", "cup.x", 0.1), Term("hold.y", "cup.y", 0.1))
PUT = (Term("cup.x", "goal.x", 0.2), Term("cup.y", "goal.y", 0.2))
CARRY = Top(
    "carry", "push", Condition(HELD), Condition((*PUT, Term("hold.x", "goal.x", 0.05))), Point.HOLD
)
ROLL = Top("roll", "push", Condition(HELD), Condition(PUT), settles=2.0)


# ---- what holds after a step ---------------------------------------------------------------------


def test_after_an_arrival_the_robot_is_at_the_goal_and_objects_where_they_were() -> None:
    after = projected(HERE, TopCall(DRIVE, GOAL), ROBOT)
    assert after.robot == RobotState(GOAL.pose, 0.25, 0.0)
    assert after.objects == HERE.objects


def test_placed_objects_are_at_rest_at_their_targets() -> None:
    after = projected(HERE, TopCall(ROLL, GOAL), ROBOT)
    assert after.robot == HERE.robot
    assert after.objects == {"cup": ObjectState(2.0, -1.0)}
    carried = projected(HERE, TopCall(CARRY, dataclasses.replace(GOAL, point=Point.HOLD)), ROBOT)
    hold = ROBOT.hold_point(carried.robot.pose)
    assert (hold.x, hold.y) == pytest.approx((2.0, -1.0))
    assert carried.objects["cup"] == ObjectState(2.0, -1.0)


def test_an_object_with_one_coordinate_placed_keeps_the_other() -> None:
    aside = Top("roll", "push", Condition(), Condition((Term("cup.y", 5.0, 0.1),)))
    after = projected(HERE, TopCall(aside, GOAL), ROBOT)
    assert after.objects["cup"] == ObjectState(1.0, 5.0)
    slowed = Top("stop", "push", Condition(), Condition((Term("cup.vx", 0.0, 0.1),)))
    assert projected(HERE, TopCall(slowed, GOAL), ROBOT).objects == HERE.objects
    unknown = World(0.0, HERE.robot)
    assert projected(unknown, TopCall(aside, GOAL), ROBOT).objects == {}


def test_a_robot_that_does_not_arrive_has_the_variables_of_the_post_condition() -> None:
    post = Condition((Term("robot.yaw", 1.0, 0.1), Term("robot.vx", 0.3, 0.1)))
    after = projected(HERE, TopCall(Top("turn", "turn", Condition(), post), GOAL), ROBOT)
    assert after.robot == RobotState(Pose(0.0, 0.0, 1.0), 0.3, 0.0)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_post_conditions_hold_after_their_steps(x: float, y: float, yaw: float, v: float) -> None:
    for top in (DRIVE, CARRY, ROLL):
        goal = Goal(Pose(x, y, yaw), v, top.point)
        assert top.unmet(projected(HERE, TopCall(top, goal), ROBOT), goal, ROBOT) == []


def test_steps_need_what_their_pre_conditions_say() -> None:
    near = Top(
        "near",
        "go",
        Condition(relations=(Distance("robot", "goal", 0.0, 1.0),)),
        Condition(AT_GOAL),
    )
    far = TopChain((TopCall(near, GOAL),))
    (reason,) = far.violations(HERE, ROBOT)
    assert reason.startswith("pre-condition of step 1 (near) now: expected distance")
    closer = Goal(Pose(1.5, -1.0, 0.0))
    both = TopChain((TopCall(DRIVE, closer), TopCall(near, GOAL)))
    assert both.violations(HERE, ROBOT) == []
    assert len(both) == 2
    (reason,) = TopChain((*both.calls, TopCall(ROLL, GOAL))).violations(HERE, ROBOT)[:1]
    assert reason.startswith("pre-condition of step 3 (roll) after step 2 (near): expected hold.x")
    assert TopChain(()).violations(HERE, ROBOT) == [
        "expected at least one step, got an empty chain"
    ]


def test_goals_of_a_chain_are_replaced_one_by_one() -> None:
    chain = TopChain((TopCall(DRIVE, GOAL, frozenset({"yaw"})), TopCall(DRIVE, GOAL)))
    other = Goal(Pose(0.0, 0.0, 0.0))
    changed = chain.with_goal(1, other)
    assert [call.goal for call in changed.calls] == [GOAL, other]
    assert changed.calls[0] is chain.calls[0]
    assert chain.with_goal(0, other).calls[0].open == {"yaw"}


# ---- TOPs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("top", "lacks"),
    [
        (DRIVE, False),
        (CARRY, True),
        (ROLL, True),
        (dataclasses.replace(DRIVE, point=Point.HOLD), True),
        (dataclasses.replace(DRIVE, post=Condition(HELD)), True),
    ],
)
def test_what_names_the_hold_needs_a_holder(top: Top, lacks: bool) -> None:
    assert top.lacks(ROBOT) is None
    reason = f"{top.name} needs a holder; robot {PLAIN.name} has none"
    assert top.lacks(PLAIN) == (reason if lacks else None)
    chain = TopChain((TopCall(top, GOAL), TopCall(CARRY, GOAL)))
    assert chain.violations(HERE, PLAIN) == [top.lacks(PLAIN) or CARRY.lacks(PLAIN)]


def test_tolerances_along_x_add_up() -> None:
    assert DRIVE.place_tolerance == 0.1
    assert CARRY.place_tolerance == pytest.approx(0.25)
    wide = Condition((Region("cup.x", "goal.x", 0.0, 1.0), Term("robot.vx", 0.0, 5.0)))
    assert Top("wide", "go", Condition(), wide).place_tolerance == 0.0


def test_a_top_arrives_if_it_places_axle_or_hold() -> None:
    assert [top.arrives for top in (DRIVE, CARRY, ROLL)] == [True, True, False]


@given(st.sampled_from(["x", "y", "yaw", "speed"]), st.sampled_from([DRIVE, CARRY]))
def test_arrival_names_what_determines_the_robots_variables(name: str, top: Top) -> None:
    goal = Goal(Pose(1.0, 2.0, 0.5), 0.3, top.point)
    change = {"speed": 0.4} if name == "speed" else {"pose": goal.pose._replace(**{name: 0.7})}
    before = state_of(projected(HERE, TopCall(DRIVE, goal), ROBOT), ROBOT)
    after = state_of(
        projected(HERE, TopCall(DRIVE, dataclasses.replace(goal, **change)), ROBOT), ROBOT
    )
    for variable, names in top.arrival().items():
        changes = abs(before[variable] - after[variable]) > 1e-9
        assert changes == (name in names), variable


def test_moving_objects_of_the_post_condition_may_settle() -> None:
    assert ROLL.may_settle(HERE)
    assert not DRIVE.may_settle(HERE)
    assert not ROLL.may_settle(World(0.0, HERE.robot, {"cup": ObjectState(1.0, 1.0)}))
    assert not ROLL.may_settle(World(0.0, HERE.robot))
    assert DRIVE.failure(["a", "b"]) == "post-condition of drive: a; b"
    assert ROLL.shortfall(HERE, GOAL, ROBOT) == pytest.approx(1.8)


@pytest.mark.parametrize(
    ("opened", "opens"),
    [
        ({"yaw"}, {"yaw"}),
        ({EVERYTHING}, {"yaw", "speed", "lift"}),
        ({EVERYTHING, "x"}, {"x", "yaw", "speed", "lift"}),
        (set(), set()),
    ],
)
def test_everything_is_open_but_what_the_step_is_for(opened: set[str], opens: set[str]) -> None:
    call = TopCall(DRIVE, GOAL, frozenset(opened))
    assert {name for name in ("x", "y", "yaw", "speed", "lift") if call.opens(name)} == opens


def test_only_fixed_variables_of_an_arriving_robot_contradict_numbers() -> None:
    post = Condition((*AT_GOAL, Term("robot.yaw", 0.0, 0.1), Term("cup.x", 9.0, 0.1)))
    parked = dataclasses.replace(DRIVE, post=post)
    reasons = TopCall(parked, GOAL).contradictions(ROBOT)
    assert reasons == ["expected robot.yaw within 0.1 of 0.0, it is 0.4 beyond"]
    assert TopCall(parked, GOAL, frozenset({"yaw"})).contradictions(ROBOT) == []
    assert TopCall(parked, Goal(Pose(2.0, -1.0, 0.05))).contradictions(ROBOT) == []
    turning = Top("turn", "go", Condition(), Condition((Term("robot.yaw", 0.0, 0.1),)))
    assert TopCall(turning, GOAL).contradictions(ROBOT) == []


# ---- ranges --------------------------------------------------------------------------------------


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e3))
def test_a_range_contains_its_bounds_and_nothing_beyond(low: float, width: float) -> None:
    found = Range(low, low + width, 5)
    assert found.contains(low)
    assert found.contains(low + width)
    assert found.contains(low + 0.5 * width)
    assert not found.contains(low - 1e-3 * width)
    assert not found.contains(low + 1.001 * width)
    around = dataclasses.replace(found, periodic=True)
    assert around.contains(low - 10.0 * width)
    assert not around.contains(math.inf)
    assert not found.contains(math.nan)


def test_rounding_does_not_leave_a_range() -> None:
    found = Range(1e6, 1e6 + 1e-6, 5)
    assert found.contains(math.nextafter(1e6, 0.0))
    assert Range(0.0, 1.0, 5).contains(-1e-10)
    assert not Range(0.0, 1.0, 5).contains(-1e-8)


def test_usual_ranges_are_those_of_area_and_robot() -> None:
    goal = Goal(Pose(0.0, 0.0, 0.0))
    found = {name: make(ROBOT, goal) for name, make in USUAL_RANGES.items()}
    x_min, y_min, x_max, y_max = ROBOT.scene.area.lines
    assert (found["x"].low, found["x"].high) == (x_min, x_max)
    assert (found["y"].low, found["y"].high) == (y_min, y_max)
    assert (found["yaw"].low, found["yaw"].high) == (-math.pi, math.pi)
    assert [name for name, item in found.items() if item.periodic] == ["yaw"]
    assert {name: item.rest for name, item in found.items() if item.rest is not None} == {
        "speed": 0.0
    }
    spacing = {name: (item.high - item.low) / item.steps for name, item in found.items()}
    assert spacing["x"] == spacing["y"] == 0.5  # m, on the shipped field
    assert spacing["yaw"] == pytest.approx(math.radians(10.0))
    assert found["yaw"].steps > found["x"].steps > found["y"].steps > found["speed"].steps > 1


def test_arrival_speeds_are_those_of_the_robot_or_of_its_holder() -> None:
    axle, hold = Goal(Pose(0.0, 0.0, 0.0)), Goal(Pose(0.0, 0.0, 0.0), point=Point.HOLD)
    assert ROBOT.holder is not None
    assert arrival_speed(ROBOT, axle).high == ROBOT.limits.v
    assert arrival_speed(ROBOT, hold).high == ROBOT.holder.limits.v != ROBOT.limits.v
    assert arrival_speed(ROBOT, axle, most=0.1).high == 0.1
    assert arrival_speed(ROBOT, axle).low == arrival_speed(ROBOT, axle).rest == 0.0
    with pytest.raises(ConfigError, match="holder"):
        arrival_speed(PLAIN, hold)


def test_declared_variables_have_their_ranges() -> None:
    lift = GoalVariable("lift", "m", 0.1, 0.5, steps=7, rest=0.2)
    ranges = declared_ranges([lift])
    assert ranges["lift"](ROBOT, GOAL) == Range(0.1, 0.5, 7, rest=0.2)
    assert list(ranges) == ["lift"]


# ---- libraries -----------------------------------------------------------------------------------


class Push(Action):
    """Counts how often it is set up."""

    name = "push"
    setups = 0

    def setup(self) -> None:
        Push.setups += 1

    def start(self, world: World, goal: Goal) -> None:
        pass

    def step(self, world: World) -> Step:
        return finished(Status.SUCCEEDED, "done")


LIFT = GoalVariable("lift", "m", 0.1, 0.5)


def library() -> TopLibrary:
    return TopLibrary(
        ROBOT,
        "pushing",
        tops=(CARRY, DRIVE, ROLL),
        actions={"push": Push},
        goal_variables={"push": (LIFT,)},
    )


def test_a_library_has_the_tops_whose_actions_it_has() -> None:
    found = library()
    assert dict(found) == {"carry": CARRY, "roll": ROLL}
    assert len(found) == 2
    reason = "drive needs the action go; action set pushing has none of that name"
    assert found.left_out == {"drive": reason}
    with pytest.raises(LeftOutError) as left_out:
        found["drive"]
    assert str(left_out.value) == reason
    with pytest.raises(KeyError, match=r"expected one of .*carry.*roll.*, got 'fly'"):
        found["fly"]
    assert found.ranges is USUAL_RANGES


def test_the_first_action_of_each_kind_is_set_up_and_again_for_another_robot() -> None:
    found = library()
    Push.setups = 0
    actions = [found.action(CARRY), found.action(ROLL), found.action(CARRY)]
    assert Push.setups == 1
    assert len({id(action) for action in actions}) == 3
    other = found.with_robot(PLAIN)
    assert other.action(CARRY).robot is PLAIN
    assert Push.setups == 2
    assert found.action(CARRY).robot is ROBOT
    assert Push.setups == 2
    assert dict(other) == dict(found)


def test_only_tops_without_a_holder_are_usable_without_one() -> None:
    assert library().usable() == [CARRY, ROLL]
    assert library().with_robot(PLAIN).usable() == []


def test_new_goals_are_at_rest_with_usual_values() -> None:
    pose = Pose(1.0, 2.0, 0.3)
    goal = library().goal(CARRY, pose)
    assert goal.values == pytest.approx({"lift": 0.3})
    assert dataclasses.replace(goal, values={}) == Goal(pose, 0.0, Point.HOLD)
    assert library().goal_variables(CARRY) == (LIFT,)
    assert library().goal_variables(DRIVE) == ()


def test_the_top_of_a_situation_suits_action_point_and_objects() -> None:
    tops = (DRIVE, CARRY, ROLL)

    def found(action: str, objects: tuple[str, ...] = (), point: Point = Point.AXLE) -> Top:
        states = {name: ObjectState(1.0, 1.0) for name in objects}
        return top_of(
            Situation(action, HERE.robot, states, Goal(GOAL.pose, point=point)), tops, ROBOT
        )

    assert found("go") is DRIVE
    assert found("go", ("cup",)) is DRIVE
    assert found("push", ("cup",)) is ROLL
    assert found("push", ("cup",), Point.HOLD) is CARRY
    for missing in (
        ("push", (), Point.AXLE),
        ("go", (), Point.HOLD),
        ("fly", ("cup",), Point.AXLE),
    ):
        with pytest.raises(ConfigError, match=f"situation of {missing[0]}: expected a TOP"):
            found(*missing)


def test_of_several_tops_the_first_with_the_fewest_violations_is_chosen() -> None:
    far = dataclasses.replace(DRIVE, name="far", pre=Condition((Term("robot.x", 5.0, 0.1),)))
    near = dataclasses.replace(DRIVE, name="near", pre=Condition((Term("robot.x", 0.0, 0.1),)))
    situation = Situation("go", HERE.robot, {}, GOAL)
    assert top_of(situation, (far, near, DRIVE), ROBOT) is near
    assert top_of(situation, (far, DRIVE, near), ROBOT) is DRIVE
