"""A view beside chains that somebody else sends to the executor."""

from __future__ import annotations

import dataclasses
import math

import pytest
from in_process_stage import InProcessStage, desk_in_control

from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.viewing import panel
from ator_ros.viewing.advice import Advice
from ator_ros.viewing.desk import REFINED, Desk
from ator_ros.viewing.draft import Draft
from ator_ros.viewing.guest import OTHERS, Guest
from ator_ros.viewing.runs import Run
from ator_ros.viewing.situations import drawn
from ator_ros.viewing.stage import AbsentError, StageError
from ator_ros.world.state import RobotState, World

ROBOT = SOCCER.robot()


class GuestStage(InProcessStage):
    """Whose refinement may fail, and whose executor takes long."""

    def __init__(self) -> None:
        super().__init__(SOCCER, ROBOT)
        self.fails: StageError | None = None
        self.given: list[bool] = []
        self.place_object("ball", 1.0, 0.0)

    def refine(self, draft: Draft, *, as_given: bool = False) -> Advice:
        self.given.append(as_given)
        if self.fails is not None:
            raise self.fails
        return super().refine(draft, as_given=as_given)

    def execute(self, run: Run, draft: Draft, *, refine: bool) -> None:
        self.calls.append(f"execute {run.label}")

    def drive(self, time: float, x: float) -> None:
        self.state = World(time, RobotState(Pose(x, 0.0, 0.0)), self.state.objects)


@pytest.fixture
def stage() -> GuestStage:
    return GuestStage()


@pytest.fixture
def desk(stage: GuestStage) -> Desk:
    return desk_in_control(stage)


@pytest.fixture
def guest(stage: GuestStage) -> Guest:
    """Return a chain of others that waits for refinement."""
    draft = drawn(SOCCER, stage.libraries, "dribble", seed=3, index=1)
    return Guest("a" * 32, draft, Run(OTHERS), reason="waiting for refinement")


def begun(stage: GuestStage, guest: Guest) -> Guest:
    """Return it as it is driven once refinement has answered."""
    chain = stage.refine(guest.draft).chain
    draft = dataclasses.replace(guest.draft, chain=chain)
    return dataclasses.replace(guest, draft=draft, begun=True, refined=True, reason="gain of 1.2 s")


def test_it_is_shown_before_and_during_its_execution(desk: Desk, stage: GuestStage, guest: Guest) -> None:
    own, edition = desk.draft, desk.edition
    stage.guest = guest
    desk.step()
    draft, advice = desk.shown
    assert draft is guest.draft
    assert advice is not None
    assert advice.naive != advice.chain  # grey and blue
    assert len(advice.curves) == 1  # the ring
    assert "waiting for refinement; predicted: " in advice.reason
    assert desk.edition > edition
    assert desk.runs == [guest.run]
    assert desk.playing
    asked = len(stage.asked)

    stage.guest = driven = begun(stage, guest)
    asked = len(stage.asked)
    desk.step()
    _, advice = desk.shown
    assert advice is not None
    assert (advice.chain, advice.refined, advice.reason) == (driven.chain, True, "gain of 1.2 s")
    assert advice.naive.calls[0].goal != advice.chain.calls[0].goal
    guest.run.actual.append(2.5)
    table = panel.times(advice, desk.runs)
    assert "| others, driven | 2.50 |" in table
    assert len(advice.before) == len(advice.after) == 2
    for number in range(5):
        stage.drive(20.0 + 0.1 * number, -2.0 + 0.1 * number)
        stage.guest = dataclasses.replace(driven)  # twice a second the executor tells of it
        desk.step()
    assert len(stage.asked) == asked + 1  # nothing new is asked
    assert guest.run.poses[-1] == Pose(-1.6, 0.0, 0.0)  # the trail
    assert desk.draft is own

    guest.run.ended, guest.run.duration = True, 5.0
    desk.step()
    assert desk.shown == (desk.draft, desk.advice)
    assert desk.draft.world.robot.pose == Pose(-1.6, 0.0, 0.0)  # it is followed again
    assert "| others, driven | 2.50 |" in panel.times(desk.advice, desk.runs)
    assert stage.calls == []  # nothing was placed or stopped


def test_a_chain_that_is_driven_as_given_is_compared_with_itself(
    desk: Desk, stage: GuestStage, guest: Guest
) -> None:
    stage.guest = dataclasses.replace(guest, begun=True, reason="not asked for")
    desk.step()
    assert stage.given[-1]
    _, advice = desk.shown
    assert advice is not None
    assert [call.goal for call in advice.naive.calls] == [call.goal for call in guest.chain.calls]
    assert advice.predicted == advice.before


def test_what_is_played_here_goes_first(desk: Desk, stage: GuestStage, guest: Guest) -> None:
    stage.guest = guest
    desk.step()
    desk.step([lambda: desk.play(REFINED)])
    assert stage.calls[0] == "stop"
    assert [run.label for run in desk.runs] == [REFINED]
    assert desk.shown == (desk.draft, desk.advice)
    desk.step()
    assert [run.label for run in desk.runs] == [REFINED]


def test_nothing_is_moved_under_the_feet_of_others(desk: Desk, stage: GuestStage, guest: Guest) -> None:
    stage.guest = guest
    desk.step()
    before = desk.draft
    desk.step([lambda: desk.move_robot(Pose(0.0, 0.0, 0.0)), lambda: desk.move_goal(1, Pose(1.0, 1.0, 0.0))])
    assert desk.draft == before
    desk.step([desk.stop])
    assert stage.calls == ["stop"]


def test_without_refinement_what_the_executor_tells_is_shown(
    desk: Desk, stage: GuestStage, guest: Guest
) -> None:
    stage.fails = AbsentError("not there")
    stage.guest = guest
    desk.step()
    _, advice = desk.shown
    assert advice is not None
    assert (advice.chain, advice.before) == (guest.chain, ())
    assert "nan" not in panel.times(advice, desk.runs)
    stage.fails = None
    stage.guest = dataclasses.replace(guest)
    desk.step()
    _, advice = desk.shown
    assert advice is not None
    assert math.isfinite(sum(advice.before))  # asked again
    stage.fails = StageError("no plan")
    stage.guest = dataclasses.replace(guest, key="b" * 32, run=Run(OTHERS))
    desk.step()
    assert desk.problem == ""


def test_a_chain_that_was_over_before_is_not_shown(desk: Desk, stage: GuestStage, guest: Guest) -> None:
    guest.run.ended = True
    stage.guest = guest
    desk.step()
    assert desk.shown == (desk.draft, desk.advice)
    assert desk.runs == []
