"""The roles of objects in TOPs with more objects than a ball."""

from ator_ros.actions.base import Goal
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import Top, TopCall
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.objects import followed, has_left, object_fetched_by
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()


def near(first: str, second: str) -> Condition:
    return Condition(tuple(Term(f"{first}.{axis}", f"{second}.{axis}", 0.1) for axis in "xy"))


def both(*conditions: Condition) -> Condition:
    return Condition(tuple(term for condition in conditions for term in condition.terms))


def world(**places: tuple[float, float]) -> World:
    objects = {name: ObjectState(*place) for name, place in places.items()}
    return World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), objects)


def test_an_ambiguous_role_is_assigned_to_the_first_object_by_name() -> None:
    names = ("cup", "box", "tray", "ball", "can")
    top = Top("fetch", "drive", both(*(near(name, "goal") for name in names)), near("hold", "ball"))
    assert followed(top) == object_fetched_by(top) == "ball"


def test_only_the_followed_object_leaves_a_goal() -> None:
    # "ball" is part of the name of another object, whose motion does not affect the goal.
    pre = both(near("ball", "goal"), near("football", "box"), Condition((Term("ball.vx", 0.0, 0.1),)))
    call = TopCall(Top("fetch", "drive", pre, Condition()), Goal(Pose(1.0, 0.0, 0.0)))
    there = world(ball=(1.0, 0.0), football=(3.0, 0.0), box=(-3.0, 0.0))
    assert not has_left(there, call, ROBOT)
    assert not has_left(there.with_object("ball", ObjectState(1.0, 0.0, vx=2.0)), call, ROBOT)
    assert has_left(there.with_object("ball", ObjectState(1.0, 0.2)), call, ROBOT)
