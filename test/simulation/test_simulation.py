"""The core of the simulator."""

import math
from collections.abc import Iterator

import pytest

from ator_ros.domains.soccer.field import BALL, ball_of
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import TICK, Simulation
from ator_ros.world.state import Command, World

ROBOT = SOCCER.robot()
LIMITS_SLACK = 0.03  # m/s and rad/s by which the wheels' velocity loop may overshoot


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation(ROBOT) as simulation:
        yield simulation


def dribble() -> list[World]:
    """Dribble along a curve in a new simulation; return the states."""
    start, worlds = Pose(0.0, 0.0, 0.3), []
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(start)
        simulation.place_object(BALL, *ROBOT.hold_point(start)[:2])
        for tick in range(100):
            simulation.command(Command(0.6, 0.5 * math.sin(0.1 * tick)))
            simulation.tick()
            worlds.append(simulation.world())
    return worlds


def test_same_commands_give_bit_identical_trajectories() -> None:
    assert dribble() == dribble()


@pytest.mark.parametrize(
    "command", [Command(9.0, 0.0), Command(-9.0, 0.0), Command(9.0, -9.0), Command(0.0, 9.0)]
)
def test_base_never_exceeds_its_limits(simulation: Simulation, command: Command) -> None:
    last, v, w = simulation.world().robot, 0.0, 0.0
    for _ in range(60):
        simulation.command(command)
        simulation.tick()
        state = simulation.world().robot
        assert abs(state.vx - last.vx) <= ROBOT.limits.a * TICK + LIMITS_SLACK
        last, v, w = state, max(v, abs(state.vx)), max(w, abs(state.w))
    assert v <= ROBOT.limits.v + LIMITS_SLACK
    assert w <= ROBOT.limits.w + LIMITS_SLACK
    assert max(v / ROBOT.limits.v, w / ROBOT.limits.w) > 0.95  # the commands did reach the limits


SPEEDS = [
    (v, w) for v in (-9.0, -0.9, -0.5, 0.0, 0.6, 9.0) for w in (-9.0, -1.7, -0.7, 0.0, 1.2, 9.0)
]


def test_the_robot_stands_half_a_second_after_the_last_command(simulation: Simulation) -> None:
    for v, w in SPEEDS:
        simulation.place_robot(Pose(0.0, 0.0, 0.3))
        for _ in range(40):
            simulation.command(Command(v, w))
            simulation.tick()
        fast = simulation.world().robot
        simulation.tick()
        assert simulation.world().robot.vx == pytest.approx(fast.vx, abs=0.01)  # late, not lost
        for _ in range(8):
            simulation.tick()
        stopped = simulation.world().robot
        # at rest
        assert (stopped.vx, stopped.w / 2.5) == pytest.approx((0.0, 0.0), abs=0.02), (v, w)


def test_rolling_ball_decelerates_as_configured(simulation: Simulation) -> None:
    simulation.place_robot(Pose(-3.0, 2.0, 0.0))
    simulation.place_object(BALL, 0.0, 0.0, vx=1.2)
    speeds = []
    for _ in range(21):
        simulation.tick()
        ball = ball_of(simulation.world())
        speeds.append(ball.speed)
    assert (speeds[0] - speeds[20]) / 1.0 == pytest.approx(
        ROBOT.scene.objects[BALL].rolling_deceleration, rel=0.1
    )


def test_robots_of_one_world_move_independently_and_share_the_ball() -> None:
    with Simulation(ROBOT, robots=2) as world:
        world.place_robot(Pose(-1.0, 0.0, 0.0))
        world.place_robot(Pose(0.0, 1.0, math.pi / 2.0), number=1)
        world.place_object(BALL, 0.0, -1.0)
        for _ in range(40):
            world.command(Command(0.5, 0.0))
            world.command(Command(-0.3, 0.0), number=1)
            world.tick()
        first, second = world.world().robot, world.world(number=1).robot
        assert (first.vx, second.vx) == pytest.approx((0.5, -0.3), abs=LIMITS_SLACK)
        assert 0.55 < first.pose.x + 1.0 < 0.9
        assert (first.pose.y, second.pose.x) == pytest.approx((0.0, 0.0), abs=0.01)
        assert 0.3 < 1.0 - second.pose.y < 0.6
        assert world.world().objects == world.world(number=1).objects
