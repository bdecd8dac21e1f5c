"""The experience of the models is named where a step lies outside; it bounds nothing."""

from typing import Any

import pytest
from refinement_fakes import ALL, ANGLE, BOTH, LIBRARY, NOTHING, ROBOT, call, models

from ator_ros.geometry import Pose
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.world.state import RobotState, World

START = World(0.0, RobotState(Pose(0.0, 0.0, 0.0), 0.5), {})


def refiner(**experience: tuple[float, float]) -> Refiner:
    known = models()
    known["goToPose"].experience = experience  # type: ignore[attr-defined]
    return Refiner(ROBOT, known, ranges=LIBRARY.ranges)


def drive(x: float, yaw: float, opened: frozenset[str] = NOTHING, speed: float = 0.0) -> Any:
    return call("goToPose", x, 0.0, yaw, opened, speed)


@pytest.mark.parametrize(
    ("name", "label", "unit", "known", "value"),
    [
        ("way", "distance", "m", (1.0, 3.0), 2.0),
        ("turn", "turn", "rad", (0.0, 1.0), 0.6),
        ("v", "speed at the start", "m/s", (0.2, 0.8), 0.5),
        ("speedg", "arrival speed", "m/s", (0.0, 0.4), 0.2),
    ],
)
def test_a_quantity_outside_the_experience_is_named(
    name: str, label: str, unit: str, known: tuple[float, float], value: float
) -> None:
    chain = TopChain((drive(2.0, -0.6, speed=0.2),))
    low, high = known
    assert low < value < high
    # 5 cm (rad, cm/s), and a twentieth of the range, are no extrapolation
    slack = 0.05 + 0.05 * (high - low)
    for offset, is_outside in (
        (value - high - slack + 0.01, False),
        (value - high - slack - 0.01, True),
        (value - low + slack - 0.01, False),
        (value - low + slack + 0.01, True),
    ):
        moved = (low + offset, high + offset)
        (sentences,) = [refiner(**{name: moved}).bounded(START, chain)[0].outside]
        expected = f"step 1 (goToPose): {label} {value:.1f} {unit} is outside the experience of"
        assert [each.startswith(expected) for each in sentences] == [True] * is_outside


@pytest.mark.parametrize(
    ("name", "opened"), [("turn", "yaw"), ("speedg", "speed"), ("way", "x"), ("way", "y")]
)
def test_what_a_plan_leaves_open_is_not_outside(name: str, opened: str) -> None:
    known = refiner(**{name: (50.0, 60.0)})
    for step, is_outside in (
        (drive(2.0, 1.0), True),
        (drive(2.0, 1.0, frozenset({opened})), False),
    ):
        assert bool(known.bounded(START, TopChain((step,)))[0].outside) is is_outside


def test_the_start_depends_on_the_subgoal_before() -> None:
    known = refiner(v=(0.4, 0.5), turn=(0.0, 0.1))
    for opened, numbers in ((NOTHING, ["1", "2", "2"]), (BOTH, [])):
        chain = TopChain((drive(2.0, 1.5, opened, 0.0), drive(4.0, 0.0)))
        outside = known.bounded(START, chain)[0].outside
        assert [sentence[5] for sentence in outside] == numbers


def test_experience_bounds_nothing() -> None:
    chain = TopChain((drive(1.0, 0.0, ALL), drive(9.0, 0.0, ANGLE), drive(10.0, 0.0)))
    known = refiner(way=(0.5, 3.0), turn=(0.0, 0.1), v=(0.0, 0.0), speedg=(0.0, 0.0))
    assert known.bounded(START, chain)[0].free == refiner().bounded(START, chain)[0].free
