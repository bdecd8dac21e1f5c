"""The experience of the models bounds what is searched, and is named where a step lies outside."""

import dataclasses
import math
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


def test_subgoals_beside_a_step_that_is_too_long_are_not_free() -> None:
    known = refiner(way=(0.5, 3.0))
    chain = TopChain((drive(1.0, 0.0, ANGLE), drive(9.0, 0.0, ANGLE), drive(10.0, 0.0, ANGLE)))
    analysis, _ = known.bounded(START, chain)
    assert [each.subgoal for each in analysis.free] == [2]
    why = "next to step 2, whose distance is outside the experience"
    assert [(each.subgoal, each.reason) for each in analysis.not_free] == [(0, why), (1, why)]


def test_ranges_are_cut_to_the_goals_of_episodes() -> None:
    chain = TopChain((drive(1.0, 0.0, ALL), drive(2.0, 0.0)))
    usual = {each.name: each for each in refiner().bounded(START, chain)[0].free}
    assert [usual[name].limits for name in ("x", "speed")] == [(), ()]
    known = refiner(xg=(-1.0, 1.5), speedg=(0.0, 0.5), v=(0.0, 0.3), yawg=(0.0, 0.1))
    free = {each.name: each for each in known.bounded(START, chain)[0].free}
    assert (free["x"].domain.low, free["x"].domain.high) == (-1.0, 1.5)
    assert free["x"].limits == ("experience of goToPose: xg from -1.00 to 1.50",)
    assert free["speed"].domain.high == 0.3
    assert len(free["speed"].limits) == 2
    assert free["y"] == usual["y"]
    assert free["yaw"] == usual["yaw"]


@pytest.mark.parametrize(("share", "is_cut"), [(0.019, False), (0.021, True)])
def test_a_cut_of_two_percent_is_ignored(share: float, is_cut: bool) -> None:
    chain = TopChain((drive(1.0, 0.0, ALL), drive(2.0, 0.0)))
    for low, high in ((-4.0 + 8.0 * share, 9.0), (-9.0, 4.0 - 8.0 * share)):
        free = refiner(xg=(low, high)).bounded(START, chain)[0].free
        domain = next(each.domain for each in free if each.name == "x")
        assert ((domain.low, domain.high) != (-4.0, 4.0)) is is_cut


@pytest.mark.parametrize("gap", [0.0, 0.5])
def test_a_range_beyond_the_experience_is_not_searched(gap: float) -> None:
    chain = TopChain((drive(1.0, 0.0, frozenset("x")), drive(2.0, 0.0)))
    for bounds in ((4.0 + gap, 9.0), (-9.0, -4.0 - gap)):
        analysis, _ = refiner(xg=bounds).bounded(START, chain)
        assert not analysis.free
        assert analysis.not_free[0].reason.startswith("beyond the experience of goToPose: xg from")


def test_speeds_are_searched_up_to_where_the_next_action_can_brake() -> None:
    known = refiner(braking=(0.0, 0.1))
    first = drive(1.0, 0.0, frozenset({"speed"}))
    for left, opened in ((0.0, NOTHING), (0.2, NOTHING), (0.2, frozenset({"speed"}))):
        chain = TopChain((first, drive(2.0, 0.0, opened, left)))
        free = known.bounded(START, chain)[0].free
        expected = math.sqrt((0.0 if opened else left) ** 2 + 2.0 * 0.1 * 1.0)
        assert free[0].domain.high == pytest.approx(expected)
        assert free[0].limits == ("experience of goToPose: braking at up to 0.10 m/s^2",)
    # with a free place, or another point of the robot, the distance is unknown
    for chain in (
        TopChain((dataclasses.replace(first, open=ALL), drive(2.0, 0.0))),
        TopChain((first, drive(2.0, 0.0, frozenset({"y"})))),
    ):
        free = {each.name: each for each in known.bounded(START, chain)[0].free if not each.subgoal}
        assert free["speed"].limits == ()
