"""A started action is ended once, even if it raises."""

from __future__ import annotations

import pytest

from ator_ros.actions.base import Action, Goal, Status, Step
from ator_ros.evaluation.chain_run import run_chain
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import STOP, RobotState, World

ROBOT = load_robot()
START = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
AHEAD = Goal(Pose(1.0, 0.0, 0.0))


class Broken(Action):
    """Raises in its second step; counts starts and ends."""

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
