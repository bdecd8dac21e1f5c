"""Families of ideal motions: those of any robot are nearly as fast as all combinations of a fine grid."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from robots import FIFTH, OTHERS, PIONEER, SHIPPED

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.families import approach_family, dribble_family, shot_family
from ator_ros.domains.soccer.planned.holding import MARGIN, fastest_rate, push
from ator_ros.experience.collect import EpisodeTask, run_task
from ator_ros.geometry import FloatArray
from ator_ros.motion.families import Family, FreeTurns, Kind, drive_family, free_kinds
from ator_ros.motion.ideal_times import fastest_motions
from ator_ros.motion.turn_tables import Way
from ator_ros.robot.description import Limits, Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, *OTHERS], ids=lambda robot: robot.name)


def ends(limits: Limits, count: int = 150) -> FloatArray:
    """Return starts and destinations on the field, (5, 1, n), half of them at half the greatest speed."""
    rng = np.random.default_rng(1)
    x, y, turn = (rng.uniform(-most, most, count) for most in (4.0, 3.0, np.pi))
    return np.stack((x, y, turn, *(0.5 * limits.v * rng.integers(0, 2, (2, count)))))[:, None]


def columns(drawn: FloatArray) -> list[FloatArray]:
    """Return each situation of (5, m, n) alone, (5, m, 1)."""
    return [drawn[:, :, [number]] for number in range(drawn.shape[2])]


def excess(family: Family, grid: Family, robot: Robot) -> float:
    """Return by how much a family's motions are longer in the mean than those of a grid, as a share."""
    drawn = ends(family.limits)
    mine, best = (fastest_motions(drawn, some, hold=robot.hold).time for some in (family, grid))
    assert np.isfinite(mine).all()
    return float(np.mean(mine) / np.mean(np.minimum(mine, best)) - 1.0)


def free_grid(shares: tuple[float, ...], runs: tuple[float, ...] = (0.0,)) -> list[FreeTurns]:
    return [FreeTurns(*row) for row in itertools.product(shares, shares, (False, True), runs)]


@every_robot
def test_drives_are_nearly_as_fast_as_those_of_a_fine_grid(robot: Robot) -> None:
    grid = Family(robot.limits, free_kinds(robot.limits, free_grid((-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0))))
    assert excess(drive_family(robot.limits), grid, robot) < 0.03


@every_robot
def test_approaches_are_nearly_as_fast_as_those_of_a_fine_grid(robot: Robot) -> None:
    family = approach_family(robot)
    rows = free_grid((-1.0, -0.6, 0.0, 0.3, 0.6, 1.0), (0.0, 0.35, 0.8, 1.0))
    grid = Family(robot.limits, free_kinds(robot.limits, rows), run=family.run, passing=family.passing)
    assert excess(family, grid, robot) < 0.04


def pushed_grid(robot: Robot) -> Family:
    limits, kinds = robot.holder_for("a test").limits, []
    for entry, gain, loss, after in itertools.product(
        (np.nan, 0.1, 0.2, 0.55), (0.0, 0.25, 0.75, 0.96), (0.0, 0.5, 0.9), (0.1, 0.2, 0.4, 0.6, 0.95)
    ):
        first, last, begin = gain * limits.a, loss * limits.brake, np.nan_to_num(entry) * limits.v
        turns = (
            Way(first, fastest_rate(robot, begin, first)),
            Way(last, fastest_rate(robot, after * limits.v, -last)),
        )
        kinds.append(Kind(*turns, after, entry * limits.v))
    return Family(limits, tuple(kinds), run=None, forward=True)


@every_robot
def test_dribbles_are_nearly_as_fast_as_those_of_a_fine_grid(robot: Robot) -> None:
    assert excess(dribble_family(robot), pushed_grid(robot), robot) < 0.08


@pytest.mark.parametrize("file", SHIPPED[1:], ids=lambda file: file.stem)
def test_weak_and_quick_robots_that_ship_have_kinds_enough(file: Path) -> None:
    robot = SOCCER.robot(file)
    rows = free_grid((-1.0, -0.6, 0.0, 0.3, 0.6, 1.0), (0.0, 0.35, 0.8, 1.0))
    family = approach_family(robot)
    grid = Family(robot.limits, free_kinds(robot.limits, rows), run=family.run, passing=family.passing)
    assert excess(family, grid, robot) < 0.02
    assert excess(dribble_family(robot), pushed_grid(robot), robot) < 0.02


@every_robot
def test_each_motion_is_what_it_is_alone(robot: Robot) -> None:
    """What is kept from one situation to the next changes nothing, though speeds outnumber what is kept."""
    for family in (drive_family(robot.limits), approach_family(robot), dribble_family(robot)):
        drawn = ends(family.limits)
        drawn[3:, 0, 50:] = np.random.default_rng(2).uniform(0.0, family.limits.v, (2, drawn.shape[2] - 50))
        together = fastest_motions(drawn, family, hold=robot.hold).time
        alone = [fastest_motions(each, family, hold=robot.hold).time[0] for each in columns(drawn)]
        assert together.tolist() == alone


@every_robot
def test_the_destination_that_is_reached_first_counts(robot: Robot) -> None:
    family = shot_family(robot)
    drawn = ends(family.limits).reshape(5, 3, -1)
    drawn[3] = drawn[3, 0]  # one start, and three destinations
    drawn[:2, 2, :10] *= 0.01  # some of them too near
    each = [fastest_motions(drawn[:, [choice]], family, hold=robot.hold).time for choice in range(3)]
    assert fastest_motions(drawn, family, hold=robot.hold).time.tolist() == np.min(each, axis=0).tolist()


@every_robot
def test_turns_with_the_ball_hold_it(robot: Robot) -> None:
    for kind in dribble_family(robot).kinds:
        entry = np.nan_to_num(kind.entry)
        assert push(robot, float(entry), kind.first.rate, kind.first.change) >= MARGIN
        after = kind.share * robot.holder_for("a test").limits.v
        assert push(robot, after, kind.last.rate, -kind.last.change) >= MARGIN


def test_lengths_and_speeds_follow_the_robot() -> None:
    assert approach_family(PIONEER).run == 0.25
    assert approach_family(PIONEER).passing == 0.4
    assert approach_family(FIFTH).passing == pytest.approx(0.4 - PIONEER.half_width + FIFTH.half_width)
    for robot in OTHERS:
        entries = [kind.entry for family in (dribble_family, shot_family) for kind in family(robot).kinds]
        assert np.nanmax(entries) <= robot.holder_for("a test").limits.v


@pytest.mark.long
@pytest.mark.parametrize("robot", OTHERS, ids=lambda robot: robot.name)
@pytest.mark.parametrize("action", list(SOCCER.actions()))
def test_other_robots_execute_what_is_sampled(action: str, robot: Robot) -> None:
    tasks = [
        EpisodeTask(SOCCER.actions()[action], SOCCER.tops, robot, 7, number, SOCCER.objects)
        for number in range(8)
    ]
    assert all(run_task(task)["success"].iloc[0] for task in tasks)
