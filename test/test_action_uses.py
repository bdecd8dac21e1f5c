"""Whoever starts an action outside a chain ends it once, also where it fails or raises."""

from __future__ import annotations

import contextlib

import pytest
from carried import ROBOT
from planned import slices_of

from ator_ros.actions.base import Action, ActionError, Goal, Point, Status, Step, started
from ator_ros.domains.soccer import situations
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.planned import shooting_room
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.domains.soccer.planned.shoot import Shoot
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.experience.collect import episode_generator
from ator_ros.geometry import Pose
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, RobotState, World
from benchmarks.speed import tick_times

START = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
AHEAD = Goal(Pose(1.0, 0.0, 0.0))


class Broken(Action):
    """Raises in its second step, and counts starts and ends."""

    name = "broken"

    def __init__(self, error: Exception | None = None) -> None:
        super().__init__(ROBOT)
        self.error, self.log = error or RuntimeError("out of order"), list[str]()

    def start(self, world: World, goal: Goal) -> None:
        self.log.append("start")

    def step(self, world: World) -> Step:
        self.log.append("step")
        if self.log.count("step") > 1:
            raise self.error
        return Step(STOP, Status.RUNNING, "running")

    def end(self, reason: str) -> None:
        self.log.append(reason)


def test_a_use_ends_with_the_reason_that_it_was_given_last() -> None:
    action = Broken()
    with started(action, START, AHEAD) as use:
        use.reason = "done"
    assert action.log == ["start", "done"]
    with pytest.raises(RuntimeError, match="in the block"), started(action, START, AHEAD):
        raise RuntimeError("in the block")
    assert action.log == ["start", "done", "start", "broken off"]


@pytest.mark.parametrize("error", [RuntimeError("out of order"), ActionError("no way")])
def test_an_action_that_raises_while_ticks_are_measured_is_ended(error: Exception) -> None:
    action = Broken(error)
    with contextlib.suppress(RuntimeError):  # of an ActionError the measurement tells the time
        tick_times(action, START, AHEAD)
    assert action.log == ["start", "step", "step", "measured"]


@pytest.mark.parametrize("goal", [AHEAD, Goal(Pose(1.0, 0.0, 0.0), 0.0, Point.HOLD)])
def test_an_action_whose_planning_is_measured_is_ended(goal: Goal) -> None:
    ended = []

    class Ended(GoToPose):
        def end(self, reason: str) -> None:
            ended.append(reason)

    assert slices_of(Ended(ROBOT), START, goal)
    assert ended == ["measured"]


def test_an_action_that_looked_for_room_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    log = []

    class Logged(Shoot):
        def start(self, world: World, goal: Goal) -> None:
            super().start(world, goal)
            log.append("start")

        def end(self, reason: str) -> None:
            log.append(reason)

    monkeypatch.setattr(shooting_room, "Shoot", Logged)
    robot = SOCCER.robot()
    assert shooting_room.has_room(robot, situations.shoot(robot, episode_generator("shoot", 1, 4)))
    assert log == ["start", "looked for room"]


def test_an_action_that_raises_in_a_simulated_chain_is_ended() -> None:
    made: list[Broken] = []

    def make(_: object) -> Action:
        made.append(Broken())
        return made[-1]

    top = Top("break", "broken", Condition(), Condition())
    library = TopLibrary(ROBOT, "broken", tops=[top], actions={"broken": make})
    chain = TopChain((TopCall(top, AHEAD),))
    with pytest.raises(RuntimeError, match="out of order"):
        run_chain(ROBOT, library, START, chain)
    assert made[-1].log == ["start", "step", "step", "broken off"]
