"""Arrivals at speed leave room to stop before a bay, where the gate asks for it."""

from __future__ import annotations

import numpy as np
import pytest
from refinement_fakes import ROBOT, FakeModel, call, world
from robots import HEAVY, PIONEER

from ator_ros.actions.base import Goal, Point
from ator_ros.geometry import Pose
from ator_ros.refinement.chain_prediction import leaves_room
from ator_ros.refinement.gate import OpenGate
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopChain

BEFORE = Goal(Pose(-2.72, 0.25, 0.0), 0.0, Point.HOLD)  # 1.28 m before the mouth of a bay
NAMES, SPEED = ("yaw", "speed"), frozenset({"speed"})


def free(robot: Robot, *candidates: tuple[float, float], room: float = 1.0) -> list[bool]:
    return leaves_room(BEFORE, NAMES, np.array(candidates), robot, room).tolist()


def test_fast_arrivals_toward_a_bay_have_no_room_and_others_have() -> None:
    toward, away, beside, past_the_post = np.pi, 0.0, 0.6 * np.pi, 0.75 * np.pi
    assert free(HEAVY, (toward, 0.8), (toward, 0.4), (toward, 0.0)) == [False, True, True]
    assert free(HEAVY, (away, 0.8), (beside, 0.8)) == [True, True]
    assert free(HEAVY, (past_the_post, 0.8)) == [False]  # it would stand too near the post to turn
    assert free(HEAVY, (toward, 0.65), room=1.0) == [True]
    assert free(HEAVY, (toward, 0.65), room=1.5) == [False]
    assert free(PIONEER, (toward, 0.8)) == [True]  # it brakes harder


def test_a_refiner_keeps_the_room_of_its_gate() -> None:
    """The faster the arrival, the sooner the next step is done; but the ball lies 0.8 m before a bay."""
    fast = FakeModel(lambda direct: 9.0 - direct["speedg"] - direct["v"], frozenset({"v", "speedg"}))
    models = {"goToPose": fast, "dribbleBall": fast}
    chain = TopChain((call("goToBall", -3.2, 0.0, np.pi, SPEED), call("dribbleBall", -2.0, -1.9, 1.8)))

    def arrival(room: float) -> float:
        refiner = Refiner(ROBOT, models, OpenGate(room=room))
        return refiner.refine(world(x=-1.0, ball=(-3.2, 0.0)), chain).best.calls[0].goal.speed

    assert arrival(0.0) == pytest.approx(1.0, abs=0.01)
    assert 0.3 < arrival(1.5) < 0.75
