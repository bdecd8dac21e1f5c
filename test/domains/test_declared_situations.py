"""Situations and chains that a domain file declares."""

import dataclasses
import itertools
import pickle
from collections import Counter
from functools import partial

import numpy as np
import pytest

from ator_ros.actions.base import Point
from ator_ros.actions.situation import SHORT, NoPlaceError, Situation
from ator_ros.domains.declared import (
    DeclaredAllowed,
    DeclaredChain,
    DeclaredDrives,
    DeclaredPlace,
    DeclaredStep,
)
from ator_ros.domains.domain import find_domain
from ator_ros.schema import SchemaError
from ator_ros.tops.ordering import ordering_of

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
LIBRARY = TOUR.library(ROBOT)
HALL = (DeclaredPlace((-2.0, 2.0), (-1.0, 1.0)),)
PLACE = {"x": [0.0], "y": [0.0]}
DOCK = DeclaredPlace((3.0,), (0.5,), (1.5,))


def drives(places: DeclaredDrives, time_limit: float = 30.0) -> partial[Situation]:
    return partial(places.sample, "drive_to", Point.AXLE, (), time_limit=time_limit)


def long_distances(drives: list[Situation]) -> list[float]:
    """Return the distances in m from start to goal, without short drives."""
    distances = [drive.robot.pose.distance(drive.goal.pose) for drive in drives]
    long = [distance for distance in distances if distance >= SHORT]
    assert len(long) > 0.7 * len(distances)
    return long


def test_drives_keep_the_minimum_distance_and_are_reproducible() -> None:
    sample = drives(DeclaredDrives(HALL, HALL, apart=1.5))
    first = [sample(ROBOT, np.random.default_rng(seed)) for seed in range(50)]
    copied = pickle.loads(pickle.dumps(sample))  # noqa: S301 (as for a worker process)
    again = [copied(ROBOT, np.random.default_rng(seed)) for seed in range(50)]
    assert first == again
    assert min(long_distances(first)) >= 1.5
    assert {one.action for one in first} == {"drive_to"}


def test_places_too_close_together_are_reported() -> None:
    sample = drives(DeclaredDrives((DOCK,), (DOCK,), apart=0.1))
    with pytest.raises(
        NoPlaceError, match=r"^drives of drive_to: apart: expected places 0.1 m from the one before"
    ):
        sample(ROBOT, np.random.default_rng(0))


def test_no_drive_takes_longer_than_the_time_limit() -> None:
    most = 4.0 * ROBOT.limits.v
    rng = np.random.default_rng(0)
    drive = drives(DeclaredDrives(HALL, HALL), 4.0)
    drawn = [drive(ROBOT, rng) for _ in range(200)]
    assert max(one.robot.pose.distance(one.goal.pose) for one in drawn) <= most
    steps = (DeclaredStep("visit", HALL, times=(2,)),)
    for _ in range(50):
        legs = DeclaredChain("legs", HALL, steps)
        world, chain = legs.sample(ROBOT, LIBRARY, rng, time_limit=4.0)
        places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
        assert sum(a.distance(b) for a, b in itertools.pairwise(places)) <= most


def test_a_tour_has_four_to_six_stations_two_of_them_bound() -> None:
    rng = np.random.default_rng(3)
    lengths: Counter[int] = Counter()
    for _ in range(200):
        world, chain = TOUR.chains["tour"](ROBOT, LIBRARY, rng)
        lengths[len(chain)] += 1
        bound = [call for call in chain.calls if not call.open]
        assert len(bound) == 2
        assert chain.calls[-1] is bound[-1]
        assert all(call.open in ({"yaw"}, frozenset()) for call in chain.calls)
        assert {(call.goal.pose.x, call.goal.pose.y) for call in bound} <= {
            (-3.0, 3.2),
            (3.5, -3.2),
        }
        places = [world.robot.pose, *(call.goal.pose for call in chain.calls)]
        assert min(a.distance(b) for a, b in itertools.pairwise(places)) >= 1.5
        assert not chain.violations(world, ROBOT)
    assert set(lengths) == {4, 5, 6}


def test_a_chain_may_leave_its_order_open_under_precedences() -> None:
    goods = DeclaredStep("visit", HALL, ("yaw", "order"), times=(2,))
    delivery = DeclaredStep("visit", HALL, ("order",), after=(0,))
    dock = DeclaredStep("visit", HALL)
    chain = DeclaredChain("round", HALL, (goods, delivery, dock))
    _, drawn = chain.sample(ROBOT, LIBRARY, np.random.default_rng(0), time_limit=100.0)
    assert [call.after for call in drawn.calls] == [(), (), (0, 1), ()]
    assert ordering_of(drawn).groups == ((0, 1, 2), (3,))
    with pytest.raises(SchemaError, match="after: expected numbers of entries of steps, 0 to 0"):
        DeclaredChain("round", HALL, (dataclasses.replace(delivery, after=(1,)),))


def test_headings_of_steps_lie_within_the_allowed_ranges() -> None:
    ranges = (DeclaredAllowed("yaw", -0.1, 0.1), DeclaredAllowed("yaw", 3.0, 3.2))
    step = DeclaredStep("visit", HALL, open=("yaw",), allowed=ranges, times=(3,))
    chain = DeclaredChain("round", HALL, (step,))
    rng = np.random.default_rng(0)
    for _ in range(20):
        _, drawn = chain.sample(ROBOT, LIBRARY, rng, time_limit=60.0)
        for call in drawn.calls:
            yaw = call.goal.pose.yaw
            assert any(
                low - 1e-9 <= yaw - turn <= high + 1e-9
                for _, low, high in call.allowed
                for turn in (0.0, -2.0 * np.pi)
            )
    with pytest.raises(SchemaError, match="expected an open variable; got 'yaw'"):
        DeclaredStep("visit", HALL, allowed=ranges)
