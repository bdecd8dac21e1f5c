"""Sensor noise, drift, delay and dropouts."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from ator_ros.geometry import Pose
from ator_ros.simulation.sensors import REALISTIC, SensorConfig, Sensors
from ator_ros.world.state import BallState, RobotState, World

TICK = 0.05


def drive(ticks: int, *, ball: BallState | None = None, start: float = 0.0) -> list[World]:
    """Drive along x at 1 m/s."""
    return [
        World(tick * TICK, RobotState(Pose(start + tick * TICK, 0.0, 0.3), 1.0, 0.0), ball)
        for tick in range(ticks)
    ]


def test_perfect_sensors_tell_the_truth() -> None:
    sensors = Sensors(SensorConfig())
    for world in drive(50, ball=BallState(1.0, 2.0, 0.5, -0.5)):
        assert sensors.observe(world) == world


def test_the_ball_is_seen_from_where_the_robot_is() -> None:
    sensors = Sensors(SensorConfig(ball_dropouts=1e-12))
    for world in drive(50, ball=BallState(1.0, 2.0, 0.5, -0.5)):
        seen = sensors.observe(world)
        assert seen.time == world.time
        assert seen.robot.pose == pytest.approx(world.robot.pose)
        assert seen.ball is not None
        assert (seen.ball.x, seen.ball.y, seen.ball.vx, seen.ball.vy) == pytest.approx((1.0, 2.0, 0.5, -0.5))


def test_the_same_seed_sees_the_same() -> None:
    worlds = drive(50, ball=BallState(1.0, 2.0))

    def seen(seed: int) -> list[World]:
        sensors = Sensors(REALISTIC, seed)
        return [sensors.observe(world) for world in worlds]

    assert seen(1) == seen(1)
    assert seen(1) != seen(2)


def test_odometry_drifts_with_the_root_of_the_way() -> None:
    config = SensorConfig(drift=0.02, heading_drift=0.01)
    ends = []
    for seed in range(200):
        sensors = Sensors(config, seed)
        seen = [sensors.observe(world) for world in drive(81)]
        ends.append((seen[-1].robot.pose.y, seen[-1].robot.pose.yaw - 0.3))
    spread = np.std(ends, axis=0)
    assert spread[1] == pytest.approx(0.01 * math.sqrt(4.0), rel=0.2)
    assert spread[0] > 0.02 * math.sqrt(4.0) * 0.8
    assert np.abs(np.mean(ends, axis=0)).max() < 0.02


def test_standing_still_does_not_drift() -> None:
    sensors = Sensors(REALISTIC)
    world = World(0.0, RobotState(Pose(1.0, 2.0, 3.0)))
    assert all(sensors.observe(world).robot.pose == pytest.approx(Pose(1.0, 2.0, 3.0)) for _ in range(20))


def test_a_placed_robot_is_believed_to_be_there() -> None:
    sensors = Sensors(REALISTIC)
    for world in drive(50):
        sensors.observe(world)
    placed = World(3.0, RobotState(Pose(-3.0, -2.0, 1.0)))
    assert sensors.observe(placed).robot.pose == Pose(-3.0, -2.0, 1.0)


def test_the_ball_comes_late() -> None:
    sensors = Sensors(SensorConfig(ball_delay=0.1))
    for tick in range(20):
        ball = BallState(0.1 * tick, 0.0)
        seen = sensors.observe(World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), ball)).ball
        assert seen is not None
        assert seen.x == pytest.approx(0.1 * max(0, tick - 2))


def test_with_a_latency_odometry_and_ball_come_late_and_say_so() -> None:
    sensors = Sensors(SensorConfig(latency=0.1))
    worlds = drive(10, ball=BallState(1.0, 2.0, 0.5, -0.5))
    seen = [sensors.observe(world) for world in worlds]
    assert [world.time for world in seen] == [max(0, tick - 2) * TICK for tick in range(10)]
    assert [world.robot.pose.x for world in seen[3:]] == pytest.approx(
        [world.robot.pose.x for world in worlds[1:-2]]
    )
    sensors.reset()
    assert sensors.observe(worlds[5]).time == worlds[5].time


def test_a_late_ball_is_carried_on_by_its_velocity() -> None:
    sensors = Sensors(SensorConfig(ball_delay=0.1, ball_dropouts=0.3), seed=2)
    for tick in range(40):
        ball = BallState(0.5 * tick * TICK, 0.0, 0.5, 0.0)
        seen = sensors.observe(World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), ball)).ball
        assert seen is None or seen.x == pytest.approx(ball.x)


def test_a_ball_that_is_not_seen_stays_where_it_was_seen() -> None:
    sensors = Sensors(SensorConfig(ball_dropouts=0.5), seed=3)
    places = []
    for tick in range(400):
        world = World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), BallState(0.01 * tick, 0.0))
        ball = sensors.observe(world).ball
        if ball is not None:
            places.append(round(ball.x / 0.01))
    repeated = sum(a == b for a, b in itertools.pairwise(places)) / len(places)
    assert places == sorted(places)
    assert repeated == pytest.approx(0.5, abs=0.1)


def test_a_removed_ball_is_gone_at_once() -> None:
    sensors = Sensors(REALISTIC)
    for world in drive(10, ball=BallState(1.0, 2.0)):
        sensors.observe(world)
    assert sensors.observe(World(0.5, RobotState(Pose(0.5, 0.0, 0.3)))).ball is None


@pytest.mark.parametrize("wrong", [{"drift": -1.0}, {"ball_noise": math.nan}, {"ball_dropouts": 1.0}])
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"sensors: .*expected"):
        Sensors(SensorConfig(**wrong))
