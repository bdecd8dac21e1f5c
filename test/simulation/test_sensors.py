"""Sensor noise, drift, delay and dropouts."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from ator_ros.domains.soccer.field import BALL, ball_of, objects_of
from ator_ros.geometry import Pose
from ator_ros.simulation.sensors import REALISTIC, REALISTIC_SIGHT, SensorConfig, Sensors, Sight
from ator_ros.world.state import ObjectState, RobotState, World

TICK = 0.05
ALL = dataclasses.replace(REALISTIC, objects={BALL: REALISTIC_SIGHT})


def seeing(**errors: float) -> SensorConfig:
    """Return sensors that err only where they see the ball."""
    return SensorConfig(objects={BALL: Sight(**errors)})


def drive(ticks: int, *, ball: ObjectState | None = None, start: float = 0.0) -> list[World]:
    """Drive along x at 1 m/s."""
    return [
        World(tick * TICK, RobotState(Pose(start + tick * TICK, 0.0, 0.3), 1.0, 0.0), objects_of(ball))
        for tick in range(ticks)
    ]


def test_perfect_sensors_tell_the_truth() -> None:
    sensors = Sensors(SensorConfig())
    for world in drive(50, ball=ObjectState(1.0, 2.0, 0.5, -0.5)):
        assert sensors.observe(world) == world


def test_the_same_seed_sees_the_same() -> None:
    worlds = drive(50, ball=ObjectState(1.0, 2.0))

    def seen(seed: int) -> list[World]:
        sensors = Sensors(ALL, seed)
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


def test_a_placed_robot_is_believed_to_be_there() -> None:
    sensors = Sensors(ALL)
    for world in drive(50):
        sensors.observe(world)
    placed = World(3.0, RobotState(Pose(-3.0, -2.0, 1.0)))
    assert sensors.observe(placed).robot.pose == Pose(-3.0, -2.0, 1.0)


def test_the_ball_comes_late() -> None:
    sensors = Sensors(seeing(delay=0.1))
    for tick in range(20):
        ball = ObjectState(0.1 * tick, 0.0)
        seen = ball_of(sensors.observe(World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), objects_of(ball))))
        assert seen is not None
        assert seen.x == pytest.approx(0.1 * max(0, tick - 2))


def test_with_a_latency_odometry_and_ball_come_late_and_say_so() -> None:
    sensors = Sensors(SensorConfig(latency=0.1))
    worlds = drive(10, ball=ObjectState(1.0, 2.0, 0.5, -0.5))
    seen = [sensors.observe(world) for world in worlds]
    assert [world.time for world in seen] == [max(0, tick - 2) * TICK for tick in range(10)]
    assert [world.robot.pose.x for world in seen[3:]] == pytest.approx(
        [world.robot.pose.x for world in worlds[1:-2]]
    )
    sensors.reset()
    assert sensors.observe(worlds[5]).time == worlds[5].time


def test_a_ball_that_is_not_seen_stays_where_it_was_seen() -> None:
    sensors = Sensors(seeing(dropouts=0.5), seed=3)
    places = []
    for tick in range(400):
        world = World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(0.01 * tick, 0.0)})
        ball = ball_of(sensors.observe(world))
        if ball is not None:
            places.append(round(ball.x / 0.01))
    repeated = sum(a == b for a, b in itertools.pairwise(places)) / len(places)
    assert places == sorted(places)
    assert repeated == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("wrong", [{"noise": -1.0}, {"noise": math.nan}, {"dropouts": 1.0}])
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"sensors: .*expected"):
        seeing(**wrong)
    with pytest.raises(ValueError, match=r"sensors: drift: expected a number that is not negative, got -1.0"):
        SensorConfig(drift=-1.0)


def test_each_object_is_seen_in_its_own_way() -> None:
    sensors = Sensors(SensorConfig(objects={"cup": Sight(delay=0.1), "box": Sight()}))
    for tick in range(20):
        moving = ObjectState(0.1 * tick, 0.0)
        world = World(tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), {"cup": moving, "box": moving})
        seen = sensors.observe(world).objects
        assert seen["box"].x == pytest.approx(0.1 * tick)
        assert seen["cup"].x == pytest.approx(0.1 * max(0, tick - 2))


def test_an_object_that_is_placed_is_seen_at_once_by_a_robot_that_believes_what_it_did() -> None:
    for latency in (0.0, 2 * TICK):
        sensors = Sensors(SensorConfig(drift=0.05, latency=latency, objects={BALL: Sight(delay=0.2)}))
        worlds = drive(40, ball=ObjectState(3.0, 0.0))
        believed = [sensors.observe(world).robot.pose for world in worlds][-1]
        placed = dataclasses.replace(worlds[-1], objects=objects_of(ObjectState(-1.0, 2.0)))
        sensors.placed(BALL, placed)
        seen = sensors.observe(placed)  # time stands still
        assert seen.robot.pose == believed != worlds[-1].robot.pose
        assert ball_of(seen) is not None
        assert ball_of(seen).x < 0.0
        sensors.placed(BALL, dataclasses.replace(placed, objects={}))
        assert ball_of(sensors.observe(dataclasses.replace(placed, objects={}))) is None
