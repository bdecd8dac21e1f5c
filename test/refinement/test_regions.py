"""Regions of conditions: relations between places as data, and the free variables they leave."""

import dataclasses
import math

import numpy as np
import pytest
from refinement_fakes import ALL, BOTH, LIBRARY, ROBOT, call, models, world

from ator_ros.domains.soccer.tops import SHOOT
from ator_ros.execution.fence import Fence
from ator_ros.refinement.free_variables import names_of
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain
from ator_ros.tops.conditions import Bearing, Condition, Distance

GOAL = {"x": 4.0, "y": 0.0, "yaw": 0.0, "speed": 0.0}
MARGIN = 0.16  # tolerance of a dribble's post-condition


def ball(x: float, y: float) -> dict[str, float]:
    return {"ball.x": x, "ball.y": y, "hold.x": x, "hold.y": y}


def shot(opened: frozenset[str] = ALL, x: float = 2.3, y: float = 0.8) -> TopChain:
    return TopChain(
        (
            call("goToBall", 0.0, 0.0, 0.0, BOTH),
            call("dribbleBall", x, y, 0.0, opened),
            call("shoot", 4.0, 0.0, 0.0),
        )
    )


@pytest.mark.parametrize(
    ("relation", "inside", "outside"),
    [
        (Distance("ball", "goal", 0.9, 2.5), (2.0, 1.0), (3.5, 0.1)),
        (Distance("ball", "goal", low=0.5), (-3.0, 0.0), (3.9, 0.3)),
        (
            Bearing("ball", "goal", math.radians(50.0), math.pi, mirrored=True),
            (3.0, 1.0),
            (3.5, 2.0),
        ),
    ],
)
def test_a_relation_holds_inside_and_clearance_is_the_distance_to_its_edge(
    relation: Distance | Bearing, inside: tuple[float, float], outside: tuple[float, float]
) -> None:
    condition = Condition(relations=(relation,))
    assert condition.violations(ball(*inside), GOAL) == []
    assert condition.shortfall(ball(*inside), GOAL) == 0.0
    [violation] = condition.violations(ball(*outside), GOAL)
    assert str(relation) in violation
    room = float(relation.clearance(ball(*inside), GOAL))

    def holds(share: float, angle: float) -> bool:
        x, y = (
            inside[0] + share * room * math.cos(angle),
            inside[1] + share * room * math.sin(angle),
        )
        return condition.violations(ball(x, y), GOAL) == []

    angles = np.linspace(0.0, 2.0 * math.pi, 361)
    assert all(holds(0.99, angle) for angle in angles)
    assert not all(holds(1.05, angle) for angle in angles)


def test_a_shot_from_too_far_away_is_invalid() -> None:
    here = world(ball=(0.0, 0.0))
    assert shot().violations(here, ROBOT) == []
    assert "step 3 (shoot) after step 2" in shot(x=0.5, y=0.5).violations(here, ROBOT)[0]


class TestFreePlace:
    refiner = Refiner(ROBOT, models(), ranges=LIBRARY.ranges)

    def test_domains_follow_from_the_region(self) -> None:
        analysis, regions = self.refiner.bounded(world(), shot())
        place = {v.name: v for v in analysis.free if v.subgoal == 1}
        assert set(place) == {"x", "y", "yaw", "speed"}
        assert 1.2 < place["x"].domain.low < 1.6
        assert 3.0 < place["x"].domain.high < 3.9
        assert any("distance from ball to goal" in limit for limit in place["x"].limits)
        assert place["speed"].limits == ()
        names = names_of(shot(), analysis.free)[1]
        for x, y, good in (
            (2.0, 0.0, True),
            (1.0, 0.0, False),
            (3.2, 0.0, False),
            (3.0, 2.0, False),
        ):
            row = [{"x": x, "y": y, "yaw": 0.3, "speed": 0.2}[name] for name in names]
            assert regions.allowed(1, np.array([row])).tolist() == [good]

    @pytest.mark.parametrize("placeholders", [False, True])
    def test_a_place_is_chosen_within_the_region_and_costs_less(self, placeholders: bool) -> None:
        fixed = self.refiner.refine(world(), shot(BOTH))
        answer = self.refiner.refine(world(), shot(), placeholders=placeholders)
        there = answer.chain.calls[1].goal.pose
        away = math.hypot(4.0 - there.x, there.y)
        assert 0.74 + MARGIN - 1e-9 <= away <= 2.66 - MARGIN + 1e-9
        assert answer.chain.violations(world(), ROBOT) == []
        assert answer.after.cost < fixed.after.cost - 0.1
        assert answer.chain.calls[0].goal.pose[:2] == (0.0, 0.0)

    def test_a_place_is_chosen_inside_the_fence(self) -> None:
        def answer(fence: Fence) -> TopChain:
            refiner = Refiner(ROBOT, models(), ranges=fence.narrowed(LIBRARY.ranges, ROBOT))
            return refiner.refine(world(), shot()).chain

        usual = answer(Fence.around(ROBOT))
        assert usual == self.refiner.refine(world(), shot()).chain
        place = usual.calls[1].goal.pose
        narrow = Fence(-4.0, place.y - 0.1, 4.0, 3.0)
        assert narrow.leads_out(usual.calls[1], ROBOT)
        inside = answer(narrow).calls[1]
        assert inside.goal.pose != shot().calls[1].goal.pose
        assert not narrow.leads_out(inside, ROBOT)
        elsewhere = answer(Fence(10.0, 10.0, 20.0, 20.0)).calls[1]
        assert elsewhere.goal.pose[:2] == shot().calls[1].goal.pose[:2]

    def test_without_an_allowed_value_nothing_is_free(self) -> None:
        top = dataclasses.replace(SHOOT, pre=Condition((), (Distance("ball", "goal", 20.0, 21.0),)))
        chain = TopChain((*shot().calls[:2], dataclasses.replace(shot().calls[2], top=top)))
        analysis, _ = self.refiner.bounded(world(), chain)
        assert {v.subgoal for v in analysis.free} == {0}
        assert all(
            "without an allowed value" in n.reason for n in analysis.not_free if n.subgoal == 1
        )


def test_naive_places_derive_from_previous_naive_places() -> None:
    chains = [
        TopChain(
            (
                call("goToBall", 0.0, 0.0, 0.0, BOTH),
                call("dribbleBall", x, y, 0.0, ALL),
                call("dribbleBall", 2.3, 0.9, 0.0, ALL),
                call("shoot", 4.0, 0.0, 0.0),
            )
        )
        for x, y in ((1.0, 0.0), (2.6, 0.4), (-2.0, -1.5))
    ]
    refiner = Refiner(ROBOT, models(), ranges=LIBRARY.ranges)
    found = [refiner.naive(world(), chain) for chain in chains]
    assert found[0] == found[1] == found[2]
