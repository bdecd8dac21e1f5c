"""Rehearsal: what a first goal needs has been computed, and compiled, before."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import pytest
from experience_rows import made_up_model
from parcels import PARCELS

from ator_ros.actions.base import Action, Goal, Status, Step
from ator_ros.domains.domain import Domain
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.planned import planner, screening, shoot
from ator_ros.execution.predictions import Predictor
from ator_ros.execution.rehearsal import rehearse, rehearse_refinement
from ator_ros.motion import displacements, search
from ator_ros.refinement.refiner import Refinement, Refiner
from ator_ros.robot.description import Robot, load_robot
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Term
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, World


def test_a_second_rehearsal_finds_all_tables() -> None:
    robot = load_robot()
    library, predictor = SOCCER.library(robot), Predictor(robot, {})
    kept = (displacements._kept_headings, shoot._kept_table, search._stored_table)
    rehearse(robot, library, predictor)
    before = [table.cache_info().misses for table in kept]
    assert min(before) > 0
    # Rates that only some speed of a start allows: their headings are there before one has it.
    assert displacements._kept_headings.cache_info().currsize > 20
    rehearse(robot, library, predictor)
    assert [table.cache_info().misses for table in kept] == before


def test_a_rehearsal_searches_to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    called = dict.fromkeys(("judge", "touch", "closed", "is_clear"), 0)
    for module, name in (
        (screening, "judge"), (screening, "touch"), (planner, "closed"), (planner, "is_clear"),
    ):  # fmt: skip
        original = getattr(module, name)

        def counted(*arguments, name=name, original=original):  # type: ignore[no-untyped-def]
            called[name] += 1
            return original(*arguments)

        monkeypatch.setattr(module, name, counted)
    robot = load_robot()
    rehearse(robot, SOCCER.library(robot), Predictor(robot, {}))
    assert min(called.values()) > 0


PIONEER = load_robot()


@pytest.mark.parametrize(
    ("domain", "robot"),
    [
        (SOCCER, load_robot()),
        (SOCCER, dataclasses.replace(load_robot(), holder=None)),
        (PARCELS, load_robot()),
    ],
    ids=["with a holder", "without", "another domain"],
)
def test_a_refinement_is_rehearsed_whatever_the_tops(domain: Domain, robot: Robot) -> None:
    ended: list[Refinement] = []

    class Heard(Refiner):
        """Keeps what it answers."""

        def refine(self, *arguments: Any, **options: Any) -> Refinement:
            ended.append(super().refine(*arguments, **options))
            return ended[-1]

    models = {name: made_up_model("goToPose", robot) for name in domain.actions()}
    library = domain.library(robot)
    rehearse_refinement(library, Heard(robot, models, ranges=domain.ranges))
    assert "yaw" in {variable.name for variable in ended[0].free}
    assert ended[0].curves
    rehearsed = {call.top.name for refinement in ended for call in refinement.original.calls}
    assert rehearsed == {top.name for top in library.usable()}


class Lift(Action):
    """Needs the cube, which its TOP's pre-condition speaks of."""

    name = "lift"

    def start(self, world: World, goal: Goal) -> None:
        assert world.objects["cube"]

    def step(self, world: World) -> Step:
        return Step(STOP, Status.SUCCEEDED, "lifted")


class Fragile(Action):
    """Plans for ever, and fails with an error in its first step."""

    name = "lift"
    ended: ClassVar[list[str]] = []

    @property
    def planning(self) -> bool:
        return True

    def start(self, world: World, goal: Goal) -> None:
        pass

    def step(self, world: World) -> Step:
        raise RuntimeError("out of order")

    def end(self, reason: str) -> None:
        self.ended.append(reason)


def test_an_action_whose_step_fails_is_ended() -> None:
    robot, anywhere = load_robot(), Condition(())
    library = TopLibrary(
        robot, "own", tops=(Top("lift", "lift", anywhere, anywhere),), actions={"lift": Fragile}
    )
    Fragile.ended.clear()
    with pytest.raises(RuntimeError, match="out of order"):
        rehearse(robot, library, Predictor(robot, {}))
    assert Fragile.ended == ["rehearsed"]


@pytest.mark.parametrize("other", ["goal", "hold"])
def test_a_rehearsal_knows_the_objects_of_other_domains(other: str) -> None:
    near = Condition(tuple(Term(f"{other}.{axis}", f"cube.{axis}", 0.1) for axis in "xy"))
    robot = load_robot()
    library = TopLibrary(robot, "own", tops=(Top("lift", "lift", near, near),), actions={"lift": Lift})
    rehearse(robot, library, Predictor(robot, {}))
