"""Sensor noise, drift, delay and dropouts."""

import itertools
import math

import numpy as np
import pytest

from ator_ros.domains.soccer.field import BALL, ball_of, objects_of
from ator_ros.geometry import Pose
from ator_ros.simulation.sensors import ObjectErrors, SensorConfig, Sensors
from ator_ros.world.state import ObjectState, RobotState, World

TICK = 0.05


def erring(**errors: float) -> SensorConfig:
    return SensorConfig(objects={BALL: ObjectErrors(**errors)})


def drive(ticks: int, *, ball: ObjectState | None = None) -> list[World]:
    return [
        World(tick * TICK, RobotState(Pose(tick * TICK, 0.0, 0.3), 1.0, 0.0), objects_of(ball))
        for tick in range(ticks)
    ]


def test_odometry_drifts_with_the_root_of_the_distance() -> None:
    config = SensorConfig(drift=0.02, heading_drift=0.01)
    ends = []
    for seed in range(200):
        sensors = Sensors(config, seed)
        observed = [sensors.observe(world) for world in drive(81)]
        ends.append((observed[-1].robot.pose.y, observed[-1].robot.pose.yaw - 0.3))
    spread = np.std(ends, axis=0)
    assert spread[1] == pytest.approx(0.01 * math.sqrt(4.0), rel=0.2)
    assert spread[0] > 0.02 * math.sqrt(4.0) * 0.8
    assert np.abs(np.mean(ends, axis=0)).max() < 0.02


def test_with_a_latency_odometry_and_ball_are_late_by_their_stamps() -> None:
    sensors = Sensors(SensorConfig(latency=0.1))
    worlds = drive(10, ball=ObjectState(1.0, 2.0, 0.5, -0.5))
    observed = [sensors.observe(world) for world in worlds]
    assert [world.time for world in observed] == [max(0, tick - 2) * TICK for tick in range(10)]
    assert [world.robot.pose.x for world in observed[3:]] == pytest.approx(
        [world.robot.pose.x for world in worlds[1:-2]]
    )
    sensors.reset()
    assert sensors.observe(worlds[5]).time == worlds[5].time


def test_a_ball_that_is_not_observed_is_extrapolated() -> None:
    sensors = Sensors(erring(dropouts=0.5), seed=3)
    places = []
    for tick in range(400):
        world = World(
            tick * TICK, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(0.01 * tick, 0.0)}
        )
        ball = ball_of(sensors.observe(world))
        if ball is not None:
            places.append(round(ball.x / 0.01))
    repeated = sum(a == b for a, b in itertools.pairwise(places)) / len(places)
    assert places == sorted(places)
    assert repeated == pytest.approx(0.5, abs=0.1)
