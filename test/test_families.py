"""Families of ideal motions: those of any robot are nearly as fast as all combinations of a fine grid."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from robots import FIFTH, OTHERS, PIONEER, PLAIN

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.families import (
    RUNS,
    approach_family,
    dribble_family,
    drive_family,
    free_grid,
    pushed_grid,
    pushed_kinds,
    shot_family,
)
from ator_ros.domains.soccer.planned.holding import MARGIN, push
from ator_ros.experience.collect import EpisodeTask, run_task
from ator_ros.geometry import FloatArray
from ator_ros.motion.choosing import MOST, NEAR, chosen, drawn_ends, times_of
from ator_ros.motion.families import Family, Kind, free_kinds
from ator_ros.motion.ideal_times import fastest_motions
from ator_ros.motion.turn_tables import Way
from ator_ros.robot.description import Limits, Robot

every_robot = pytest.mark.parametrize("robot", [PIONEER, *OTHERS], ids=lambda robot: robot.name)


def ends(limits: Limits, count: int = 150) -> FloatArray:
    """Return starts and destinations on the field, (5, 1, n); others than kinds are chosen with."""
    return drawn_ends(limits, count, np.random.default_rng(1))


def columns(drawn: FloatArray) -> list[FloatArray]:
    """Return each situation of (5, m, n) alone, (5, m, 1)."""
    return [drawn[:, :, [number]] for number in range(drawn.shape[2])]


def excess(family: Family, grid: Family, robot: Robot) -> float:
    """Return by how much a family's motions are longer in the mean than those of a grid, as a share."""
    drawn = ends(family.limits)
    mine, best = (fastest_motions(drawn, some, hold=robot.hold).time for some in (family, grid))
    assert np.isfinite(mine).all()
    return float(np.mean(mine) / np.mean(np.minimum(mine, best)) - 1.0)


@pytest.mark.parametrize("robot", [PIONEER, PLAIN, *OTHERS], ids=lambda robot: robot.name)
def test_drives_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    grid = Family(robot.limits, free_kinds(robot.limits, free_grid((0.0,))))
    assert excess(drive_family(robot.limits), grid, robot) < (0.08 if robot is PIONEER else 0.004)


@every_robot
def test_approaches_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    family = approach_family(robot)
    grid = dataclasses.replace(family, kinds=free_kinds(robot.limits, free_grid(RUNS)))
    assert excess(family, grid, robot) < (0.06 if robot is PIONEER else 0.004)


@every_robot
def test_dribbles_are_nearly_as_fast_as_those_of_the_grid(robot: Robot) -> None:
    family = dribble_family(robot)
    grid = dataclasses.replace(family, kinds=pushed_kinds(robot, pushed_grid()))
    assert excess(family, grid, robot) < (0.06 if robot is PIONEER else 0.02)


def test_the_pioneer_has_few_kinds_and_others_as_many_as_they_need() -> None:
    assert [len(family(PIONEER).kinds) for family in (approach_family, dribble_family)] == [8, 12]
    assert len(drive_family(PIONEER.limits).kinds) == 8
    for robot in (PLAIN, *OTHERS):
        assert 8 < len(drive_family(robot.limits).kinds) <= MOST


def test_the_kind_that_saves_most_is_chosen_next_until_hardly_any_is_saved() -> None:
    times = np.array([[2.0, 9.0, np.inf], [3.0, 3.0, 3.0], [np.inf, 5.0, 2.9999], [2.5, 3.5, 3.5]])
    assert chosen(times, 4) == [1, 0, 2]  # what no kind improves is not chosen
    assert chosen(times, 1) == [1]
    assert chosen(times, 4, near=NEAR) == [1, 0]


def test_kinds_that_need_speed_are_for_those_that_have_it() -> None:
    limits = FIFTH.holder_for("a test").limits
    turn = Way(0.0, 0.5 * limits.w)
    whole = Family(limits, (Kind(turn, turn, np.nan),), run=None, forward=True)
    picky = whole.kinds[0]._replace(least_start=0.3, least_arrival=0.2)
    family = dataclasses.replace(whole, kinds=(picky,))
    drawn = ends(limits, 400)
    every, some = (times_of(each, drawn, FIFTH.hold)[0] for each in (whole, family))
    able = (drawn[3, 0] >= 0.3) & (drawn[4, 0] >= 0.2)
    assert np.isfinite(every[able]).any()
    assert some[able].tolist() == every[able].tolist()
    assert np.isinf(some[~able]).all()


@every_robot
def test_each_motion_is_what_it_is_alone(robot: Robot) -> None:
    """What is kept from one situation to the next changes nothing, though speeds outnumber what is kept."""
    for family in (drive_family(robot.limits), approach_family(robot), dribble_family(robot)):
        drawn = ends(family.limits)
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
    fastest = robot.holder_for("a test").limits.v
    for kind in dribble_family(robot).kinds:
        entry = max(kind.least_start, 0.0) if np.isnan(kind.entry) else kind.entry
        assert push(robot, entry, kind.first.rate, kind.first.change) >= MARGIN
        after = max(kind.least_arrival, 0.0) if np.isnan(kind.share) else kind.share * fastest
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
