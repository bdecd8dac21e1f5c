"""Arrivals at speed leave room to stop before a bay, if the gate requires it."""

from __future__ import annotations

import numpy as np
import pytest
from refinement_fakes import ROBOT, FakeModel, call, world

from ator_ros.refinement.gate import OpenGate
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import TopChain

SPEED = frozenset({"speed"})


def test_a_refiner_respects_the_room_of_its_gate() -> None:
    """Faster arrivals shorten the next step, but the ball is 0.8 m in front of a bay."""
    fast = FakeModel(lambda direct: 9.0 - direct["speedg"] - direct["v"], frozenset({"v", "speedg"}))
    models = {"goToPose": fast, "dribbleBall": fast}
    chain = TopChain((call("goToBall", -3.2, 0.0, np.pi, SPEED), call("dribbleBall", -2.0, -1.9, 1.8)))

    def arrival(room: float) -> float:
        refiner = Refiner(ROBOT, models, OpenGate(room=room))
        return refiner.refine(world(x=-1.0, ball=(-3.2, 0.0)), chain).best.calls[0].goal.speed

    assert arrival(0.0) == pytest.approx(1.0, abs=0.01)
    assert 0.3 < arrival(1.5) < 0.75
