"""The simulated omnidirectional base."""

import dataclasses
import math
from collections.abc import Iterator

import pytest
from omni_robots import ALIKE, ROBOTS, UNLIKE, WITH_HOLDER
from robots import PIONEER

from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import TICK, Simulation
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.world.state import Command, World

each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
SLACK = 0.01  # m/s
FAST = (Command(9.0), Command(-9.0), Command(vy=9.0), Command(9.0, vy=-9.0), Command(0.0, 90.0))


def driven(robot: OmniRobot, command: Command, ticks: int) -> Iterator[World]:
    with Simulation(robot) as simulation:
        simulation.place_robot(Pose(0.0, 0.0, 0.3))
        for _ in range(ticks):
            simulation.command(command)
            simulation.tick()
            yield simulation.world()


@each_robot
@pytest.mark.parametrize("command", FAST)
def test_it_reaches_and_never_exceeds_its_limits(robot: OmniRobot, command: Command) -> None:
    limits = robot.limits
    last = World(0.0, ALIKE.moved(next(driven(robot, Command(), 1)).robot, None, TICK)).robot
    most_change = max(limits.a, limits.brake, limits.side_change)
    state = last
    for world in driven(robot, command, 120):
        state = world.robot
        change = math.hypot(state.vx - last.vx, state.vy - last.vy) / TICK
        assert change <= most_change + SLACK
        assert state.speed <= limits.speed_towards(math.atan2(state.vy, state.vx)) + SLACK
        assert abs(state.w) <= limits.w + SLACK
        last = state
    reached = state.speed / limits.speed_towards(math.atan2(command.vy, command.vx))
    assert max(reached, abs(state.w) / limits.w) > 0.98


@each_robot
def test_it_moves_as_predicted(robot: OmniRobot) -> None:
    command = Command(0.5, 0.3, vy=-0.3)
    *_, world = driven(robot, command, 40)
    expected = robot.moved(next(driven(robot, Command(), 1)).robot, command, 40 * TICK)
    lag = robot.motor_time_constant
    assert world.robot.pose.distance(expected.pose) < 2.0 * lag * 0.6
    assert (world.robot.vx, world.robot.vy) == pytest.approx((expected.vx, expected.vy), abs=0.03)


@each_robot
def test_it_stands_soon_after_the_last_command(robot: OmniRobot) -> None:
    for command in (Command(0.5), Command(0.3, 0.5, vy=0.4), Command(vy=-0.5)):
        with Simulation(robot) as simulation:
            simulation.place_robot(Pose(0.0, 0.0, 0.3))
            for _ in range(30):
                simulation.command(command)
                simulation.tick()
            time = 0.15 + 0.6 / robot.stop.moving + 5.0 * robot.motor_time_constant
            for _ in range(math.ceil(time / TICK)):
                simulation.tick()
            assert simulation.world().robot.is_standing


def test_same_commands_give_bit_identical_trajectories() -> None:
    command = Command(0.6, 0.5, vy=0.2)
    assert [*driven(UNLIKE, command, 40)] == [*driven(UNLIKE, command, 40)]


def test_a_start_in_motion_has_its_velocity() -> None:
    with Simulation(ALIKE) as simulation:
        simulation.place_robot(Pose(1.0, 2.0, 0.7), Command(1.0, 0.5, vy=-0.5))
        state = simulation.world().robot
        assert (state.vx, state.vy, state.w) == pytest.approx((1.0, -0.5, 0.5))
        assert state.pose == pytest.approx((1.0, 2.0, 0.7))


def test_robots_of_both_kinds_drive_in_one_world() -> None:
    scene = WITH_HOLDER.scene
    mecanum = dataclasses.replace(UNLIKE, scene=scene)
    with Simulation(PIONEER, robots=(PIONEER, WITH_HOLDER, mecanum)) as world:
        for number in range(3):
            world.place_robot(Pose(-2.0, 1.5 * number - 1.5, 0.0), number=number)
        for _ in range(40):
            for number in range(3):
                world.command(Command(0.4, vy=0.2), number=number)
            world.tick()
        wheels, omni, other = (world.world(number=number).robot for number in range(3))
        assert (wheels.vx, wheels.vy) == pytest.approx((0.4, 0.0), abs=0.03)
        for state in (omni, other):
            assert (state.vx, state.vy) == pytest.approx((0.4, 0.2), abs=0.01)
        assert wheels.pose.y == pytest.approx(-1.5, abs=0.01)
        assert world.robot_overlap(omni.pose, number=0) == f"robot {WITH_HOLDER.name}"


def test_a_standing_robot_stops_it_and_is_not_run_through() -> None:
    with Simulation(ALIKE, robots=2) as world:
        world.place_robot(Pose(0.0, 0.0, 0.0))
        world.place_robot(Pose(0.0, 1.0, 0.0), number=1)
        for _ in range(60):
            world.command(Command(vy=0.5))
            world.command(Command(), number=1)
            world.tick()
        gap = world.world(number=1).robot.pose.y - world.world().robot.pose.y
        assert gap > ALIKE.half_width * 2.0 - 0.02


def test_it_pushes_a_ball_and_holds_it_in_a_slow_turn() -> None:
    start = Pose(-2.0, 0.0, 0.0)
    with Simulation(WITH_HOLDER) as simulation:
        simulation.place_robot(start)
        simulation.place_object(BALL, *WITH_HOLDER.hold_point(start)[:2])
        for tick in range(100):
            turning = 0.0 if tick < 40 else 0.3
            simulation.command(Command(min(0.6, 0.02 * tick), turning))
            simulation.tick()
        world = simulation.world()
        assert ball_of(world).x > 0.0
        assert WITH_HOLDER.hold_offset(world, BALL) < 0.05


def test_its_urdf_has_its_sizes_and_no_wheels() -> None:
    urdf = robot_urdf(WITH_HOLDER)
    assert "wheel" not in urdf
    size = f"{ALIKE.front + ALIKE.rear:g} {2.0 * ALIKE.half_width:g}"
    assert f'<box size="{size} 0.18"/>' in urdf
