"""Situations and chains that a domain's file declares."""

from __future__ import annotations

import itertools
import math
import pickle
from collections import Counter

import numpy as np
import pytest

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import GoalVariable, wrong_values
from ator_ros.actions.situation import SHORT, NoPlaceError, Situation
from ator_ros.domains.declared_situations import (
    ChainsOf,
    DeclaredChain,
    DeclaredDrives,
    DeclaredPlace,
    DeclaredStep,
    DrivesOf,
)
from ator_ros.domains.domain import find_domain

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
LIBRARY = TOUR.library(ROBOT)
HALL = (DeclaredPlace((-2.0, 2.0), (-1.0, 1.0)),)
DOCK = DeclaredPlace((3.0,), (0.5,), (1.5,))


def test_a_place_is_drawn_evenly_from_its_ranges() -> None:
    rng = np.random.default_rng(1)
    poses = np.array([HALL[0].drawn(rng) for _ in range(2000)])
    assert np.all(np.abs(poses) <= (2.0, 1.0, math.pi))
    assert np.allclose(poses.mean(axis=0), 0.0, atol=0.15)
    assert np.allclose(poses.std(axis=0), np.array((2.0, 1.0, math.pi)) / math.sqrt(3.0), rtol=0.05)
    assert DOCK.drawn(rng) == (3.0, 0.5, 1.5)


def long_ones(drives: list[Situation]) -> list[float]:
    """Return the distances in m from start to goal of drives that are not meant to be short."""
    ways = [drive.robot.pose.distance(drive.goal.pose) for drive in drives]
    long = [way for way in ways if way >= SHORT]
    assert len(long) > 0.7 * len(ways)
    return long


def test_drives_keep_their_distance_and_are_the_same_for_the_same_seed() -> None:
    sample = DrivesOf("drive_to", DeclaredDrives(HALL, HALL, apart=1.5))
    first = [sample(ROBOT, np.random.default_rng(seed)) for seed in range(50)]
    copied = pickle.loads(pickle.dumps(sample))  # noqa: S301 (as a worker process gets it)
    again = [copied(ROBOT, np.random.default_rng(seed)) for seed in range(50)]
    assert first == again
    assert min(long_ones(first)) >= 1.5
    assert {one.action for one in first} == {"drive_to"}


def test_declared_goal_variables_are_drawn_from_their_range_and_the_point_is_that_of_the_top() -> None:
    force = GoalVariable("force", "N", 2.0, 4.0)
    sample = DrivesOf("push", DeclaredDrives(HALL, HALL), Point.HOLD, (force,))
    goals = [sample(ROBOT, np.random.default_rng(seed)).goal for seed in range(50)]
    assert not any(wrong_values(goal, (force,)) for goal in goals)
    assert np.ptp([goal.values["force"] for goal in goals]) > 1.5
    assert {goal.point for goal in goals} == {Point.HOLD}


def test_places_that_are_too_near_are_told() -> None:
    sample = DrivesOf("drive_to", DeclaredDrives((DOCK,), (DOCK,), apart=0.1))
    with pytest.raises(
        NoPlaceError, match=r"^drives of drive_to: apart: expected places 0.1 m from the one before: none of"
    ):
        sample(ROBOT, np.random.default_rng(0))


def test_places_are_drawn_again_where_a_fixed_one_follows_too_near() -> None:
    near = (DeclaredPlace((2.5, 3.5), (0.0, 1.0)),)  # most of it is within 0.5 m of DOCK
    rng = np.random.default_rng(0)
    drive = DrivesOf("drive_to", DeclaredDrives(near, (DOCK,), apart=0.5))
    drives = [drive(ROBOT, rng) for _ in range(50)]
    assert min(long_ones(drives)) >= 0.5
    steps = (DeclaredStep("visit", near, times=(1, 3)), DeclaredStep("visit", (DOCK,)))
    chains = ChainsOf(DeclaredChain("home", near, steps))
    lengths = set()
    for _ in range(50):
        world, chain = chains(ROBOT, LIBRARY, rng)
        places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
        assert min(a.distance(b) for a, b in itertools.pairwise(places)) >= 0.5
        lengths.add(len(chain))
    assert lengths == {2, 3, 4}


def test_fixed_places_that_follow_each_other_may_be_nearer_than_apart() -> None:
    beside = DeclaredPlace((3.2,), (0.5,), (0.0,))
    steps = (DeclaredStep("visit", (DOCK,)), DeclaredStep("visit", (beside,)))
    _, chain = ChainsOf(DeclaredChain("fixed", HALL, steps))(ROBOT, LIBRARY, np.random.default_rng(0))
    assert [call.goal.pose for call in chain.calls] == [(3.0, 0.5, 1.5), (3.2, 0.5, 0.0)]


def test_places_that_cannot_be_so_far_apart_are_named() -> None:
    small = (DeclaredPlace((2.9, 3.1), (0.4, 0.6)),)
    chain = DeclaredChain("narrow", small, (DeclaredStep("visit", (DOCK,)),))
    with pytest.raises(NoPlaceError, match=r"^chain narrow: apart: expected places 0.5 m from "):
        ChainsOf(chain)(ROBOT, LIBRARY, np.random.default_rng(0))


def test_no_way_is_drawn_that_takes_longer_than_the_time_limit() -> None:
    most = 4.0 * ROBOT.limits.v
    rng = np.random.default_rng(0)
    drive = DrivesOf("drive_to", DeclaredDrives(HALL, HALL), time_limit=4.0)
    drawn = [drive(ROBOT, rng) for _ in range(200)]
    assert max(one.robot.pose.distance(one.goal.pose) for one in drawn) <= most
    steps = (DeclaredStep("visit", HALL, times=(2,)),)
    for _ in range(50):
        world, chain = ChainsOf(DeclaredChain("legs", HALL, steps), 4.0)(ROBOT, LIBRARY, rng)
        places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
        assert sum(a.distance(b) for a, b in itertools.pairwise(places)) <= most


def test_a_time_limit_in_which_nothing_can_be_reached_is_told() -> None:
    far = (DeclaredPlace((9.0,), (0.0,)),)
    for sample in (
        lambda rng: DrivesOf("drive_to", DeclaredDrives((DOCK,), far), time_limit=2.0)(ROBOT, rng),
        lambda rng: ChainsOf(DeclaredChain("far", (DOCK,), (DeclaredStep("visit", far),)), 2.0)(
            ROBOT, LIBRARY, rng
        ),
    ):
        with pytest.raises(
            NoPlaceError, match=r"^(drives of drive_to|chain far): expected a way of 1.50 m at most, "
        ):
            sample(np.random.default_rng(0))


def test_a_tour_has_four_to_six_stations_of_which_two_are_bound() -> None:
    rng = np.random.default_rng(3)
    lengths: Counter[int] = Counter()
    for _ in range(200):
        world, chain = TOUR.chains["tour"](ROBOT, LIBRARY, rng)
        lengths[len(chain)] += 1
        bound = [call for call in chain.calls if not call.open]
        assert len(bound) == 2
        assert chain.calls[-1] is bound[-1]
        assert all(call.open in ({"yaw"}, frozenset()) for call in chain.calls)
        assert {(call.goal.pose.x, call.goal.pose.y) for call in bound} <= {(-3.0, 3.2), (3.5, -3.2)}
        places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
        assert min(a.distance(b) for a, b in itertools.pairwise(places)) >= 1.5
        assert not chain.violations(world, ROBOT)
    assert set(lengths) == {4, 5, 6}


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: DeclaredPlace((1.0, 0.0), (0.0,)), "x: expected .*least, greatest"),
        (lambda: DeclaredPlace((), (0.0,)), "x: expected"),
        (lambda: DeclaredPlace((0.0,), (0.0, 2e8)), "y: expected .* none beyond 1e\\+08"),
        (lambda: DeclaredPlace((0.0,), (0.0,), (7.0,)), "yaw: expected .* none beyond 6.28"),
        (lambda: DeclaredDrives((), HALL), "start: expected at least one place"),
        (lambda: DeclaredDrives(HALL, HALL, -1.0), "apart: expected a distance"),
        (lambda: DeclaredStep("visit", HALL, times=(3, 2)), "times: expected"),
        (lambda: DeclaredChain("tour", HALL, ()), "steps: expected 1 to 32"),
        (lambda: DeclaredChain("a tour", HALL, (DeclaredStep("visit", HALL),)), "name: expected a name"),
    ],
)
def test_what_cannot_be_drawn_from_is_refused(make: object, expected: str) -> None:
    with pytest.raises(ValueError, match=f"^{expected}"):
        make()  # type: ignore[operator]
