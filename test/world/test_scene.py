"""Scenes: objects of domains, and their simulation."""

import dataclasses
import math

import pytest
from outside.delivery import DELIVERY, PARCEL

from ator_ros.bases.description import Robot, load_robot
from ator_ros.geometry import Pose
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.scene import Bay, RoundObject, Scene
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
