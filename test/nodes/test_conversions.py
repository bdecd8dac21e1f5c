"""Conversions between messages and core types; invalid messages raise only MessageError."""

import math
from copy import deepcopy
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry

import ator_interfaces.msg as msg
from ator_interfaces.msg import AlternativeChain, GoalValue, Objective, Situation, TopCall, TopChain
from ator_ros.actions.goal_variables import GOAL_VARIABLES, GoalVariable
from ator_ros.bases.description import load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import ball_of, objects_of
from ator_ros.domains.soccer.shoot import Shoot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.nodes import messages
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import (
    FARTHEST,
    FASTEST,
    MessageError,
    ObjectReader,
    ObjectSource,
    OdometryReader,
    command_from,
    pose_from,
    world_from,
)
from ator_ros.world.state import ObjectState, RobotState, World

LIBRARY = SOCCER.library(load_robot())
FRAME = "odom"
BALL = ObjectReader(ObjectSource("ball"), FRAME)

places = st.floats(-FARTHEST, FARTHEST, allow_subnormal=False)
speeds = st.floats(-FASTEST, FASTEST, allow_subnormal=False)
angles = st.floats(-math.pi, math.pi, exclude_max=True, allow_subnormal=False)
poses = st.builds(Pose, places, places, angles)
balls = st.builds(ObjectState, places, places, speeds, speeds)
worlds = st.builds(
    World,
    st.floats(0.0, 1e6, allow_subnormal=False),
    st.builds(RobotState, poses, speeds, speeds),
    st.just({}) | st.builds(objects_of, balls),
)
any_number = st.floats(allow_nan=True, allow_infinity=True)
any_name = st.sampled_from([*GOAL_VARIABLES, "*", *LIBRARY, FRAME, "default", "bezier"]) | st.text(
    max_size=8
)


def near(first: Pose, second: Pose) -> bool:
    return first.distance(second) < 1e-9 and abs(wrap_angle(first.yaw - second.yaw)) < 1e-9


@given(worlds)
def test_a_world_is_unchanged_by_a_message(world: World) -> None:
    back = world_from(messages.situation_of(world, frame=FRAME), frame=FRAME)
    assert back.time == pytest.approx(world.time, abs=1e-8)
    assert near(back.robot.pose, world.robot.pose)
    assert (back.robot.vx, back.robot.w, ball_of(back)) == (
        world.robot.vx,
        world.robot.w,
        ball_of(world),
    )


@given(st.builds(RobotState, poses, speeds, speeds), balls)
def test_odometry_is_unchanged_by_a_message(robot: RobotState, ball: ObjectState) -> None:
    message = messages.odometry_of(1.25, robot, frame=FRAME, child="base_link")
    fastest = FASTEST, FASTEST
    time, back = OdometryReader(FRAME, limits=fastest).read(message)
    assert time == 1.25
    assert near(back.pose, robot.pose)
    assert (back.vx, back.w) == (robot.vx, robot.w)
    message = messages.object_odometry_of(1.25, ball, frame=FRAME, height=0.1)
    assert BALL.read(message) == (1.25, ball)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(list(LIBRARY)), poses, st.floats(0.0, 2.0, allow_subnormal=False)
        ),
        min_size=1,
        max_size=5,
    )
)
def test_a_chain_is_unchanged_by_a_message(steps: list[tuple[str, Pose, float]]) -> None:
    message = TopChain(
        calls=[TopCall(top=top, speed=speed, open=["yaw", "*"]) for top, _, speed in steps]
    )
    for call, (_, pose, _) in zip(message.calls, steps, strict=True):
        call.goal.pose = messages.pose_of(pose)
    chain = messages.chain_from(message, LIBRARY, frame=FRAME)
    again = messages.chain_of(chain, action_set="default", frame=FRAME)
    back = messages.chain_from(again, LIBRARY, frame=FRAME)
    for first, second, (top, pose, speed) in zip(chain.calls, back.calls, steps, strict=True):
        assert first.top.name == second.top.name == top
        assert near(first.goal.pose, pose)
        assert near(second.goal.pose, pose)
        assert first.goal.speed == second.goal.speed == speed
        assert first.goal.point is LIBRARY[top].point
        assert first.open == second.open == {"yaw", "*"}


LIFT = GoalVariable("lift", "m", 0.1, 1.5)
LIFTING = TopLibrary(
    LIBRARY.robot,
    "default",
    tops=LIBRARY.values(),
    actions=dict.fromkeys(("goToPose", "dribbleBall", "shoot"), Shoot),
    goal_variables={"goToPose": (LIFT,)},
)


def lifted(**values: float) -> TopChain:
    given = [GoalValue(name=name, value=value) for name, value in values.items()]
    return TopChain(calls=[TopCall(top="goToPose", values=given, open=["lift"])])


@pytest.mark.parametrize(
    ("chain", "expected"),
    [
        (lifted(), r"chain.calls\[0\].values: expected values of lift, got those of no variable"),
        (
            lifted(lift=1.6),
            r"chain.calls\[0\].values: lift: expected a number from 0.1 to 1.5 m, got",
        ),
        (lifted(lift=math.nan), r"values: lift: expected a number from 0.1 to 1.5 m, got nan"),
        (lifted(lift=0.5, force=1.0), r"values: expected values of lift, got those of lift, force"),
        (lifted(force=1.0), r"values: expected values of lift, got those of force"),
        (
            TopChain(calls=[TopCall(top="dribbleBall", open=["lift"])]),
            r"open: expected names .*got 'lift'",
        ),
    ],
)
def test_undeclared_or_missing_values_are_rejected(chain: TopChain, expected: str) -> None:
    with pytest.raises(MessageError, match=expected):
        messages.chain_from(chain, LIFTING, frame=FRAME)


def scrambled(message: Any, draw: st.DrawFn) -> Any:
    """Fill every field of a message with an arbitrary value of its type."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == "double":
            setattr(message, name, draw(any_number))
        elif kind == "string":
            setattr(message, name, draw(any_name))
        elif kind == "sequence<string>":
            setattr(message, name, draw(st.lists(any_name, max_size=3)))
        elif kind == "sequence<ator_interfaces/GoalValue>":
            values = [scrambled(GoalValue(), draw) for _ in range(draw(st.integers(0, 2)))]
            setattr(message, name, values)
        elif hasattr(value, "get_fields_and_field_types"):
            scrambled(value, draw)
    return message


@given(st.data())
def test_arbitrary_messages_are_read_or_rejected(data: st.DataObject) -> None:
    ball = msg.ObjectState(name="ball")
    chain = TopChain(
        calls=[scrambled(TopCall(), data.draw) for _ in range(data.draw(st.integers(0, 2)))]
    )
    readers = [
        lambda: OdometryReader(FRAME).read(scrambled(Odometry(), data.draw)),
        lambda: BALL.read(scrambled(Odometry(), data.draw)),
        lambda: world_from(
            scrambled(Situation(objects=[scrambled(ball, data.draw)]), data.draw), frame=FRAME
        ),
        lambda: command_from(scrambled(Twist(), data.draw), "cmd_vel"),
        lambda: messages.objective_from(scrambled(Objective(), data.draw)),
        lambda: messages.chain_from(chain, LIBRARY, frame=FRAME),
        lambda: messages.action_set_from(chain, allowed={"default": None}),
    ]
    reason = "expected nothing else"
    try:
        data.draw(st.sampled_from(readers))()
    except MessageError as error:
        reason = str(error)
    assert "expected" in reason


def test_the_velocity_of_a_situation_is_planar() -> None:
    robot = RobotState(Pose(1.0, 2.0, 0.5), 0.4, vy=-0.2, w=0.3)
    assert world_from(messages.situation_of(World(3.0, robot, {}), frame="odom")).robot == robot


def test_goals_and_situations_in_a_known_frame_are_transformed() -> None:
    origin = Pose(1.0, 2.0, math.pi / 2.0)
    world = World(
        3.0, RobotState(Pose(1.0, 0.0, 0.5), 0.4), objects_of(ObjectState(2.0, 0.0, 1.0, 0.0))
    )
    situation, call = messages.situation_of(world, frame="odom"), TopCall()
    call.goal.pose, call.goal.header.frame_id = messages.pose_of(Pose(1.0, 1.0, 0.0)), "odom"
    elsewhere = TopCall()
    elsewhere.goal.header.frame_id = "attic"
    looked_up: list[str] = []

    def base(_: str, other: str) -> Pose | None:
        looked_up.append(other)
        return origin if other == "odom" else None

    chains = [TopChain(calls=[call, elsewhere]), TopChain(calls=[deepcopy(call)])]
    messages.into_frame("map", base, chains, [situation, deepcopy(situation)])
    assert looked_up == ["odom", "attic"]
    assert near(pose_from(call.goal.pose, "goal"), Pose(0.0, 3.0, math.pi / 2.0))
    assert [each.goal.header.frame_id for each in (call, elsewhere)] == ["map", "attic"]
    read = world_from(situation, frame="map")
    assert near(read.robot.pose, Pose(1.0, 3.0, 0.5 + math.pi / 2.0))
    ball = ball_of(read)
    assert ball is not None
    assert (ball.x, ball.y, ball.vx, ball.vy) == pytest.approx((1.0, 4.0, 0.0, 1.0))


def ordered(*after: tuple[int, ...]) -> TopChain:
    """Return a chain of drives whose order is open, each after some others."""
    calls = [TopCall(top="goToPose", open=["order", "yaw"], after=each) for each in after]
    return TopChain(calls=calls)


def test_an_open_order_and_its_precedences_are_unchanged_by_a_message() -> None:
    sent = ordered((2,), (), (1,))
    read = messages.chain_from(sent, LIBRARY, frame=FRAME)
    assert [call.after for call in read.calls] == [(2,), (), (1,)]
    back = messages.chain_of(read, action_set="", frame=FRAME)
    assert [(list(call.open), list(call.after)) for call in back.calls] == [
        (["order", "yaw"], after) for after in ([2], [], [1])
    ]
    assert messages.order_from([0, 1, 2]) == ()
    assert messages.order_from([2, 1, 0]) == (2, 1, 0)


def test_alternatives_are_shorter_than_chains() -> None:
    short, long = (AlternativeChain(calls=ordered(*[()] * count).calls) for count in (25, 26))
    read = messages.alternative_from(short, 0, LIBRARY, frame=FRAME, fence=None)
    assert len(read) == 25
    assert messages.alternative_of(read, frame=FRAME).calls[0].top == short.calls[0].top
    expected = r"^alternatives\[1\]\.calls: expected 1 to 25 items, got 26"
    with pytest.raises(MessageError, match=expected):
        messages.alternative_from(long, 1, LIBRARY, frame=FRAME, fence=None)


@pytest.mark.parametrize("after", [((1,), (0,)), ((3,), ()), ((0,), ())])
def test_precedences_that_cannot_hold_are_refused(after: tuple[tuple[int, ...], ...]) -> None:
    with pytest.raises(MessageError, match=r"^chain: .*after: expected"):
        messages.chain_from(ordered(*after), LIBRARY, frame=FRAME)


PATROL = find_domain("patrol").library(find_domain("patrol").robot())


def test_a_passed_call_is_unchanged_by_a_message() -> None:
    message = TopChain(calls=[TopCall(top="visit", passing=True), TopCall(top="visit")])
    chain = messages.chain_from(message, PATROL, frame="")
    assert [call.passing for call in chain.calls] == [True, False]
    back = messages.chain_of(chain, action_set="default", frame="")
    assert [(call.passing, call.values) for call in back.calls] == [(True, []), (False, [])]


def test_an_action_that_cannot_pass_is_not_asked_to() -> None:
    message = TopChain(calls=[TopCall(top="goToPose", passing=True)])
    with pytest.raises(MessageError, match=r"calls\[0\].passing: expected false, as goToPose"):
        messages.chain_from(message, LIBRARY, frame="")
    message = TopChain(calls=[TopCall(top="visit", values=[GoalValue(name="stop")])])
    with pytest.raises(MessageError, match="expected no stop, which is the field `passing`"):
        messages.chain_from(message, PATROL, frame="")


def limited(*allowed: tuple[str, float, float], opened: tuple[str, ...] = ("yaw",)) -> TopChain:
    ranges = [msg.AllowedRange(name=name, low=low, high=high) for name, low, high in allowed]
    return TopChain(calls=[TopCall(top="goToPose", open=opened, allowed=ranges)])


def test_allowed_ranges_are_unchanged_by_a_message() -> None:
    sent = limited(("yaw", 3.0, 3.3), ("yaw", 0.5, 0.5))
    [read] = messages.chain_from(sent, LIBRARY, frame=FRAME).calls
    assert read.allowed == (("yaw", 3.0, 3.3), ("yaw", 0.5, 0.5))
    assert read.goal.pose.yaw == 0.5  # the nearest to 0, which was sent
    back = messages.call_of(read, frame=FRAME)
    assert list(back.allowed) == list(sent.calls[0].allowed)
    assert messages.calls_from([back], LIBRARY, frame=FRAME) == [read]


@pytest.mark.parametrize(
    ("allowed", "expected"),
    [
        (("speed", 0.1, 0.2), r"allowed\[0\]: expected an opened variable, got speed; add it"),
        (("height", 0.1, 0.2), r"allowed\[0\].name: expected one of"),
        (("yaw", 0.2, 0.1), r"allowed\[0\].high: expected a finite number from 0.2 to 6.48"),
        (("yaw", 0.0, 6.4), r"allowed\[0\].high: expected a finite number from 0 to 6.28"),
        (("yaw", 180.0, 190.0), r"allowed\[0\].low: expected a finite number from -12.5"),
        (("yaw", math.nan, 0.1), r"allowed\[0\].low: expected a finite number"),
        (("x", 90.0, 91.0), r"allowed\[0\]: expected a part of -4 to 4, which x can be, got 90 to"),
    ],
)
def test_ranges_that_cannot_be_are_refused(
    allowed: tuple[str, float, float], expected: str
) -> None:
    with pytest.raises(MessageError, match=r"^chain.calls\[0\]." + expected):
        messages.chain_from(limited(allowed, opened=("x", "yaw")), LIBRARY, frame=FRAME)
