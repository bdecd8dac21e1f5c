"""Scenes: objects of domains, and their simulation."""

import dataclasses
import math

import pytest
from outside.delivery import DELIVERY, PARCEL

from ator_ros.bases.description import Robot, load_robot
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.scene import Area, Bay, RoundObject, Scene
from ator_ros.world.state import Command, ObjectState, World

ROBOT = load_robot()
CUP = RoundObject(radius=0.05, mass=0.2, rolling_deceleration=1.0, restitution=0.1)


def within(**changes: object) -> Robot:
    return dataclasses.replace(ROBOT, scene=dataclasses.replace(ROBOT.scene, **changes))  # type: ignore[arg-type]


def drive(simulation: Simulation, seconds: float) -> World:
    for _ in range(round(20 * seconds)):
        simulation.command(Command(0.6))
        simulation.tick()
    return simulation.world()


def test_another_domain_has_its_own_objects_and_no_goals() -> None:
    scene = DELIVERY.equip(ROBOT).scene
    assert scene == Scene(ROBOT.scene.area, {"parcel": PARCEL})


def test_the_size_of_the_description_overrides_the_domain() -> None:
    measured = dataclasses.replace(PARCEL, radius=0.3)
    assert DELIVERY.equip(within(objects={"parcel": measured})).scene.objects == {
        "parcel": measured
    }


def test_objects_are_pushed_and_roll_by_their_size() -> None:
    with Simulation(within(objects={"cup": CUP, "parcel": PARCEL})) as simulation:
        simulation.place_objects(
            {"cup": ObjectState(0.5, 0.0), "parcel": ObjectState(0.0, 1.5, 0.8, 0.0)}
        )
        world = drive(simulation, 1.0)
        assert world.objects["parcel"].x == pytest.approx(
            0.8**2 / 2 / PARCEL.rolling_deceleration, rel=0.2
        )
        assert world.objects["cup"].x >= world.robot.pose.x + ROBOT.front + CUP.radius - 0.01
        simulation.place_objects({"parcel": ObjectState(2.0, 1.0)})
        assert set(simulation.world().objects) == {"parcel"}


@pytest.mark.parametrize("yaw", [0.7, math.pi])
def test_a_bay_is_open_in_front_and_closed_behind_and_beside(yaw: float) -> None:
    front = Pose(0.5, 0.3, yaw)
    bay = Bay(*front, 1.0, 0.6)
    with Simulation(within(bays=(bay,))) as simulation:
        simulation.place_robot(front.ahead(-1.0))
        inside = front.relative(drive(simulation, 2.8).robot.pose)
        # the tips touch the back
        assert inside.x + ROBOT.front == pytest.approx(0.6 - 0.12, abs=0.03)
        assert abs(inside.y) < 0.1  # a pushing robot slides along a wall
        beside = front.compose(Pose(0.3, 1.5, -math.pi / 2))
        simulation.place_robot(beside)
        outside = front.relative(drive(simulation, 1.7).robot.pose)
        assert outside.y - ROBOT.tip == pytest.approx(0.55, abs=0.05)


AREA = Area(length=8.0, width=4.0, margin=0.5, x=1.0, y=-1.0)


def test_an_area_has_lines_and_a_floor_around_its_center() -> None:
    assert AREA.lines == (-3.0, -3.0, 5.0, 1.0)
    assert AREA.floor == (-3.5, -3.5, 5.5, 1.5)
    assert AREA.at(0.0, 0.0) == Pose(1.0, -1.0, 0.0)
    assert AREA.at(4.0, -2.0, 1.5) == Pose(5.0, -3.0, 1.5)


@pytest.mark.parametrize("x", [-3.5, 0.0, 5.5])
@pytest.mark.parametrize("y", [-3.5, 0.0, 1.5])
def test_the_floor_ends_at_its_edges(x: float, y: float) -> None:
    assert AREA.has_floor(x, y)
    assert not AREA.has_floor(x, y + 6.0)
    assert not AREA.has_floor(x, y - 6.0)
    assert not AREA.has_floor(x + 10.0, y)
    assert not AREA.has_floor(x - 10.0, y)


@pytest.mark.parametrize(("vx", "vy"), [(2.0, 0.0), (-1.0, 0.0), (0.6, -0.8)])
def test_an_object_rolls_by_the_square_of_its_speed(vx: float, vy: float) -> None:
    scene = Scene(AREA, {"cup": dataclasses.replace(CUP, rolling_deceleration=0.5)})
    end = scene.at_rest("cup", ObjectState(1.0, 1.0, vx, vy))
    assert end.speed == 0.0
    rolled = math.hypot(end.x - 1.0, end.y - 1.0)
    assert rolled == pytest.approx((vx**2 + vy**2) / (2.0 * 0.5))
    assert (end.x - 1.0) * vy == pytest.approx((end.y - 1.0) * vx)
    assert (end.x - 1.0) * vx + (end.y - 1.0) * vy > 0.0
    assert scene.at_rest("cup", end) is end


def test_an_object_without_a_description_has_no_size_and_does_not_roll() -> None:
    scene = Scene(AREA, {"cup": CUP})
    state = ObjectState(1.0, 1.0, 2.0, 0.0)
    assert (scene.radius("cup"), scene.radius("ghost")) == (CUP.radius, 0.0)
    assert scene.at_rest("ghost", state) is state


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_an_object_comes_to_rest_where_its_energy_is_used_up(speed: float) -> None:
    rolling = ObjectState(1.0, 2.0, 0.6 * speed, -0.8 * speed)
    for deceleration in (0.5, 4.0):
        there = dataclasses.replace(CUP, rolling_deceleration=deceleration).at_rest(rolling)
        distance = speed**2 / (2.0 * deceleration)
        assert (there.x, there.y) == pytest.approx((1.0 + 0.6 * distance, 2.0 - 0.8 * distance))
        assert there.speed == 0.0


def test_an_object_at_rest_stays() -> None:
    here = ObjectState(1.0, 2.0)
    assert CUP.at_rest(here) == here
