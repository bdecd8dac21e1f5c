"""Whether the robot stops at a subgoal is decided together with the order."""

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from refinement_fakes import LIBRARY, ROBOT, USED, FakeModel, call, models, world

from ator_ros.actions.goal_variables import ORDER, STOP, STOPS, with_values
from ator_ros.geometry import Pose, wrap_angles
from ator_ros.performance.model import Passing
from ator_ros.refinement.chain_prediction import chain_situations, predict_chain
from ator_ros.refinement.free_variables import NotFree, allowed_changes
from ator_ros.refinement.refiner import ITS_DEADLINE, Refiner
from ator_ros.tops.chain import AllowedRange, TopCall, TopChain
from ator_ros.tops.ordering import ordering_of
from ator_ros.tops.ranges import USUAL_RANGES, declared_ranges
from ator_ros.world.state import RobotState, World

PASSING = Passing(0.2, 0.5)
TAKEOVER = LIBRARY["goToPose"].place_tolerance + PASSING.nearer
START = world()


def stopping_time(direct: Mapping[str, Any]) -> Any:
    """Drive; a stop takes 1 s, and a sharp turn of a robot that drives 4 s."""
    dx, dy = direct["xg"] - direct["x"], direct["yg"] - direct["y"]
    turn = np.abs(wrap_angles(np.arctan2(dy, dx) - direct["yaw"]))
    is_held_up = (np.asarray(direct["v"]) > 0.1) & (turn > 1.5)
    return np.hypot(dx, dy) + 0.2 * turn + direct["stopg"] + 4.0 * is_held_up


MODEL = FakeModel(stopping_time, USED | {"stopg"})
MODEL.passing = PASSING  # type: ignore[attr-defined]
MODELS = {**models(), "goToPose": MODEL}
REFINER = Refiner(ROBOT, MODELS, ranges={**USUAL_RANGES, **declared_ranges([STOPS])})

UNAWARE = Refiner(ROBOT, models(), ranges={**USUAL_RANGES, **declared_ranges([STOPS])})
"""Its models do not know of stops, as those of path times."""


def station(x: float, y: float, *opened: str, stop: float = 1.0) -> TopCall:
    made = call("goToPose", x, y, 0.0, frozenset(opened))
    return dataclasses.replace(made, goal=with_values(made.goal, {STOP: stop}))


def chain(*calls: TopCall) -> TopChain:
    return TopChain(calls)


def stops(of: TopChain) -> list[float]:
    return [each.goal.values[STOP] for each in of.calls]


def test_a_station_on_the_way_is_passed_and_one_before_a_sharp_turn_is_not() -> None:
    straight = [station(x, 0.0, STOP) for x in (1.0, 2.0, 3.0)]
    found = REFINER.refine(START, chain(*straight), placeholders=True)
    assert stops(found.best) == [0.0, 0.0, 1.0]
    assert stops(found.original) == [1.0, 1.0, 1.0]
    back = [station(x, 0.0, STOP) for x in (2.0, 1.0, -1.0)]
    found = REFINER.refine(START, chain(*back), placeholders=True)
    assert stops(found.best) == [1.0, 0.0, 1.0]
    assert [(each.subgoal, each.name) for each in found.free] == [(0, STOP), (1, STOP)]
    assert found.not_free == (NotFree(2, STOP, "needed at the end of the chain"),)


@pytest.mark.parametrize("seed", range(8))
def test_orders_and_stops_are_nearly_the_best_of_all(seed: int) -> None:
    places = np.random.default_rng(seed).uniform(-4.0, 4.0, (4, 2)).tolist()
    sent = chain(*(station(x, y, STOP, ORDER) for x, y in places))
    found = REFINER.refine(START, sent, placeholders=True)
    least = math.inf
    for order in itertools.permutations(range(4)):
        for passed in itertools.product((0.0, 1.0), repeat=3):
            other = sent.reordered(order)
            for index, stop in enumerate(passed):
                goal = with_values(other.calls[index].goal, {STOP: stop})
                other = other.with_goal(index, goal)
            least = min(least, predict_chain(START, other, MODELS, ROBOT).duration)
    assert not found.best.violations(START, ROBOT)
    assert ordering_of(sent).fault(found.best.order) is None
    assert least - 1e-9 <= found.after.duration <= 1.03 * least


@pytest.mark.parametrize("turned", [0.3, 2.3, -1.1])
def test_no_stop_is_better_the_other_way(turned: float) -> None:
    """The directions of the table differ from those of the round, however the round is turned."""
    places = np.random.default_rng(4).uniform(-4.0, 4.0, (7, 2))
    cos, sin = math.cos(turned), math.sin(turned)
    places = places @ np.array([[cos, sin], [-sin, cos]])
    sent = chain(*(station(x, y, STOP, ORDER, "yaw") for x, y in places.tolist()))
    found = REFINER.refine(START, sent, placeholders=True)
    for index, each in enumerate(found.best.calls[:-1]):
        goal = with_values(each.goal, {STOP: 1.0 - each.goal.values[STOP]})
        other = found.best.with_goal(index, goal)
        assert predict_chain(START, other, MODELS, ROBOT).cost > 0.999 * found.after.cost


def test_the_next_leg_begins_where_the_robot_passes() -> None:
    start = World(0.0, RobotState(Pose(0.0, 0.0, 1.0)))
    plan = chain(station(0.0, 2.0, stop=0.0), station(4.0, 2.0))
    first, second = chain_situations(start, plan, ROBOT, MODELS)
    assert first["stopg"][0] == 0.0
    begin = [second[name][0] for name in ("x", "y", "yaw", "v", "w")]
    assert begin == pytest.approx([0.0, 2.0 - TAKEOVER, math.pi / 2.0, PASSING.speed, 0.0])


def test_stops_that_the_plan_fixes_are_kept_and_have_no_heading() -> None:
    sent = chain(station(1.0, 0.0, "yaw", stop=0.0), station(2.0, 1.0, "yaw"))
    found = REFINER.refine(START, sent)
    assert stops(found.best) == [0.0, 1.0]
    (fixed,) = found.not_free
    assert (fixed.subgoal, fixed.name) == (0, "yaw")
    assert fixed.reason == "not commanded where the robot passes"


def test_headings_are_refined_where_the_robot_stops() -> None:
    sent = chain(*(station(x, y, "yaw", STOP) for x, y in ((2.0, 0.0), (1.0, 0.1), (0.0, 2.0))))
    found = REFINER.refine(START, sent, placeholders=True)
    assert stops(found.best) == [1.0, 0.0, 1.0]
    names = [(each.subgoal, each.name) for each in found.free]
    assert (0, "yaw") in names
    assert (1, "yaw") not in names
    assert abs(found.best.calls[0].goal.pose.yaw) == pytest.approx(math.pi, abs=0.3)


def test_a_model_that_does_not_know_of_stops_leaves_them() -> None:
    found = UNAWARE.refine(START, chain(station(1.0, 0.0, STOP), station(2.0, 0.0)))
    assert stops(found.best) == [1.0, 1.0]
    assert found.not_free[0].reason == "used by no performance model of a neighboring action"


def test_a_passed_station_becomes_the_last_one_only_if_its_stop_is_open() -> None:
    for opened, order in (((STOP, ORDER), (1, 2, 0)), ((ORDER,), (1, 0, 2))):
        sent = chain(
            station(3.0, 0.0, *opened, stop=0.0),
            station(0.0, 0.0, *opened, stop=0.0),
            station(1.0, 0.0, STOP, ORDER),
        )
        found = UNAWARE.refine(START, sent, placeholders=True)
        assert found.original.order == (0, 1, 2)
        assert stops(found.original) == [0.0, 0.0, 1.0]
        assert found.best.order == order
        assert not found.best.violations(START, ROBOT)
        assert found.complete


def test_stop_opens_the_arrival_speed_of_an_action_that_has_one() -> None:
    refiner = Refiner(ROBOT, models())
    calls = [call("goToPose", x, 0.0, 0.0, frozenset({STOP})) for x in (1.0, 2.0)]
    found = refiner.refine(START, chain(*calls), placeholders=True)
    assert [(each.subgoal, each.name) for each in found.free] == [(0, "speed"), (1, "speed")]


def test_the_reference_passes_where_the_plan_does() -> None:
    back = [station(x, 0.0, STOP, stop=stop) for x, stop in ((2.0, 0.0), (1.0, 0.0), (-1.0, 1.0))]
    found = REFINER.refine(START, chain(*back), placeholders=True)
    assert stops(found.original) == [0.0, 0.0, 1.0]
    assert stops(found.best) == [1.0, 0.0, 1.0]
    assert stops(UNAWARE.refine(START, chain(*back), placeholders=True).best) == [0.0, 0.0, 1.0]


def test_a_station_that_the_plan_passes_is_not_ordered_before_another_action() -> None:
    """Along the line, each passed station would come before one of the other action."""
    other = dataclasses.replace(LIBRARY["goToPose"], name="work", action="dribbleBall")
    calls = []
    for x in (1.0, 3.0, 5.0):
        calls.append(station(x, 0.0, ORDER, stop=0.0))
        calls.append(dataclasses.replace(station(x + 1.0, 0.0, ORDER), top=other))
    sent = chain(station(0.0, 0.0, ORDER), *calls)
    valid = []
    for order in itertools.permutations(range(len(sent))):
        moved = sent.reordered(order)
        if not moved.violations(START, ROBOT):
            valid.append(moved)
    reference = valid[-1]
    found = REFINER.refine(START, reference)
    least = min(predict_chain(START, each, MODELS, ROBOT).duration for each in valid)
    assert not found.best.violations(START, ROBOT)
    assert found.after.duration <= 1.03 * least


@pytest.mark.parametrize("opened", [(STOP,), (ORDER,), (STOP, ORDER)])
def test_a_round_that_is_the_best_as_sent_is_searched_to_the_end(opened: tuple[str, ...]) -> None:
    found = REFINER.refine(START, chain(*(station(x, 0.0, *opened) for x in (0.0, 1.0, 3.0))))
    again = REFINER.refine(START, found.best)
    assert again.complete
    assert not again.refined
    assert ITS_DEADLINE not in again.reason


@pytest.mark.parametrize("count", [4, 12])
def test_stations_have_allowed_headings_and_the_last_one_a_stop(count: int) -> None:
    places = np.random.default_rng(count).uniform(-4.0, 4.0, (count, 2)).tolist()
    side = (AllowedRange("yaw", 0.3, 0.4),)
    calls = [
        dataclasses.replace(station(x, y, STOP, ORDER, "yaw"), allowed=side).within_allowed(
            ROBOT, REFINER.ranges
        )
        for x, y in places
    ]
    found = REFINER.refine(START, chain(*calls))
    assert stops(found.best)[-1] == 1.0
    assert 0.0 in stops(found.best)
    as_sent = chain(*calls).reordered(found.best.order)
    assert allowed_changes(as_sent, found.best, ROBOT, REFINER.ranges)


@pytest.mark.parametrize("passed", [0.0, 1.0])
def test_the_prediction_is_that_of_the_places_chosen(passed: float) -> None:
    """The robot comes to the second station in another direction if the first is elsewhere."""
    places = [(2.0, 1.5), (3.0, 0.0), (3.0, 3.0)]
    first, second, last = itertools.starmap(station, places)
    first = dataclasses.replace(first, open=frozenset({"x", "y"}))
    second = dataclasses.replace(second, goal=with_values(second.goal, {STOP: passed}))
    for opened in (frozenset(), frozenset({ORDER})):
        sent = chain(*(dataclasses.replace(c, open=c.open | opened) for c in (first, second, last)))
        found = REFINER.refine(START, sent)
        assert found.refined
        assert found.best.sent(0).goal.pose.distance(first.goal.pose) > 0.1
        exact = predict_chain(START, found.best, MODELS, ROBOT)
        assert found.after.cost == pytest.approx(exact.cost, abs=1e-9)
        assert found.after.cost < found.before.cost


def test_a_station_that_models_always_pass_keeps_an_allowed_heading() -> None:
    side = (AllowedRange("yaw", 0.3, 0.4),)
    calls = []
    for x, stop in ((3.0, 0.0), (1.0, 0.0), (2.0, 1.0)):
        made = station(x, 0.5 * x, STOP, ORDER, "yaw", stop=stop)
        made = dataclasses.replace(made, allowed=side)
        calls.append(made.within_allowed(ROBOT, UNAWARE.ranges))
    found = UNAWARE.refine(START, chain(*calls))
    assert found.best.order != (0, 1, 2)
    for each in found.best.calls:
        domain = each.range_of("yaw", ROBOT, UNAWARE.ranges)
        assert domain is not None
        assert domain.contains(each.goal.pose.yaw)
