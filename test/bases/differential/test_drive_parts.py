"""The parts of a drive, from odometry's speeds, and in the records of the executor."""

import math

import numpy as np
import pytest

from ator_ros.bases.drive_parts import DriveParts, parts_of_drive
from ator_ros.domains.domain import find_domain
from ator_ros.domains.trials import random_trial
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.execution.chain_executor import ChainExecutor

TIMES = np.arange(0.0, 8.0, 0.1)


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_a_turn_a_straight_and_a_turn(speed: float) -> None:
    speeds = np.where((TIMES > 0.95) & (TIMES < 4.95), speed, 0.0)
    parts = parts_of_drive(TIMES, speeds, 8.05)
    assert parts == pytest.approx((1.1, 3.15, 4.0 * speed), abs=0.11)


def test_parts_are_unknown_of_short_drives_and_without_the_end() -> None:
    assert all(map(math.isnan, parts_of_drive(TIMES, np.full(len(TIMES), 0.5), 9.0)))
    gap = (TIMES < 2.0) | (TIMES > 3.0)
    assert all(map(math.isnan, parts_of_drive(TIMES[gap], np.full(gap.sum(), 0.5), 8.0)))
    first, last, driven = parts_of_drive(TIMES, np.full(len(TIMES), 0.01), 8.0)
    assert math.isnan(first)
    assert math.isnan(last)
    assert driven == pytest.approx(0.079)


def test_records_of_drives_have_parts() -> None:
    domain = find_domain("tour")
    robot = domain.robot(None)
    library = domain.library(robot)
    trial = random_trial(domain, next(iter(domain.chains)), library, seed=3, index=0)
    executor = ChainExecutor(library, trial.chain, time_limit=domain.time_limit)
    assert run_chain(
        robot, library, trial.world, trial.chain, time_limit=domain.time_limit, executor=executor
    ).success
    for record in executor.records:
        distance = record.start.robot.pose.distance(record.end.robot.pose)
        assert abs(record.parts.driven) == pytest.approx(distance, rel=0.05, abs=0.1)
        assert record.parts != DriveParts()
        assert (
            record.parts.first_turn + record.parts.last_turn
            < record.duration - distance / robot.limits.v
        )
